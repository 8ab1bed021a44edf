"""Structs check shapes when made and values when asked."""

from dataclasses import replace

import numpy as np
import pytest

from coopsim.errors import InvalidValueError
from coopsim.geometry.boxes import Boxes3D
from coopsim.geometry.se3 import SE3
from coopsim.types import Detections, Tracks


def boxes(count: int) -> Boxes3D:
    return Boxes3D.from_array(np.tile([1.0, 2.0, 0.8, 4.0, 2.0, 1.6, 0.3], (count, 1)))


def tracks(count: int) -> Tracks:
    ids = np.arange(count)
    return Tracks(ids, boxes(count), np.zeros((count, 2)), np.ones(count), np.zeros(count, dtype=int))


def test_wrong_length_names_the_field() -> None:
    with pytest.raises(InvalidValueError, match=r"score must have shape \(2,\), got \(3,\)"):
        Detections(boxes(2), np.zeros(3), np.zeros(2, dtype=int))


def test_arrays_are_read_only_but_the_callers_stays_writable() -> None:
    mine = np.zeros((1, 3))
    made = Boxes3D(mine, np.ones((1, 3)), np.zeros(1))
    with pytest.raises(ValueError, match="read-only"):
        made.center[0] = 1
    mine[0] = 1


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"id": np.array([5, 5])}, r"unique within a frame, got \[5\]"),
        ({"score": np.array([0.0, np.nan])}, r"track score must be finite, got nan at index \(1,\)"),
        ({"velocity": np.full((2, 2), np.inf)}, "track velocity must be finite"),
        ({"label": np.array([0, 99])}, r"labels must be in 0..8, got \[99\]"),
        (
            {"boxes": Boxes3D(np.zeros((2, 3)), np.array([[1, 1, 1], [1, -1, 1]]), np.zeros(2))},
            "sizes must be > 0",
        ),
        ({"boxes": Boxes3D(np.full((2, 3), np.nan), np.ones((2, 3)), np.zeros(2))}, "tracks must be finite"),
    ],
)
def test_tracks_validate(change: dict[str, object], message: str) -> None:
    good = tracks(2)
    fields = {name: getattr(good, name) for name in ("id", "boxes", "velocity", "score", "label")}
    with pytest.raises(InvalidValueError, match=message):
        Tracks(**(fields | change)).validate()  # type: ignore[arg-type]
    good.validate()


def test_concatenate_keeps_covariances_only_where_all_have_them_and_embeddings_where_any() -> None:
    plain = Detections(boxes(1), np.ones(1), np.zeros(1, dtype=int))
    rich = replace(plain, covariance=np.eye(7)[None], embedding=np.ones((1, 4)))
    wide = replace(plain, embedding=np.ones((1, 9)))
    both = Detections.concatenate([rich, rich, Detections.empty()])
    assert both.covariance is not None and both.covariance.shape == (2, 7, 7)
    assert both.embedding is not None and both.embedding.shape == (2, 4)
    mixed = Detections.concatenate([plain, rich, wide])
    assert mixed.covariance is None and mixed.embedding is not None
    np.testing.assert_array_equal(np.isnan(mixed.embedding), [[True] * 4, [False] * 4, [True] * 4])
    assert Detections.concatenate([plain, plain]).embedding is None


@pytest.mark.parametrize("others", [[], [Detections.empty()]])
def test_concatenate_of_one_part_keeps_all_but_who_saw_it(others: list[Detections]) -> None:
    rich = Detections(boxes(1), np.ones(1), np.zeros(1, dtype=int), np.eye(7)[None], np.ones((1, 4)), np.ones((1, 2)))
    one = Detections.concatenate([*others, rich])
    assert one.covariance is not None and one.embedding is not None and one.seen_by is None


def test_transform_turns_boxes_velocities_and_covariances() -> None:
    quarter = SE3.from_xyz_yaw([10, 0, 0], np.pi / 2)
    covariance = np.diag([4.0, 1, 1, 1, 1, 1, 1])[None]
    turned = Detections(boxes(1), np.ones(1), np.zeros(1, dtype=int), covariance).transform(quarter)
    np.testing.assert_allclose(turned.boxes.center, [[8, 1, 0.8]])
    np.testing.assert_allclose(turned.boxes.yaw, [0.3 + np.pi / 2])
    np.testing.assert_allclose(np.diagonal(turned.covariance[0])[:2], [1, 4])  # type: ignore[index]
    moving = Tracks(np.ones(1), boxes(1), np.array([[3.0, 0]]), np.ones(1), np.zeros(1)).transform(quarter)
    np.testing.assert_allclose(moving.velocity, [[0, 3]], atol=1e-12)
