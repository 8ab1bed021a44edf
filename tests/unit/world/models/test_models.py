"""Shapes fill their boxes exactly, every surface looks outwards, and people walk without sliding."""

import numpy as np
import pytest
import trimesh
from representatives import all_of

from coopsim.errors import InvalidValueError
from coopsim.types.taxonomy import CLASS_NAMES, ObjectClass
from coopsim.world.models import make_models
from coopsim.world.models.model import Model
from coopsim.world.scenario import SCENARIOS, make_scenario

MODELS = make_models()
VARIED = make_models(varied=True)
MOVING = [model for model in MODELS if len(model.poses) > 1]
WALKERS = [model for model in MODELS if model.label in (ObjectClass.PEDESTRIAN, ObjectClass.CHILD)]
ONE_OF_A_KIND = ("sedan", "panel_van_doors_open", "concrete_mixer", "double_decker", "motorcycle_two_riders")
ONE_OF_A_KIND += ("cargo_bicycle", "motor_scooter_delivery", "woman_pushchair", "child_of_3")  # bits are held elsewhere
FLAT = {"ground", "pavement", "road", "marking"}

ANCHORS_M = {
    ObjectClass.CAR: (4.61, 1.95, 1.72),
    ObjectClass.VAN: (5.03, 1.87, 2.21),
    ObjectClass.TRUCK: (6.93, 2.51, 2.84),
    ObjectClass.BUS: (11.19, 2.94, 3.47),
    ObjectClass.MOTORCYCLE: (2.11, 0.77, 1.47),
    ObjectClass.BICYCLE: (1.68, 0.60, 1.27),
    ObjectClass.PEDESTRIAN: (0.73, 0.67, 1.77),
}
"""What detectors expect: means of labelled boxes in nuScenes, and in KITTI for vans."""


def by_name(model: Model) -> str:
    return model.name


@pytest.mark.parametrize("model", VARIED, ids=by_name)
def test_poses_fill_the_box_around_the_origin(model: Model) -> None:
    assert len(np.unique(model.faces)) == len(model.vertices)
    points = model.poses.reshape(-1, 3)
    np.testing.assert_allclose(points.max(axis=0), model.size_m / 2, rtol=0, atol=1e-9)
    np.testing.assert_allclose(points.min(axis=0), -model.size_m / 2, rtol=0, atol=1e-9)
    np.testing.assert_array_equal(model.vertices, model.poses[0])


@pytest.mark.parametrize("name", all_of([model.name for model in VARIED], *ONE_OF_A_KIND))
def test_every_part_is_closed_and_faces_outwards_in_every_pose(name: str) -> None:
    (model,) = (model for model in VARIED if model.name == name)
    for pose in model.poses:
        parts = trimesh.Trimesh(pose, model.faces, process=False).split(only_watertight=False)
        assert len(parts) > 4
        for part in parts:
            assert part.is_watertight and part.is_winding_consistent
            assert part.volume > 0  # negative where faces look inwards
            assert (part.area_faces > 1e-7).all()


@pytest.mark.parametrize("model", VARIED, ids=by_name)
def test_surfaces_have_a_share_of_paint_and_a_reflectivity(model: Model) -> None:
    assert len(np.unique(model.tint)) > 1 or model.stands  # a parked kick scooter is all plastic and metal
    assert len(np.unique(model.reflectivity)) > 3
    assert len(np.unique(model.color[model.tint < 1], axis=0)) >= 3


def test_every_class_has_three_models_or_more_of_few_triangles() -> None:
    labels, counts = np.unique([model.label for model in MODELS], return_counts=True)
    np.testing.assert_array_equal(labels, range(len(CLASS_NAMES)))
    assert (counts >= 3).all()
    assert len({model.name for model in MODELS}) == len(MODELS)
    assert max(len(model.faces) for model in MODELS) <= 410
    faces = {cls: np.mean([len(model.faces) for model in MODELS if model.label == cls]) for cls in ObjectClass}
    # 50 vehicles, of which 5 are trucks, and 20 people.
    assert 45 * faces[ObjectClass.CAR] + 5 * faces[ObjectClass.TRUCK] + 20 * faces[ObjectClass.PEDESTRIAN] < 15_000


@pytest.mark.parametrize("cls", ANCHORS_M, ids=lambda cls: cls.title)
def test_sizes_are_those_that_detectors_expect(cls: ObjectClass) -> None:
    sizes = np.array([model.size_m for model in MODELS if model.label == cls])
    assert len(np.unique(sizes, axis=0)) == len(sizes)
    ratio = sizes.mean(axis=0) / ANCHORS_M[cls]
    assert (ratio > 0.66).all() and (ratio < 1.4).all()


