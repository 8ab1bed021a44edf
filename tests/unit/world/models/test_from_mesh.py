"""A user's mesh becomes a model, as it is or scaled, from memory or a file; what cannot be one is refused."""

from __future__ import annotations

import warnings
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh

from coopsim.errors import DuplicateNameError, InvalidValueError
from coopsim.sensors.scene import SceneGeometry
from coopsim.support.registry import Registry
from coopsim.types.taxonomy import ObjectClass
from coopsim.world.models import catalogue, make_models, model_from_mesh, register_model
from coopsim.world.scenario import make_scenario
from coopsim.world.world import World

BOX = trimesh.creation.box((4.0, 2.0, 1.5))


@pytest.fixture
def _own(monkeypatch: pytest.MonkeyPatch) -> None:
    """Models that are registered in a test stay there."""
    monkeypatch.setattr(catalogue, "CUSTOM_MODELS", Registry("model"))


def with_changes(vertices: Any = None, faces: Any = None) -> trimesh.Trimesh:
    return trimesh.Trimesh(
        BOX.vertices if vertices is None else vertices, BOX.faces if faces is None else faces, process=False
    )


def test_a_mesh_keeps_its_size_and_comes_to_the_origin() -> None:
    moved = BOX.copy()
    moved.apply_translation((100.0, -3.0, 7.0))
    model = model_from_mesh(moved, "box", ObjectClass.VAN)
    np.testing.assert_allclose(model.size_m, [4.0, 2.0, 1.5])
    np.testing.assert_allclose(np.sort(model.vertices, axis=0), np.sort(BOX.vertices, axis=0), atol=1e-9)
    assert model.label == ObjectClass.VAN and model.poses.shape == (1, 8, 3)
    np.testing.assert_array_equal(moved.vertices.mean(axis=0), [100.0, -3.0, 7.0])  # the user's own is as it was


@pytest.mark.parametrize("ending", ["stl", "obj", "ply", "glb"])
def test_a_file_is_scaled_to_the_stated_size(ending: str, tmp_path: Path) -> None:
    ball = trimesh.creation.icosphere(subdivisions=2, radius=30.0)
    path = tmp_path / f"ball.{ending}"
    ball.export(path)
    with warnings.catch_warnings():
        warnings.simplefilter("error")  # its vertices are found to be the same, so it has no holes
        model = model_from_mesh(path, "ball", ObjectClass.CAR, [4.0, 1.8, 1.5], reflectivity=0.2)
    np.testing.assert_allclose(np.ptp(model.vertices, axis=0), [4.0, 1.8, 1.5], atol=1e-6)
    assert trimesh.Trimesh(model.vertices, model.faces).is_volume
    assert set(model.reflectivity) == {0.2} and set(model.tint) == {1.0}


def test_own_colours_show_where_there_is_no_paint() -> None:
    mesh = BOX.copy()
    mesh.visual.face_colors = np.tile([10, 200, 30, 255], (12, 1))
    model = model_from_mesh(mesh, "box", ObjectClass.CAR, tint=np.arange(12) % 2)
    assert (model.color == (10, 200, 30)).all()
    np.testing.assert_array_equal(model.tint, np.arange(12) % 2)
    assert (model_from_mesh(BOX, "box", ObjectClass.CAR).color < 40).all()


def test_bodies_that_are_inside_out_are_turned() -> None:
    inside_out = trimesh.creation.box((1.0, 1.0, 1.0))
    inside_out.invert()
    inside_out.apply_translation((9.0, 0.0, 0.0))
    model = model_from_mesh(trimesh.util.concatenate([BOX, inside_out]), "two", ObjectClass.TRUCK)
    bodies = trimesh.Trimesh(model.vertices, model.faces).split()
    assert len(bodies) == 2 and all(body.volume > 0 for body in bodies)


def test_holes_are_accepted_with_a_warning() -> None:
    message = r"of model 'open' has holes \(3 of 18 edges belong to one face only\)"
    with pytest.warns(UserWarning, match=message) as caught:
        model = model_from_mesh(with_changes(faces=BOX.faces[1:]), "open", ObjectClass.CAR)
    assert len(model.faces) == 11
    assert caught[0].filename == __file__


def nan_vertex() -> trimesh.Trimesh:
    vertices = BOX.vertices.copy()
    vertices[3, 1] = np.nan
    return with_changes(vertices)


