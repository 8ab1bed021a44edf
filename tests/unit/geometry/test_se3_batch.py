"""Many transforms at once are the transforms one by one, to the bit."""

import numpy as np
import pytest

from coopsim.geometry.boxes import Boxes3D
from coopsim.geometry.se3 import SE3, SE3Batch


def poses(rng: np.random.Generator, count: int) -> np.ndarray[tuple[int, int], np.dtype[np.float64]]:
    return rng.normal(size=(count, 4)) * [100, 100, 1, 3]


@pytest.mark.parametrize("count", [0, 1, 2, 41])
def test_every_transform_is_the_one_of_its_pose(count: int) -> None:
    rng = np.random.default_rng(count)
    rows, first = poses(rng, count), SE3.from_xyz_yaw(rng.normal(size=3), 0.7)
    chained = SE3Batch.from_xyz_yaw(rows).seen_from(first).with_first(first)
    expected = [first, *(first.compose(SE3.from_xyz_yaw(row[:3], float(row[3]))) for row in rows)]
    assert len(chained) == count + 1
    for batch in (chained, SE3Batch.of(expected)):
        np.testing.assert_array_equal(batch.rotation, [each.rotation for each in expected])
        np.testing.assert_array_equal(batch.translation, [each.translation for each in expected])
        np.testing.assert_array_equal(batch.yaw, [each.yaw for each in expected])
    np.testing.assert_array_equal(chained.take([count, 0]).translation[1], first.translation)
    np.testing.assert_array_equal(chained[count].rotation, expected[count].rotation)


def test_boxes_move_by_the_transforms_of_their_numbers() -> None:
    rng = np.random.default_rng(0)
    transforms, number = SE3Batch.from_xyz_yaw(poses(rng, 5)), rng.integers(5, size=40)
    boxes, velocity = Boxes3D.from_array(rng.normal(size=(40, 7)) * 30), rng.normal(size=(40, 2))
    moved, turned = boxes.transform_each(transforms, number), transforms.rotate_planar(velocity, number)
    for row, each in enumerate(number.tolist()):
        expected = boxes[row : row + 1].transform(transforms[each])
        np.testing.assert_array_equal(moved[row : row + 1].array, expected.array)
        np.testing.assert_allclose(turned[row], transforms[each].rotate_planar(velocity[row]), atol=1e-14)
    assert not moved.center.flags.writeable
