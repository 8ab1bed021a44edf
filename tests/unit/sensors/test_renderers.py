"""OpenGL and ray casting draw the same; one stands in for the other; what a renderer keeps never shows."""

from __future__ import annotations

import sys
import warnings
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from sensor_scenes import MODELS, actors, box_part, ground, make_rig

from coopsim.errors import MissingDependencyError, UnknownNameError
from coopsim.geometry.se3 import SE3
from coopsim.sensors.camera import CameraConfig, CameraRig
from coopsim.sensors.renderers import make_renderer
from coopsim.types import CameraImage
from coopsim.world.scenario import make_scenario
from coopsim.world.snapshot import Actors, AgentBody
from coopsim.world.world import World

STATIC = [ground(), box_part([20.0, 9.0, 3.0], (6.0, 6.0, 6.0), yaw_rad=0.4)]
BODIES = {
    "cav_0": AgentBody("cav_0", "cav", 1, SE3.from_xyz_yaw([0.0, 0.0, 0.0], 0.1), 1.6),
    "rsu_0": AgentBody("rsu_0", "rsu", None, SE3.from_xyz_yaw([-15.0, -15.0, 0.0], 0.8), 5.0),
}
SMALL = CameraConfig(width=160, height=90)
PLACES = [[0.0, 0.0, 0.1], [14.0, -2.0, 0.5], [9.0, 3.0, 1.0]]

Pictures = dict[str, dict[str, CameraImage]]


def assert_same(first: Pictures, second: Pictures) -> None:
    assert first.keys() == second.keys()
    for agent, cameras in first.items():
        for camera, image in cameras.items():
            np.testing.assert_array_equal(image.rgb, second[agent][camera].rgb, err_msg=f"{agent}, {camera}")
            np.testing.assert_array_equal(image.depth, second[agent][camera].depth, err_msg=f"{agent}, {camera}")


def stacked(pictures: Pictures) -> tuple[np.ndarray, np.ndarray]:
    images = [image for cameras in pictures.values() for image in cameras.values()]
    return np.stack([image.depth for image in images]), np.stack([image.rgb for image in images]).astype(int)


def test_opengl_and_ray_casting_agree_on_a_crossing() -> None:
    """They share nothing but the meshes: a matrix and a depth buffer here, rays there."""
    world = World(make_scenario("crossing"), seed=3)
    rigs = [make_rig(renderer, world.static, world.models) for renderer in ("opengl", "raycast")]
    (depth_gl, rgb_gl), (depth_ray, rgb_ray) = (stacked(rig.render(world.actors(), world.agents())) for rig in rigs)
    rigs[0].close()
    assert ((depth_gl > 0) == (depth_ray > 0)).mean() > 0.999
    both = (depth_gl > 0) & (depth_ray > 0)
    assert 0.3 < both.mean() < 1.0
    # Without asking whether both hit the same object, which only makes it harder.
    assert (np.abs(depth_gl - depth_ray)[both] <= 0.05).mean() >= 0.999
    assert (np.abs(rgb_gl - rgb_ray).max(axis=-1) <= 4).mean() > 0.95  # OpenGL smooths edges


@pytest.mark.parametrize("renderer", ["opengl", "raycast"])
def test_a_used_rig_draws_as_a_fresh_one(renderer: str) -> None:
    """Actors that move, come, go, and are others under the same id, as after a reset."""
    who = actors(PLACES, model=[0, 0, 1])
    frames: list[Actors] = [
        who,
        actors(np.array(PLACES) + 0.5, model=[0, 0, 1]),
        who[1:2],
        actors(PLACES, model=[0, 1, 0]),
        actors(PLACES, model=[0, 1, 0], color=(0, 0, 250)),
    ]
    used = make_rig(renderer, STATIC, config=SMALL)
    for frame in frames:
        fresh = make_rig(renderer, STATIC, config=SMALL)
        assert_same(used.render(frame, BODIES), fresh.render(frame, BODIES))
        fresh.close()  # which must leave the other one alone
    used.close()
    used.close()  # nothing more to release, and no error


