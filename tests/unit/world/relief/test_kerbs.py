"""Pavements are as high as said, and have a face of stone all around, but none inside of others."""

import numpy as np
import pytest
from shapely import Polygon, unary_union

from coopsim.world.relief.kerbs import kerb_faces, pavement_tops

SQUARE = np.array([[0.0, 0.0], [4.0, 0.0], [4.0, 4.0], [0.0, 4.0]])
OCTAGON = 1.5 * np.column_stack([np.cos(np.arange(8) * np.pi / 4), np.sin(np.arange(8) * np.pi / 4)])


def length_m(faces: np.ndarray) -> float:
    """Return the length of upright faces, two triangles a piece."""
    along = np.linalg.norm(np.diff(faces[..., :2], axis=1), axis=2).max(axis=1)
    return float(along.sum() / 2)


@pytest.mark.parametrize(
    "outlines",
    [
        [SQUARE],
        [SQUARE, np.add(SQUARE, [2.0, 1.0])],
        [SQUARE, np.add(OCTAGON, [4.0, 2.0]), np.add(OCTAGON, [0.3, 4.1]), SQUARE @ [[0.6, 0.8], [-0.8, 0.6]]],
        [SQUARE, SQUARE / 4 + [1.0, 1.0]],
    ],
)
def test_kerbs_run_round_the_union(outlines: list[np.ndarray]) -> None:
    faces = kerb_faces(outlines, 0.12)
    union = unary_union([Polygon(outline) for outline in outlines])
    assert length_m(faces) == pytest.approx(union.length, abs=0.02)
    assert faces[..., 2].max() == pytest.approx(0.12)
    assert faces[..., 2].min() < 0


def test_kerbs_on_one_line_are_there_once_and_between_neighbours_there_are_none() -> None:
    assert length_m(kerb_faces([SQUARE, SQUARE], 0.12)) == pytest.approx(16.0)
    beside = [SQUARE, np.add(SQUARE, [4.001, 0.0]), np.add(SQUARE, [2.0, 4.0]), np.add(SQUARE, [40.0, 0.0])]
    union = unary_union([Polygon(outline).buffer(2e-3) for outline in beside])
    assert length_m(kerb_faces(beside, 0.12)) == pytest.approx(union.length, abs=0.05)


def test_faces_look_outward_and_tops_up() -> None:
    faces = kerb_faces([SQUARE], 0.12)
    normal = np.cross(faces[:, 1] - faces[:, 0], faces[:, 2] - faces[:, 0])
    assert (np.einsum("ij,ij->i", normal, faces.mean(axis=1) - [2.0, 2.0, 0.0]) > 0).all()
    tops = pavement_tops([SQUARE, OCTAGON], 0.12)
    assert (np.cross(tops[:, 1] - tops[:, 0], tops[:, 2] - tops[:, 0])[:, 2] > 0).all()
    assert len(tops) == 2 + 6
    assert (tops[..., 2] == 0.12).all()
    assert kerb_faces([], 0.12).shape == pavement_tops([], 0.12).shape == (0, 3, 3)