@pytest.mark.parametrize("model", MOVING, ids=by_name)
def test_who_moves_stands_on_the_ground_in_every_pose(model: Model) -> None:
    low, high = model.poses[..., 2].min(axis=1), model.poses[..., 2].max(axis=1)
    np.testing.assert_allclose(low, -model.size_m[2] / 2, rtol=0, atol=1e-9)
    assert (high > 0.48 * model.size_m[2]).all()
    assert (np.abs(np.diff(model.poses, axis=0)).max(axis=(1, 2)) > 0.02).all()


@pytest.mark.parametrize("model", WALKERS, ids=by_name)
def test_half_a_cycle_later_left_and_right_are_exchanged(model: Model) -> None:
    half = len(model.poses) // 2
    for k in range(half):
        before, after = model.poses[k], model.poses[k + half] * [1, -1, 1]
        np.testing.assert_allclose(before.mean(axis=0), after.mean(axis=0), atol=2e-3)
        np.testing.assert_allclose(np.ptp(before, axis=0), np.ptp(after, axis=0), atol=2e-3)


@pytest.mark.parametrize("model", WALKERS, ids=by_name)
def test_a_foot_on_the_ground_stays_where_it_is(model: Model) -> None:
    """While the body goes on by a share of the cycle, the lowest foot goes back by as much."""
    steps = np.diff(np.concatenate([model.poses, model.poses[:1]]), axis=0)
    slips = []
    for pose, step in zip(model.poses, steps, strict=True):
        sole = pose[:, 2] < pose[:, 2].min() + 0.015 * model.size_m[2]
        slips.append(step[sole, 0].mean() + model.cycle_m / len(model.poses))
    assert np.abs(np.mean(slips)) < 0.25 * model.cycle_m / len(model.poses)


def box(**changes: object) -> Model:
    mesh = trimesh.creation.box((4.0, 2.0, 1.5))
    arguments: dict[str, object] = {
        "name": "box",
        "label": ObjectClass.CAR,
        "size_m": np.array([4.0, 2.0, 1.5]),
        "vertices": np.array(mesh.vertices),
        "faces": np.array(mesh.faces),
        "tint": np.ones(12),
        "reflectivity": np.ones(12),
    }
    return Model(**(arguments | changes))  # type: ignore[arg-type]


HALF = 0.5 * np.array(trimesh.creation.box((4.0, 2.0, 1.5)).vertices)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"label": 9}, "label of model 'box' must be an ObjectClass, 0 to 8, got 9"),
        ({"size_m": [4.0, 2.0]}, r"size_m of model 'box' must have shape \(3,\), got \(2,\)"),
        ({"size_m": [0.0, 2.0, 1.5]}, "length of model 'box' must be a finite number > 0, got 0.0"),
        ({"vertices": np.full((8, 3), np.nan)}, "vertices of model 'box' must be finite, got nan at index"),
        ({"vertices": HALF}, r"must fill the box size_m = \[4.0, 2.0, 1.5\]"),
        ({"faces": np.full((12, 3), 8)}, r"faces of model 'box' must be in 0..7, as there are 8 vertices, got 8"),
        ({"faces": np.full((12, 3), -1)}, "got -1"),
        ({"faces": np.zeros((0, 3), int), "tint": [], "reflectivity": []}, "must be at least one, got none"),
        ({"tint": np.full(12, 1.5)}, r"tint of model 'box' must be in \[0, 1\], got 1.5"),
        ({"reflectivity": np.full(12, np.nan)}, "reflectivity of model 'box'"),
        ({"reflectivity": np.ones(3)}, r"reflectivity of model 'box' must have shape \(12,\)"),
        ({"poses": HALF[None]}, "must fill the box"),
        ({"poses": np.zeros((4, 7, 3))}, r"poses of model 'box' must have shape \(N, 8, 3\)"),
        ({"cycle_m": 0.0}, "cycle_m of model 'box' must be a finite number > 0"),
    ],
)
def test_a_model_that_is_none_is_refused(changes: dict[str, object], message: str) -> None:
    with pytest.raises(InvalidValueError, match=message):
        box(**changes)


@pytest.mark.parametrize("name", SCENARIOS.names())
def test_scenery_faces_outwards(name: str) -> None:
    parts = make_scenario(name).layout.static
    assert parts
    for part in parts:
        mesh = trimesh.Trimesh(part.vertices, part.faces, process=False)
        if part.name in FLAT:
            assert (mesh.face_normals[:, 2] > 0.999).all(), part.name
        else:
            assert mesh.is_watertight and mesh.volume > 0, part.name