@pytest.mark.parametrize("renderer", ["opengl", "raycast"])
def test_who_moves_is_drawn_in_the_pose_of_its_phase(renderer: str) -> None:
    """As what stands in that pose for ever; its mesh is that of the last frame's pose no more."""
    upright = MODELS[1]
    bent = upright.vertices * [1.0, 1.0, 0.5]
    poses = np.stack([upright.vertices, bent])
    rig = make_rig(renderer, STATIC, [MODELS[0], replace(upright, poses=poses)], SMALL)
    for phase, vertices in ((0.0, upright.vertices), (0.7, bent), (0.2, upright.vertices)):
        frozen = make_rig(renderer, STATIC, [MODELS[0], replace(upright, poses=np.stack([vertices, poses[0]]))], SMALL)
        who = actors(PLACES, model=[0, 0, 1])
        moving = replace(who, phase=np.array([0.0, 0.9, phase]))
        assert_same(rig.render(moving, BODIES), frozen.render(who, BODIES))
        frozen.close()
    rig.close()


@pytest.mark.parametrize("renderer", ["opengl", "raycast"])
def test_a_car_is_left_out_of_its_own_pictures_only(renderer: str) -> None:
    bodies = {
        name: AgentBody(name, "cav", actor, SE3.identity(), 1.6) for name, actor in {"driver": 1, "ghost": None}.items()
    }
    rig = make_rig(renderer, config=SMALL)
    images = rig.render(actors([[0.0, 0.0, 0.0], [12.0, 0.0, 0.0]]), bodies)
    rig.close()
    nearest_m = {name: cameras["front"].depth[cameras["front"].depth > 0].min() for name, cameras in images.items()}
    assert nearest_m["driver"] == pytest.approx(10.0, abs=0.01)  # the other car's rear
    assert nearest_m["ghost"] < 1.0  # the roof below the camera


def no_driver(width: int, height: int) -> None:
    raise RuntimeError("no EGL display")


ABSENT = {"package": None, "driver": SimpleNamespace(OffscreenRenderer=no_driver)}
"""What stands in for pyrender: nothing at all, or one that finds no OpenGL."""


@pytest.mark.parametrize("missing", ABSENT)
def test_without_opengl_cameras_are_ray_cast_with_one_warning(missing: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "pyrender", ABSENT[missing])  # type: ignore[arg-type]
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        rig = CameraRig(MODELS, STATIC)
        pictures = [rig.render(actors(PLACES), BODIES) for _ in range(2)]
    assert len(caught) == 1
    assert "pip install 'coopsim[camera]'" in str(caught[0].message) and "libegl1" in str(caught[0].message)
    assert caught[0].filename == __file__  # it points at who asked
    assert_same(pictures[1], make_rig("raycast", STATIC).render(actors(PLACES), BODIES))


@pytest.mark.parametrize("missing", ABSENT)
def test_opengl_that_was_asked_for_must_be_there(missing: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "pyrender", ABSENT[missing])  # type: ignore[arg-type]
    with pytest.raises(MissingDependencyError, match=r"pip install 'coopsim\[camera\]'.*libegl1") as raised:
        CameraRig(MODELS, STATIC, renderer="opengl")
    assert isinstance(raised.value.__cause__, ImportError if missing == "package" else RuntimeError)


def test_a_fault_of_ours_is_not_taken_for_a_missing_opengl() -> None:
    make_rig("opengl").close()  # OpenGL is there, or this skips
    broken: Any = SimpleNamespace(faces=None)
    with pytest.raises(AttributeError, match="vertices"):
        make_renderer("auto", MODELS, [broken], SMALL)


def test_an_unknown_renderer_is_refused() -> None:
    with pytest.raises(UnknownNameError, match="Did you mean 'raycast'"):
        CameraRig(MODELS, STATIC, renderer="raycasting")
