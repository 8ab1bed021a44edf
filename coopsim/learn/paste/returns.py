"""Returns of pasted actors on the rays of a sweep, and which of the sweep's own points they hide."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from coopsim.geometry.se3 import Floats
from coopsim.learn.clips.realism import realistic_lidar
from coopsim.learn.paste.rays import SweepRays
from coopsim.sensors.lidar.imperfections import look_in
from coopsim.sensors.lidar.lidar import LidarConfig
from coopsim.sensors.lidar.returns import reflect
from coopsim.sensors.scene import RayScene, Triangles
from coopsim.types import Ints, Mask
from coopsim.world.models.surfaces import GLASS_REFLECTIVITY

_MORE_LOST = 0.3  # most further share of lost returns: real vehicles return a third to a half of the rays over them
_STANDING_M = (0.3, 2.5)
_NEAR_M, _ENOUGH = 40.0, 100
_EVENLY = np.linspace(0.0, 1.0, 11)
# Deciles of the light that 396 pasted actors threw back: ten in each of 16 real sweeps, three times.
_LIGHT = np.array([0.0, 0.0387, 0.0636, 0.0886, 0.1212, 0.1577, 0.2033, 0.271, 0.3623, 0.4861, 1.0])


class Optics(NamedTuple):
    """Optics of a sweep's sensor, as drawn for pasted actors: see `LidarConfig` and `Imperfections`."""

    lidar: LidarConfig
    lost_share: float

    @classmethod
    def draw(cls, rng: np.random.Generator) -> Optics:
        """Draw optics as realistic clips have them, with more losses."""
        lidar = realistic_lidar(LidarConfig(), rng)
        assert lidar.imperfections is not None
        return cls(lidar, lidar.imperfections.lost_share + rng.uniform(0.0, _MORE_LOST))


@dataclass(frozen=True, slots=True, eq=False)
class PastedReturns:
    """K returns of actors on the rays of a sweep of N points.

    Attributes:
        points: (K, 3) in the base frame.
        light: (K,) share of their light that surfaces throw back, in [0, 1].
        instance: (K,) the actors' ids.
        hidden: (N,) points of the sweep that are behind an actor.
    """

    points: Floats
    light: Floats
    instance: Ints
    hidden: Mask


def cast(rays: SweepRays, points: int, triangles: Triangles, optics: Optics, rng: np.random.Generator) -> PastedReturns:
    """Cast the rays of a sweep of so many points against actors.

    What is nearer counts: a point before an actor hides the actor, and an actor hides the points behind it, also where
    its own return is lost.
    """
    scene = RayScene(triangles)
    hits = scene.cast(rays.origin_m, rays.directions)
    first = hits.range_m < rays.range_m
    face, toward = hits.face[first], rays.directions[first]
    flaws = optics.lidar.imperfections
    assert flaws is not None
    cosine = np.abs(np.einsum("ij,ij->i", scene.normals[face], toward)).astype(np.float32)
    range_m, light = hits.range_m[first], reflect(face, flaws.fall_off(cosine), triangles.reflectivity, 0.0)
    is_pane = triangles.reflectivity == GLASS_REFLECTIVITY
    look_in(range_m, light, face, is_pane, rng.random(len(light), np.float32), flaws.through)
    light *= np.exp(np.float32(flaws.speckle) * rng.standard_normal(len(light), np.float32))
    energy = light * (optics.lidar.reference_range_m / np.maximum(range_m, 1e-3)) ** 2
    kept = rng.standard_exponential(len(light)) * optics.lidar.dropout_energy <= energy
    kept &= rng.random(len(light)) >= optics.lost_share
    kept &= np.isfinite(range_m)
    reading_m = range_m[kept] + optics.lidar.range_noise_m * rng.standard_normal(int(kept.sum()))
    there = rays.origin_m + toward[kept] * reading_m[:, None]
    return PastedReturns(there, light[kept].clip(max=1.0), triangles.instance[face[kept]], first[:points])


def match_intensities(light: Floats, points: Floats, above_m: Floats) -> Floats:
    """Return intensities (K,) for returns of this light (K,), in the range of those of a sweep (N, 4).

    The intensity of a return has the rank among those of things that stand, 0.3 to 2.5 m over the ground and within 40
    m, that its light has among pasted actors: sensors scale intensities in ways that are not known.

    Args:
        light: (K,) share of the light that is thrown back.
        points: (N, 4) of the sweep: x, y, z m and intensity.
        above_m: (N,) their heights over the ground.
    """
    stands = (above_m > _STANDING_M[0]) & (above_m < _STANDING_M[1])
    stands &= np.hypot(points[:, 0], points[:, 1]) < _NEAR_M
    known = points[stands if stands.sum() >= _ENOUGH else slice(None), 3]
    if not len(known):
        return np.zeros(len(light))
    rank = np.interp(light, _LIGHT, _EVENLY)
    matched: Floats = np.quantile(known, rank)
    return matched
