"""Two agents' tracks become one set, an object at most once."""

from __future__ import annotations

import numpy as np
import pytest

from coopsim.fusion.track_fusion import fuse_tracks
from coopsim.geometry.boxes import Boxes3D
from coopsim.types import Tracks
from coopsim.types.track_estimates import TrackEstimates


def estimates(
    *rows: tuple[float, float, float], first_id: int = 1, variance: float = 1.0, label: int = 0, score: float = 0.5
) -> TrackEstimates:
    """Cars at x, y with a heading; standing."""
    array = np.array([[x, y, 0.8, 4.5, 1.9, 1.6, yaw] for x, y, yaw in rows]).reshape(-1, 7)
    count = len(array)
    ids, labels = first_id + np.arange(count), np.full(count, label)
    tracks = Tracks(ids, Boxes3D.from_array(array), np.zeros((count, 2)), np.full(count, score), labels)
    return TrackEstimates(tracks, np.broadcast_to(variance * np.eye(4), (count, 4, 4)))


def test_the_same_object_is_one_between_the_two_and_the_rest_is_added() -> None:
    held = estimates((0, 0, 0), (20, 0, 0), score=0.4)
    heard = estimates((40, 0, 0), (20.6, 0.2, 0), first_id=10, score=0.9)
    fused, where = fuse_tracks(held, heard, gate=0.0)
    np.testing.assert_allclose(fused.mean[:, :2], [[0, 0], [20.3, 0.1], [40, 0]], atol=1e-6)
    assert fused.tracks.id.tolist() == [1, 2, 10] and where.tolist() == [2, 1]
    assert fused.tracks.score.tolist() == [0.4, 0.9, 0.9]


def test_the_surer_one_stands() -> None:
    held, heard = estimates((0, 0, 0), variance=4.0), estimates((1, 0, 0.1), variance=0.5)
    fused, _ = fuse_tracks(held, heard, gate=0.0)
    np.testing.assert_allclose(fused.tracks.boxes.array, heard.tracks.boxes.array, atol=1e-6)
    np.testing.assert_allclose(fused.covariance, heard.covariance, rtol=1e-6)


@pytest.mark.parametrize("flip", [0.0, np.pi, -np.pi])
@pytest.mark.parametrize("yaw", [0.0, 1.5, 3.1, -3.1])
def test_headings_meet_along_the_axis_and_the_front_stays(yaw: float, flip: float) -> None:
    fused, _ = fuse_tracks(estimates((0, 0, yaw)), estimates((0, 0, yaw + 0.1 + flip)), gate=0.0)
    np.testing.assert_allclose(np.exp(1j * fused.tracks.boxes.yaw), np.exp(1j * (yaw + 0.05)), atol=1e-6)


def test_another_class_is_another_object() -> None:
    fused, where = fuse_tracks(estimates((0, 0, 0)), estimates((0, 0, 0), label=7), gate=0.0)
    assert len(fused) == 2 and where.tolist() == [1]


def test_beyond_the_gate_are_two_objects() -> None:
    held, heard = estimates((0, 0, 0)), estimates((6, 0, 0))
    assert len(fuse_tracks(held, heard, gate=-0.1)[0]) == 2
    assert len(fuse_tracks(held, heard, gate=-0.5)[0]) == 1


@pytest.mark.parametrize(("mine", "theirs"), [(0, 0), (2, 0), (0, 2)])
def test_nothing_on_one_side(mine: int, theirs: int) -> None:
    rows = [(0.0, 0.0, 0.0), (20.0, 0.0, 0.0)]
    fused, where = fuse_tracks(estimates(*rows[:mine]), estimates(*rows[:theirs]), gate=0.0)
    assert len(fused) == mine + theirs and where.tolist() == list(range(theirs))


def test_permuting_what_was_heard_permutes_where_it_is() -> None:
    rng = np.random.default_rng(0)
    held = estimates(*((float(x), 0.0, 0.0) for x in range(0, 100, 10)))
    heard = estimates(*((x + 0.3, 0.2, 0.0) for x in range(40, 140, 10)), first_id=50, variance=2.0)
    order = rng.permutation(len(heard))
    plain, where = fuse_tracks(held, heard, gate=0.0)
    shuffled, where_shuffled = fuse_tracks(held, heard[order], gate=0.0)
    np.testing.assert_allclose(shuffled.mean[where_shuffled], plain.mean[where[order]])
