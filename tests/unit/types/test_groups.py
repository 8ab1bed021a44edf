"""Groups of detections with joined columns: the groups stay what they were."""

from collections.abc import Sequence

import numpy as np
import pytest

from coopsim.geometry.boxes import Boxes3D
from coopsim.geometry.se3 import SE3, SE3Batch
from coopsim.types import Detections
from coopsim.types.groups import DetectionGroups


def some(
    count: int, seed: int, *, covariance: bool = False, width: int | None = None, seen: bool = False
) -> Detections:
    rng = np.random.default_rng(seed)
    return Detections(
        Boxes3D.from_array(rng.uniform(1, 2, (count, 7))),
        rng.uniform(size=count),
        rng.integers(3, size=count),
        rng.uniform(size=(count, 7, 7)) if covariance else None,
        None if width is None else rng.uniform(size=(count, width)),
        np.ones((count, 2), dtype=bool) if seen else None,
    )


def columns(detections: Detections) -> list[object]:
    rest = (detections.covariance, detections.embedding, detections.seen_by)
    known = [None if column is None or not len(detections) else repr(column.tolist()) for column in rest]
    return [detections.boxes.array.tolist(), detections.score.tolist(), detections.label.tolist(), *known]


@pytest.mark.parametrize(
    "groups",
    [
        [],
        [some(0, 0)],
        [some(3, 0), some(0, 1), some(2, 2)],
        [some(3, 0, covariance=True, width=4), some(0, 1), some(2, 2, covariance=True, width=4)],
        [some(3, 0, covariance=True), some(2, 1)],
        [some(3, 0, width=4), some(2, 1, width=5), some(1, 2)],
        [some(3, 0, seen=True), some(2, 1)],
    ],
)
def test_groups_are_those_that_were_joined(groups: Sequence[Detections]) -> None:
    joined = DetectionGroups.of(groups)
    assert [columns(each) for each in joined] == [columns(each) for each in groups]
    assert columns(joined.joined) == columns(Detections.concatenate(groups))
    assert joined.group.tolist() == [number for number, group in enumerate(groups) for _ in range(len(group))]
    assert DetectionGroups.of(joined) is joined
    backwards = list(range(len(groups)))[::-1]
    assert [columns(each) for each in joined.take(backwards)] == [columns(each) for each in groups[::-1]]
    assert [columns(each) for each in joined[1:]] == [columns(each) for each in groups[1:]]


@pytest.mark.parametrize("covariance", [(True, True), (False, False), (True, False)])
def test_groups_are_moved_and_masked_as_each_by_itself(covariance: tuple[bool, bool]) -> None:
    groups = [some(3, 0, covariance=covariance[0]), some(0, 1), some(4, 2, covariance=covariance[1])]
    moves = [SE3.from_xyz_yaw([5.0 * number, 1.0, 0.0], 0.4 * number) for number in range(3)]
    mask = np.array([True, False, True, False, True, True, False])
    found = DetectionGroups.of(groups).transform_each(SE3Batch.of(moves)).keep(mask)
    expected = [group.transform(move) for group, move in zip(groups, moves, strict=True)]
    expected = [expected[0][mask[:3]], expected[1], expected[2][mask[3:]]]
    assert [columns(each) for each in found] == [columns(each) for each in expected]
    assert columns(found.joined) == columns(Detections.concatenate(expected))


def test_an_index_beyond_the_groups_is_refused() -> None:
    joined = DetectionGroups.of([some(1, 0), some(2, 1)])
    assert len(joined[-1]) == 2
    with pytest.raises(IndexError):
        joined[2]


def test_what_is_left_is_joined_as_if_it_had_been_all() -> None:
    groups = DetectionGroups.of([some(2, 0, covariance=True), some(1, 1), some(2, 2, covariance=True)])
    assert groups.joined.covariance is None
    kept = groups.keep(np.array([True, True, False, True, False]))
    assert kept.joined.covariance is not None
    assert len(kept) == 3
    assert kept.starts.tolist() == [0, 2, 2, 3]
