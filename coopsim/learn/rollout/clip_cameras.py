"""The cameras of a clip's agents, drawn from a recipe."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from coopsim.learn.rollout.recipe_draws import between, one_of
from coopsim.learn.rollout.world_recipe import WorldRecipe
from coopsim.sensors.camera.camera import Camera
from coopsim.sensors.camera.distortion import Coefficients, distort
from coopsim.sensors.camera.intrinsics import Intrinsics
from coopsim.sensors.camera.rigs import Rig, rig

_KINDS = ("cav", "rsu", "drone")
# Distortion of wide-angle lenses, from almost none to barrels whose straight lines are clearly bent. With k2 of at
# least 0.6 k1^2, the radius in the picture rises everywhere at a quarter of a pinhole's rate or more: no lens folds
# its picture over (it would below 0.45 k1^2).
_K1, _K2_MOST, _K2_LEAST_OF_K1_SQUARED, _P = (-0.25, -0.05), 0.05, 0.6, (-0.002, 0.002)


class _Mount(NamedTuple):
    """One camera's lens, and how it differs from a named rig's."""

    lens: Intrinsics
    turn_rad: float
    pitch_rad: float
    above_m: float


def draw_cameras(recipe: WorldRecipe, rng: Callable[[str], np.random.Generator]) -> dict[str, Rig]:
    """Draw the cameras of the agents of each kind; there are none for a recipe without cameras.

    All agents of a kind carry the same, and those of another kind the same with the pitch of their kind.

    Args:
        recipe: what to draw from.
        rng: returns the random stream of a purpose.
    """
    if not recipe.cameras:
        return {}
    name = one_of(recipe.cameras, rng("cameras"))
    distorts = rng("distortion").random() < recipe.distorted_share
    mounts = {camera.name: _mount(camera.name, recipe, rng, distorts) for camera in rig(name)}
    return {kind: tuple(_mounted(camera, mounts[camera.name]) for camera in rig(name, kind)) for kind in _KINDS}


def _mount(name: str, recipe: WorldRecipe, rng: Callable[[str], np.random.Generator], distorts: bool) -> _Mount:
    fov_rad = float(np.radians(between(recipe.camera_fov_deg, rng(f"opening of {name}"))))
    if distorts:
        coefficients = _distortion(rng(f"lens of {name}"))
        edge = distort(np.array([[np.tan(fov_rad / 2), 0.0]]), coefficients)[0, 0]
        # Of the pinhole whose picture reaches as far as this lens's: the camera sees as wide an angle as was drawn.
        lens = Intrinsics.from_fov(horizontal_fov_rad=2 * float(np.arctan(edge)), distortion=coefficients)
    else:
        lens = Intrinsics.from_fov(horizontal_fov_rad=fov_rad)
    return _Mount(
        lens,
        turn_rad=float(np.radians(between(recipe.camera_turn_deg, rng(f"turn of {name}")))),
        pitch_rad=float(np.radians(between(recipe.camera_pitch_deg, rng(f"pitch of {name}")))),
        above_m=between(recipe.camera_above_m, rng(f"height of {name}")),
    )


def _distortion(rng: np.random.Generator) -> Coefficients:
    k1 = between(_K1, rng)
    k2 = between((_K2_LEAST_OF_K1_SQUARED * k1**2, _K2_MOST), rng)
    return (k1, k2, between(_P, rng), between(_P, rng), 0.0)


def _mounted(camera: Camera, mount: _Mount) -> Camera:
    return replace(
        camera,
        intrinsics=mount.lens,
        yaw_rad=camera.yaw_rad + mount.turn_rad,
        pitch_rad=camera.pitch_rad + mount.pitch_rad,
        above_m=mount.above_m,
    )
