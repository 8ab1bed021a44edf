"""Points of objects: those in the box, in its frame, whatever their order."""

import numpy as np
import pytest

from coopsim.nn.identity.point_encoder import join_points, points_in_boxes

BOX = np.array([10.0, -5.0, 1.0, 4.0, 2.0, 1.6, 0.5])


def _cloud(unit: np.ndarray) -> np.ndarray:
    """Return points at these shares of the box's half axes, in the agent's frame."""
    local = unit * BOX[3:6] / 2
    cos, sin = np.cos(BOX[6]), np.sin(BOX[6])
    x, y = cos * local[:, 0] - sin * local[:, 1], sin * local[:, 0] + cos * local[:, 1]
    return np.column_stack([x + BOX[0], y + BOX[1], local[:, 2] + BOX[2], np.arange(len(unit)) / 100]).astype(
        np.float32
    )


def test_points_are_in_the_frame_of_their_box() -> None:
    unit = np.random.default_rng(0).uniform(-0.8, 0.8, (50, 3))
    (found,) = points_in_boxes(_cloud(unit), BOX[None], 100)
    back = found[np.argsort(found[:, 3])]
    assert back[:, :3] == pytest.approx(unit * BOX[3:6] / 2, abs=1e-5) and found.dtype == np.float32
    assert found[:, 4:] == pytest.approx(np.tile(BOX[3:6], (50, 1)))


def test_a_box_is_a_bit_larger_but_stands_off_the_ground() -> None:
    unit = np.array(
        [[1.05, 0, 0], [1.2, 0, 0], [0, 1.1, 0], [0, 1.3, 0], [0, 0, 1.1], [0, 0, 1.3], [0, 0, -0.95], [0, 0, -0.8]]
    )
    (found,) = points_in_boxes(_cloud(unit), BOX[None], 100)
    assert sorted(np.round(found[:, 3] * 100).astype(int)) == [0, 2, 4, 7]


@pytest.mark.parametrize(
    ("size", "face"),
    [
        ([3.7, 1.0, 1.0], [2.0, 0.0, 0.0]),
        ([3.7, 1.0, 1.0], [-2.0, 0.0, 0.0]),
        ([1.0, 3.7, 1.0], [0.0, 2.0, 0.0]),
        ([1.0, 1.0, 3.7], [0.0, 0.0, 2.0]),
        ([1.0, 1.0, 0.7], [0.0, 0.0, 0.1 - 0.35]),
    ],
)
def test_points_on_a_face_of_the_larger_box_are_in_it(size: list[float], face: list[float]) -> None:
    """The face is 15 cm beyond the box, and 10 cm above its underside."""
    box = np.array([[0.0, 0.0, 0.0, *size, 0.0]])
    on, beyond = np.array([[*face, 0.5]]), np.array([[*(1.001 * np.array(face)), 0.5]])
    assert [len(points_in_boxes(each, box, 9)[0]) for each in (on, beyond)] == [1, 0]


def test_the_choice_of_points_does_not_depend_on_their_order() -> None:
    rng = np.random.default_rng(0)
    cloud = _cloud(rng.uniform(-0.8, 0.8, (300, 3)))
    (found,), (again,) = (points_in_boxes(each, BOX[None], 60) for each in (cloud, cloud[rng.permutation(300)]))
    assert len(found) == 60 and found.tobytes() == again.tobytes()
    assert found[:, 0].min() < -1.5 and found[:, 0].max() > 1.5


def test_boxes_and_clouds_may_be_empty() -> None:
    cloud = _cloud(np.zeros((3, 3)))
    assert points_in_boxes(cloud, np.zeros((0, 7)), 10) == []
    assert [len(each) for each in points_in_boxes(cloud[:0], BOX[None], 10)] == [0]
    batch = join_points([])
    assert batch.points.shape == (0, 7) and len(batch.counts) == 0
