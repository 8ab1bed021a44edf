"""Plain shapes of scenery: those of trimesh, which is not imported for them."""

from __future__ import annotations

import sys
from typing import Any

import numpy as np
import pytest
import trimesh

import coopsim
from coopsim.geometry import exact
from coopsim.world.custom import scenery
from coopsim.world.places import layout
from coopsim.world.places.shapes import ball, box, cylinder


def standing(radius_m: float, height_m: float, sections: int) -> trimesh.Trimesh:
    axis = np.array([[0.0, 0.0, 0.0], [0.0, 0.0, height_m]])
    return trimesh.creation.cylinder(radius_m, segment=axis, sections=sections)


@pytest.mark.parametrize(
    ("ours", "theirs"),
    [
        (cylinder(0.1, 7.3, 8), standing(0.1, 7.3, 8)),
        (cylinder(6.0, 1.8), standing(6.0, 1.8, 32)),
        (cylinder(0.5, 1.0, 6), standing(0.5, 1.0, 6)),
        (ball(), trimesh.creation.icosphere(subdivisions=1)),
    ],
)
def test_round_shapes_are_those_of_trimesh_to_the_last_bit(ours: Any, theirs: trimesh.Trimesh) -> None:
    vertices, faces = ours
    assert np.array_equal(vertices, exact.settled(theirs.vertices)) and np.array_equal(faces, theirs.faces)
    assert vertices.dtype == np.float64 and faces.dtype == np.int64


def test_a_box_is_that_of_trimesh_to_the_last_bit() -> None:
    for low, high in (((0.0, 0.0, 0.0), (1.0, 2.0, 3.0)), ((-3.1, 17.77, 0.1), (12.345, 21.0, 9.3))):
        vertices, faces = box(low, high)
        theirs = trimesh.creation.box(bounds=(low, high))
        assert np.array_equal(vertices, theirs.vertices) and np.array_equal(faces, theirs.faces)


@pytest.mark.parametrize("place", ["highway", "roundabout", "town"])
def test_a_place_is_built_without_trimesh(place: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Its modules do not import it, see the test of light imports."""
    monkeypatch.setitem(sys.modules, "trimesh", None)
    for memory in (layout._post, scenery._cylinder, scenery._ball):
        memory.cache_clear()
    env = coopsim.parallel_env(place, lidar=None)
    env.reset(seed=1)
    assert len(env.static) > 0