def turned_face() -> trimesh.Trimesh:
    faces = np.array(BOX.faces)
    faces[0] = faces[0, ::-1]
    return with_changes(faces=faces)


@pytest.mark.parametrize(
    ("mesh", "arguments", "message"),
    [
        (nan_vertex(), {}, r"vertices of model 'mine' must be finite, got nan at index \(3, 1\)"),
        (with_changes(faces=np.zeros((0, 3), int)), {}, "the mesh of model 'mine' must have faces, got none"),
        (with_changes(faces=[[0, 1, 8]]), {}, "faces of model 'mine' must be of vertices 0 to 7, got 8"),
        (with_changes(faces=[[0, 1, -1]]), {}, "got -1"),
        (with_changes(BOX.vertices * [1, 1, 0]), {}, r"is flat: it measures \[4.0, 2.0, 0.0\] m"),
        (turned_face(), {}, "neighbours look different ways"),
        (BOX, {"size_m": [4.0, 0.0, 1.0]}, "width of model 'mine' must be a finite number > 0, got 0.0"),
        (BOX, {"size_m": [4.0, np.nan, 1.0]}, "width of model 'mine' must be a finite number > 0, got nan"),
        (BOX, {"size_m": [4.0, 1.0]}, r"size_m of model 'mine' must have shape \(3,\)"),
        (
            with_changes(BOX.vertices * 1000),
            {},
            "length of model 'mine' must be at most 100 m, got 4000: is it in other",
        ),
        (BOX, {"size_m": [4.0, 1e300, 1.0]}, "width of model 'mine' must be at most 100 m"),
        (with_changes(BOX.vertices * 1e200), {"size_m": [4.0, 2.0, 1.0]}, "vertices of model 'mine' must be within 1e"),
        (BOX, {"name": ""}, "name of a model must be a text, got ''"),
        (BOX, {"name": None}, "name of a model must be a text, got None"),
        (BOX, {"label": 12}, "must be an ObjectClass, 0 to 8, got 12"),
        (BOX, {"tint": 2.0}, r"tint of model 'mine' must be in \[0, 1\]"),
        (BOX, {"reflectivity": -0.1}, r"reflectivity of model 'mine' must be in \[0, 1\]"),
        (BOX, {"tint": [0.1, 0.2]}, "tint of model 'mine' must be one number or 12, got 2"),
        ("nowhere.stl", {}, "there is no file nowhere.stl"),
        (42, {}, "must be a trimesh.Trimesh or the path of a file, got 42"),
    ],
)
def test_what_cannot_be_a_model_is_refused(mesh: Any, arguments: dict[str, Any], message: str) -> None:
    with pytest.raises(InvalidValueError, match=message):
        model_from_mesh(mesh, **({"name": "mine", "label": ObjectClass.CAR} | arguments))


@pytest.mark.parametrize(("ending", "content"), [("stl", b"no mesh"), ("xyz7", b"of no known kind"), ("obj", b"v 1 2")])
def test_a_file_without_a_mesh_is_refused(ending: str, content: bytes, tmp_path: Path) -> None:
    path = tmp_path / f"broken.{ending}"
    path.write_bytes(content)
    with pytest.raises(InvalidValueError, match="of model 'mine'"):
        model_from_mesh(path, "mine", ObjectClass.CAR)


@pytest.mark.usefixtures("_own")
def test_worlds_choose_among_registered_models_too() -> None:
    robot = register_model(model_from_mesh(BOX, "delivery_robot", ObjectClass.CAR))
    assert make_models()[-1] is robot
    chosen = {
        world.models[k].name
        for world in (World(make_scenario("highway"), seed) for seed in range(3))
        for k in world.actors().model
    }
    assert "delivery_robot" in chosen and "sedan" in chosen
    world = World(make_scenario("crossing"), 0)
    SceneGeometry(world.models, world.static).triangles(world.actors())
    with pytest.raises(DuplicateNameError, match="'delivery_robot' is already registered"):
        register_model(robot)


def test_what_is_no_model_is_not_registered() -> None:
    with pytest.raises(InvalidValueError, match=r"^model must be a Model, .*, got 'robot'"):
        register_model("robot")  # type: ignore[arg-type]


@pytest.mark.usefixtures("_own")
def test_a_built_in_name_is_taken() -> None:
    with pytest.raises(DuplicateNameError, match="model 'sedan' is built in"):
        register_model(model_from_mesh(BOX, "sedan", ObjectClass.CAR))
