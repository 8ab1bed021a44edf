"""Scores of tracks in actions: in [0, 1], except where a recording has others."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import coopsim
from coopsim.errors import InvalidActionError
from coopsim.geometry.boxes import Boxes3D
from coopsim.types import Tracks
from coopsim.wire.actions import action_space, pack_tracks, unpack_action


def scored(score: float) -> dict[str, object]:
    box = Boxes3D(np.zeros((1, 3)), np.ones((1, 3)), np.zeros(1))
    return {"tracks": pack_tracks(Tracks(np.array([1]), box, np.zeros((1, 2)), np.array([score]), np.array([0])))}


@pytest.mark.parametrize("score", [2.0, -0.5, 1.0 + 1e-4])
def test_a_score_beyond_its_bounds_is_refused(score: float) -> None:
    with pytest.raises(InvalidActionError, match=rf"cav_0: track score must be in \[0, 1\], got {score:g}"):
        unpack_action("cav_0", scored(score))
    assert unpack_action("cav_0", scored(score), any_score=True)[0].score[0] == score


def test_bounds_and_their_rounding_are_accepted() -> None:
    for score in (0.0, 1.0, float(np.float32(0.1)), 1.0 + 1e-12):
        assert unpack_action("cav_0", scored(score))[0].score[0] == score
    assert action_space()["tracks"].feature_space["score"].high == 1.0  # type: ignore[attr-defined]


def test_a_simulation_refuses_what_a_replay_accepts(recordings: Path) -> None:
    played = coopsim.parallel_env("replay", path=recordings, detections="ego")
    played.reset(seed=0)
    assert played.step({name: scored(2.0) for name in played.agents})
    simulated = coopsim.parallel_env("crossing", lidar=None, vehicles=2, connected_cars=1)
    simulated.reset(seed=0)
    with pytest.raises(InvalidActionError, match="track score must be in"):
        simulated.step({name: scored(2.0) for name in simulated.agents})
    assert simulated.step({name: scored(1.0) for name in simulated.agents})
