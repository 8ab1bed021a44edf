"""Tracks as numbers in [-1, 1]."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from gymnasium import spaces

from coopsim.envs.wrappers.track_rows import TRACK_COLUMNS, TrackRows
from coopsim.errors import CoopsimError, InvalidActionError
from coopsim.types.taxonomy import ObjectClass
from coopsim.wire.actions import action_space


def row(**columns: float) -> list[float]:
    return [columns.get(name, 0.0) for name in TRACK_COLUMNS]


def test_rows_become_tracks() -> None:
    form = TrackRows(tracks=3, reach_m=50.0)
    space = form.space(action_space())
    assert space.shape == (3 * len(TRACK_COLUMNS),)
    numbers = [row(present=-1), row(), row(present=0.1, x=0.5, y=-1, z=0.1, l=1, w=0, h=-1, yaw=0.5, vx=0.25, van=1)]
    tracks = form.act("cav_0", np.array(numbers, np.float32).reshape(-1), space)["tracks"]
    assert tracks["id"].tolist() == [2]
    np.testing.assert_allclose(tracks["box"], [[25, -50, 1, 20, 2.05, 0.1, np.pi / 2]], rtol=1e-6)
    np.testing.assert_allclose(tracks["velocity"], [[10, 0]])
    assert tracks["score"].tolist() == [[0.5]] and tracks["label"].tolist() == [ObjectClass.VAN]


def test_a_driver_chooses_its_largest_number() -> None:
    form = TrackRows(tracks=1)
    inner = action_space("maneuver")
    space = form.space(inner)
    assert space.shape == (len(TRACK_COLUMNS) + 5,)
    action = form.act("cav_0", [*row(present=1), 0, 0, 0.3, 0.1, 0], space)
    assert action["maneuver"] == 2
    assert inner.contains(action)


def test_every_sample_is_an_action() -> None:
    form, inner = TrackRows(tracks=8), action_space("maneuver")
    space = form.space(inner)
    space.seed(0)
    for _ in range(20):
        assert inner.contains(form.act("cav_0", space.sample(), space))


def test_numbers_beyond_the_bound_are_the_bound() -> None:
    form = TrackRows(tracks=1)
    space = form.space(action_space())
    beyond, bound = (form.act("cav_0", row(present=1, x=far, l=-far, score=far), space)["tracks"] for far in (7, 1))
    np.testing.assert_array_equal(beyond["box"], bound["box"])
    assert beyond["box"][0, 3] > 0


@pytest.mark.parametrize(
    ("wrong", "says"),
    [
        (np.full(20, np.nan), "cav_0: action must be finite"),
        (np.zeros(19), r"cav_0: action must have shape \(20,\), 1 rows of 20, got \(19,\)"),
        (np.zeros(25), r"cav_0: action must have shape \(20,\), 1 rows of 20, got \(25,\)"),
        (np.zeros((1, 20)), r"got \(1, 20\)"),
        (None, "cav_0: action must be numbers"),
        ("idle", "cav_0: action must be numbers"),
    ],
)
def test_wrong_actions_are_refused(wrong: Any, says: str) -> None:
    form = TrackRows(tracks=1)
    with pytest.raises(InvalidActionError, match=says):
        form.act("cav_0", wrong, form.space(action_space()))


def test_a_driver_without_a_maneuver_is_told_the_length() -> None:
    form = TrackRows(tracks=2)
    with pytest.raises(InvalidActionError, match=r"shape \(45,\), 2 rows of 20 and 5 for the maneuver, got \(40,\)"):
        form.act("cav_0", np.zeros(40), form.space(action_space("maneuver")))


def test_wrong_settings_are_refused() -> None:
    with pytest.raises(CoopsimError, match="tracks must be an integer >= 1, got 0"):
        TrackRows(tracks=0)
    with pytest.raises(CoopsimError, match="reach_m must be"):
        TrackRows(reach_m=np.inf)
    with pytest.raises(CoopsimError, match=r"env must have coopsim's own actions.*got a Discrete$"):
        TrackRows().space(spaces.Discrete(5))
