"""OpenGL and ray casting see the same; one stands in for the other; what any renderer keeps never shows."""

from __future__ import annotations

import gc
import sys
import warnings
from dataclasses import fields, replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import psutil
import pytest
from sensor_scenes import AGENTS, MODELS, Studio, actors, box_part, ground

from coopsim.errors import MissingDependencyError, UnknownNameError
from coopsim.geometry.se3 import SE3
from coopsim.sensors.camera.camera import agent_rigs, named_rig
from coopsim.sensors.camera.intrinsics import Intrinsics
from coopsim.sensors.camera.picture import MODES, CameraRig
from coopsim.sensors.camera.renderers import make_renderer
from coopsim.types import CameraImage
from coopsim.world.scenario import make_scenario
from coopsim.world.snapshot import Actors, AgentBody
from coopsim.world.world import World

STATIC = [ground(), box_part([20.0, 9.0, 3.0], (6.0, 6.0, 6.0), yaw_rad=0.4)]
BODIES = {
    "cav_0": AgentBody("cav_0", "cav", 1, SE3.from_xyz_yaw([0.0, 0.0, 0.0], 0.1), 1.6),
    "rsu_0": AgentBody("rsu_0", "rsu", None, SE3.from_xyz_yaw([-15.0, -15.0, 0.0], 0.8), 5.0),
}
PLACES = [[0.0, 0.0, 0.1], [14.0, -2.0, 0.5], [9.0, 3.0, 1.0]]

Pictures = dict[str, dict[str, CameraImage]]


def small(lens: Intrinsics | None = None) -> dict[str, Any]:
    lens = lens or Intrinsics.from_fov(160, 90)
    rig = tuple(replace(camera, intrinsics=lens) for camera in named_rig("surround"))
    return dict.fromkeys(AGENTS, rig)


def assert_same(first: Pictures, second: Pictures) -> None:
    assert first.keys() == second.keys()
    for agent, cameras in first.items():
        for camera, image in cameras.items():
            for mode in MODES:
                pair = getattr(image, mode), getattr(second[agent][camera], mode)
                np.testing.assert_array_equal(*pair, err_msg=f"{agent}, {camera}, {mode}")


def stacked(pictures: Pictures) -> dict[str, np.ndarray]:
    images = [image for cameras in pictures.values() for image in cameras.values()]
    return {mode: np.stack([getattr(image, mode) for image in images]) for mode in MODES}


DISTORTED = {"barrel": (-0.25, 0.08, 0.001, -0.002, 0.0), "pincushion": (0.2, -0.05, 0.002, 0.003, 0.01)}
LEAST_SAME = {"pinhole": (0.999, 0.999), "barrel": (0.99, 0.995), "pincushion": (0.99, 0.995)}
"""Shares of pixels whose depth is within 5 cm, and whose instance and class are the same. Behind a lens that distorts,
OpenGL looks up a finer pinhole's picture, which may miss an edge by a quarter of a pixel."""


@pytest.mark.parametrize("place", ["crossing", "highway"])
@pytest.mark.parametrize("lens", LEAST_SAME)
def test_opengl_and_ray_casting_agree(place: str, lens: str) -> None:
    """They share nothing but the meshes and the paint: a matrix and a depth buffer here, rays there."""
    world = World(make_scenario(place), seed=3)
    bodies = world.agents()
    intrinsics = Intrinsics.from_fov(distortion=DISTORTED.get(lens, (0.0,) * 5))
    named = agent_rigs("surround", {name: body.kind for name, body in bodies.items()})
    rigs = {name: [replace(camera, intrinsics=intrinsics) for camera in rig] for name, rig in named.items()}
    studios = [Studio(renderer, world.static, world.models, rigs, modes=MODES) for renderer in ("opengl", "raycast")]
    gl, ray = (stacked(studio.shoot(world.actors(), bodies)) for studio in studios)
    studios[0].rig.close()
    least_depth, least_labels = LEAST_SAME[lens]
    assert 0.3 < (ray["depth"] > 0).mean() < 1.0
    assert len(np.unique(ray["instance"])) > 5 and len(np.unique(ray["semantic"])) > 2
    # In all pixels, also where only one of them sees anything.
    assert (np.abs(gl["depth"] - ray["depth"]) <= 0.05).mean() >= least_depth
    assert (gl["instance"] == ray["instance"]).mean() >= least_labels
    assert (gl["semantic"] == ray["semantic"]).mean() >= least_labels
    moving = ray["instance"] > 0  # alone: the ground and the sky agree too easily
    assert (gl["instance"] == ray["instance"])[moving].mean() >= (0.99 if lens == "pinhole" else 0.94)
    off = np.abs(gl["rgb"].astype(int) - ray["rgb"]).max(axis=-1)
    assert (off <= 4).mean() >= least_depth - 0.005


