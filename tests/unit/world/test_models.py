"""Shapes fill their boxes exactly, and every surface looks outwards."""

import numpy as np
import pytest
import trimesh

from coopsim.taxonomy import ObjectClass
from coopsim.world.models import make_models
from coopsim.world.scenario import SCENARIOS, make_scenario
from coopsim.world.snapshot import Model

MODELS = make_models()
FLAT = {"ground", "pavement", "road", "marking"}


@pytest.mark.parametrize("model", MODELS, ids=lambda model: model.name)
def test_box_is_tight_and_in_the_middle(model: Model) -> None:
    used = model.vertices[np.unique(model.faces)]
    np.testing.assert_allclose(used.max(axis=0), model.size_m / 2, rtol=0, atol=1e-9)
    np.testing.assert_allclose(used.min(axis=0), -model.size_m / 2, rtol=0, atol=1e-9)


@pytest.mark.parametrize("model", MODELS, ids=lambda model: model.name)
def test_every_part_of_a_model_is_closed_and_faces_outwards(model: Model) -> None:
    parts = trimesh.Trimesh(model.vertices, model.faces, process=False).split(only_watertight=False)
    assert len(parts) > 4
    for part in parts:
        assert part.is_watertight and part.is_winding_consistent
        assert part.volume > 0  # negative where faces look inwards


@pytest.mark.parametrize("model", MODELS, ids=lambda model: model.name)
def test_surfaces_have_a_share_of_paint_and_a_reflectivity(model: Model) -> None:
    for surface in (model.tint, model.reflectivity):
        assert surface.shape == (len(model.faces),)
        assert (surface >= 0).all() and (surface <= 1).all()
        assert len(np.unique(surface)) > 1


def test_sizes_differ_by_class() -> None:
    sizes = {label: [model.size_m for model in MODELS if model.label == label] for label in ObjectClass}
    cars, trucks, people = (
        np.array(sizes[label]) for label in (ObjectClass.CAR, ObjectClass.TRUCK, ObjectClass.PEDESTRIAN)
    )
    assert len(np.unique(cars, axis=0)) == len(cars) >= 3
    assert len(np.unique(trucks, axis=0)) == len(trucks) >= 2
    assert (trucks.min(axis=0) > cars.max(axis=0)).all()
    assert (people[:, :2] < 1).all() and (people[:, 2] > 1.5).all()


@pytest.mark.parametrize("name", SCENARIOS.names())
def test_scenery_faces_outwards(name: str) -> None:
    for part in make_scenario(name).layout.static:
        mesh = trimesh.Trimesh(part.vertices, part.faces, process=False)
        if part.name in FLAT:
            assert (mesh.face_normals[:, 2] > 0.999).all(), part.name
        else:
            assert mesh.is_watertight and mesh.volume > 0, part.name