@pytest.mark.parametrize("renderer", ["opengl", "raycast", "pyrender"])
def test_a_used_rig_draws_as_a_fresh_one(renderer: str) -> None:
    """Actors that move, come, go, and are others under the same id, as after a reset."""
    who = actors(PLACES, model=[0, 0, 1])
    frames: list[Actors] = [
        who,
        actors(np.array(PLACES) + 0.5, model=[0, 0, 1]),
        who[1:2],
        actors(PLACES, model=[0, 1, 0]),
        actors(PLACES, model=[0, 1, 0], color=(0, 0, 250)),
        actors([]),
    ]
    used = Studio(renderer, STATIC, cameras=small(), modes=MODES)
    for frame in frames:
        fresh = Studio(renderer, STATIC, cameras=small(), modes=MODES)
        assert_same(used.shoot(frame, BODIES), fresh.shoot(frame, BODIES))
        fresh.rig.close()  # which must leave the other one alone
    used.rig.close()
    used.rig.close()  # nothing more to release, and no error


@pytest.mark.parametrize("renderer", ["opengl", "raycast", "pyrender"])
def test_who_moves_is_drawn_in_the_pose_of_its_phase(renderer: str) -> None:
    """As what stands in that pose for ever; its mesh is that of the last frame's pose no more."""
    upright = MODELS[1]
    bent = upright.vertices * [1.0, 1.0, 0.5]
    walker = replace(upright, poses=np.stack([upright.vertices, bent]))
    studio = Studio(renderer, STATIC, [MODELS[0], walker], small(), modes=MODES)
    for phase, vertices in ((0.0, upright.vertices), (0.7, bent), (0.2, upright.vertices)):
        stander = replace(upright, poses=np.stack([vertices, walker.poses[0]]))
        frozen = Studio(renderer, STATIC, [MODELS[0], stander], small(), modes=MODES)
        who = actors(PLACES, model=[0, 0, 1])
        moving = replace(who, phase=np.array([0.0, 0.9, phase]))
        assert_same(studio.shoot(moving, BODIES), frozen.shoot(who, BODIES))
        frozen.rig.close()
    studio.rig.close()


@pytest.mark.parametrize("renderer", ["opengl", "raycast", "pyrender"])
def test_a_car_is_left_out_of_its_own_pictures_only(renderer: str) -> None:
    bodies = {
        name: AgentBody(name, "cav", actor, SE3.identity(), 1.6) for name, actor in {"driver": 2, "ghost": None}.items()
    }
    who = actors([[12.0, 0.0, 0.0], [0.0, 0.0, 0.0], [-12.0, 0.0, 0.0]])  # the driver's faces lie between others'
    studio = Studio(renderer, cameras=small(), modes=MODES)
    images = studio.shoot(who, bodies)
    studio.rig.close()
    assert set(np.unique(images["driver"]["front"].instance)) == {0, 1}
    assert set(np.unique(images["driver"]["rear"].instance)) == {0, 3}
    assert set(np.unique(images["ghost"]["front"].instance)) == {0, 1, 2}


@pytest.mark.parametrize("renderer", ["opengl", "raycast", "pyrender"])
def test_far_from_the_origin_pictures_are_as_sharp(renderer: str) -> None:
    """A kilometre is coarse in float32: both measure from the scene's middle."""
    pictures = []
    for far_m in (0.0, 5000.0):
        shift = np.array([far_m, far_m, 0.0])
        body = AgentBody("cav_0", "cav", None, SE3.from_xyz_yaw(shift, 0.3), 1.6)
        studio = Studio(renderer, cameras=small())
        pictures.append(studio.shoot(actors(np.array(PLACES) + shift, model=1), {"cav_0": body})["cav_0"]["front"])
        studio.rig.close()
    near, far = (picture.depth for picture in pictures)
    assert (near > 0).any() and (np.abs(near - far) <= 0.01).mean() > 0.999


@pytest.mark.parametrize("renderer", ["opengl", "raycast", "pyrender"])
def test_many_frames_take_no_more_memory(renderer: str) -> None:
    """Actors come and go, so that buffers are made anew in every second frame."""
    studio = Studio(renderer, STATIC, cameras=small(), modes=MODES)
    frames = [actors(PLACES), actors(PLACES, first_id=7), actors(PLACES[:2])]
    used = []
    for count in (10, 30):
        for k in range(count):
            studio.shoot(frames[k % 3], BODIES)
        gc.collect()
        used.append(psutil.Process().memory_info().rss)
    studio.rig.close()
    assert used[1] - used[0] < 20e6  # a leaked picture of all modes is 0.2 MB, and these are 240


def no_driver(*arguments: Any, **options: Any) -> None:
    raise RuntimeError("no EGL display")


ABSENT = {"package": None, "driver": SimpleNamespace(create_context=no_driver)}
"""What stands in for moderngl: nothing at all, or one that finds no OpenGL."""


@pytest.mark.parametrize("missing", ABSENT)
def test_without_opengl_cameras_are_ray_cast_with_one_warning(missing: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "moderngl", ABSENT[missing])  # type: ignore[arg-type]
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        studio = Studio("auto", STATIC, cameras=small())
        pictures = [studio.shoot(actors(PLACES), BODIES) for _ in range(2)]
    assert len(caught) == 1
    assert "pip install 'coopsim[camera]'" in str(caught[0].message) and "libegl1" in str(caught[0].message)
    assert studio.rig.renderer == "raycast"
    assert_same(pictures[1], Studio("raycast", STATIC, cameras=small()).shoot(actors(PLACES), BODIES))


@pytest.mark.parametrize("missing", ABSENT)
def test_opengl_that_was_asked_for_must_be_there(missing: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "moderngl", ABSENT[missing])  # type: ignore[arg-type]
    with pytest.raises(MissingDependencyError, match=r"pip install 'coopsim\[camera\]'.*libegl1") as raised:
        make_renderer("opengl")
    assert isinstance(raised.value.__cause__, ImportError if missing == "package" else RuntimeError)


def test_auto_is_opengl_where_it_works() -> None:
    Studio("opengl").rig.close()  # OpenGL is there, or this skips
    rig = Studio("auto").rig
    assert rig.renderer == "opengl"
    rig.close()


def test_an_unknown_renderer_is_refused() -> None:
    with pytest.raises(UnknownNameError, match="Did you mean 'raycast'"):
        make_renderer("raycasting")


def test_modes_that_are_not_asked_for_are_not_drawn() -> None:
    for mode in MODES:
        image = Studio("raycast", STATIC, cameras=small(), modes=[mode]).shoot(actors(PLACES), BODIES)["cav_0"]["left"]
        assert {field.name: getattr(image, field.name) is not None for field in fields(image)} == {
            name: name == mode for name in MODES
        }


@pytest.mark.parametrize("bad", ["rgb", [], ["rgb", "rgb"], None, 3, ["rbg"]])
def test_modes_that_are_none_are_refused(bad: Any) -> None:
    with pytest.raises((ValueError, LookupError), match="camera_modes"):
        CameraRig({}, make_renderer("raycast"), modes=bad)
