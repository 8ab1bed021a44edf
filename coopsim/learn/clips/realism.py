"""Unknowns of real sweeps, drawn for a clip: how its LiDAR is built and mounted, the ground, and the sizes of things.

Towns are flat and their models come in tens of sizes. Ground and sizes are changed where a clip is sensed; traffic,
occupancy and what hides what on slopes stay those of the flat town.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from coopsim.geometry.boxes import Boxes3D
from coopsim.geometry.se3 import Floats
from coopsim.sensors.lidar.imperfections import Imperfections
from coopsim.sensors.lidar.lidar import LidarConfig
from coopsim.sensors.scene import Singles, Triangles
from coopsim.support.kernels import njit
from coopsim.support.rng import stream, uniform_numbers
from coopsim.types import Ints, Mask
from coopsim.types.taxonomy import ObjectClass
from coopsim.world.models.surfaces import GLASS_REFLECTIVITY
from coopsim.world.snapshot import Actors

# Firings per revolution: HDL-64E at 10 Hz, 0.1728 degrees apart (Geiger et al., IJRR 2013); HDL-32E at 20 Hz
# as in nuScenes (Caesar et al., CVPR 2020), and at 10 Hz; VLP-32C at 10 Hz, 0.2 degrees apart (its manual).
_COLUMNS = {"HDL-64E": (2083,), "HDL-32E": (1084, 2169), "VLP-32C": (1800,), "2x VLP-32C": (1800,)}
_SECOND_UNIT = {"2x VLP-32C": 32}
# KITTI's is 1.73 m and nuScenes' 1.84 m above ground, both on cars of about 1.5 m; Argoverse 2's two at about 2 m.
_ABOVE_M, _AHEAD_M = (0.15, 0.6), (-0.8, 0.5)
# HDL-64E's manual: asphalt of albedo 0.1 is seen at 50 m, so at a cosine of 1.73 / 50: that half of these returns are
# lost takes an energy of 0.005. The default of `LidarConfig` is 0.02. Units age and windows get dirty.
_DROPOUT_ENERGY = (0.002, 0.015)
_NEAREST_M, _FARTHEST_M = (0.9, 2.5), (80.0, 130.0)  # KITTI's sweeps end at 80 m
_EDGE_RAD = (0.001, 0.003)  # HDL-64E's manual: 2 mrad; HDL-32E's: 3 mrad
# The rest is assumed by us, wide enough that KITTI's and one of Argoverse's sweeps are within (docs/results/sweeps.md):
# calibrations and suspensions by some tenths of a degree, beams by up to 0.1 degree, scales of intensity, rough to
# glossy surfaces, panes from dirty to clean.
_TILT_RAD, _UP_M, _BEAM_RAD = math.radians(0.6), 0.04, (0.0, 0.0015)
_FALLOFF, _LOST, _SPECKLE, _THROUGH = (0.0, 1.5), (0.0, 0.05), (0.1, 0.6), (0.3, 1.0)
_GAIN, _GAMMA = (0.25, 1.5), (0.4, 1.3)
# Clear coats mirror light away: a car in KITTI or Argoverse is darker than asphalt, a matt one of these colours is not.
_GLOSS = (0.1, 1.0)
_UNCORRECTED = 0.05

# Unevenness by ISO 8608: spectral density of heights at 0.1 cycles a metre, of roads of classes A to D, falling by the
# square of the frequency. Grades: the AASHTO Green Book lets streets rise by 5 % and more.
_ROUGHNESS_M3, _DENSITY_AT_PER_M = (16e-6, 1024e-6), 0.1
_ROUGH_PER_M = (0.02, 0.4)
_GRADE, _HILL_M = (0.0, 0.05), (50.0, 400.0)
_HILLS, _BUMPS = 2, 8
_PERIOD_M, _CELLS = 512.0, 1024

# Means of labelled cars are 3.9 x 1.6 x 1.56 m in KITTI and 4.63 x 1.97 x 1.74 m in nuScenes (anchors of PointPillars
# and of OpenPCDet), of pedestrians 0.8 x 0.6 x 1.73 m and 0.73 x 0.67 x 1.77 m: towns have nuScenes' cars.
_MARKET, _MARKET_SPREAD = (0.84, 1.04), 0.03
_SLACK_M = (0.0, 0.2)  # labels have mirrors in, 0.2 m on either side, and room; models' boxes are tight and without
_OF_MARKET = (ObjectClass.CAR, ObjectClass.VAN)
# Breadths of shoulders alone differ by a tenth among adults (ANSUR II, 2012), and coats and bags add to them;
# heights of the models differ already.
_ON_FOOT, _EACH_PERSON, _EACH_OTHER = (
    (ObjectClass.PEDESTRIAN, ObjectClass.CHILD),
    (0.25, 0.25, 0.06),
    (0.05, 0.04, 0.05),
)


class Ground:
    """Smooth field of heights over the plane: a sum of waves that repeats every 512 m, read from a table.

    Args:
        turns: (K, 2) integers, cycles of each wave in 512 m along x and y.
        phase: (K,) rad.
        height_m: (K,) amplitudes.
    """

    def __init__(self, turns: Ints, phase: Floats, height_m: Floats) -> None:
        at = np.arange(_CELLS) * (2 * np.pi / _CELLS)
        along_x, along_y = (np.exp(1j * turns[:, axis, None] * at) for axis in range(2))
        waves = (height_m * np.exp(1j * phase))[:, None] * along_x
        self._table = np.ascontiguousarray((waves.T @ along_y).imag, dtype=np.float32)

    def heights(self, xy_m: Floats) -> Floats:
        """Return the heights (N,) m of the ground at places (N, 2) m."""
        return _heights(self._table, np.ascontiguousarray(xy_m, dtype=np.float64), _CELLS / _PERIOD_M)


@dataclass(frozen=True, slots=True)
class Realism:
    """Ground and sizes of one clip.

    Attributes:
        ground: heights of the ground.
        seed: seed of the actors' own sizes.
        market: mean length, width and height of vehicles, as shares of the models'.
        slack_m: length and width by which vehicles' boxes are larger than they.
        gloss: mean share of its light that paint throws back, of what matt paint of its colour would.
    """

    ground: Ground
    seed: int
    market: tuple[float, float, float]
    slack_m: tuple[float, float]
    gloss: float

    def sized(self, actors: Actors, kept: Mask) -> tuple[Actors, Floats]:
        """Return actors of other sizes, and the factors (N, 3) on their models; those with `kept` (N,) stay the same.

        An actor keeps its factors in all frames, and stands on the ground of the flat town.
        """
        of_market, on_foot = (np.isin(actors.label, kinds)[:, None] for kinds in (_OF_MARKET, _ON_FOOT))
        spread = 2 * uniform_numbers(self.seed, "sizes", actors.id, 3) - 1
        scale = np.where(of_market, self.market, 1.0) * (1 + spread * np.where(on_foot, _EACH_PERSON, _EACH_OTHER))
        scale[kept] = 1.0
        boxes = actors.boxes
        center = boxes.center.copy()
        center[:, 2] += boxes.size[:, 2] / 2 * (scale[:, 2] - 1)
        size = boxes.size * scale
        size[:, :2] += np.where(on_foot, 0.0, self.slack_m)
        sized = Boxes3D.trusted(center, size, boxes.yaw)
        return actors.moved(np.arange(len(actors)), sized, actors.velocity), scale

    def painted(self, triangles: Triangles, actors: Actors) -> Triangles:
        """Return triangles in which the paint of vehicles throws less light back; panes and plates stay the same."""
        assert triangles.parts is not None  # of which those of actors are last
        own = uniform_numbers(self.seed, "paint", actors.id, 1)[:, 0]
        each = np.where(np.isin(actors.label, _ON_FOOT), 1.0, np.minimum(self.gloss * 4.0 ** (own - 0.5), 1.0))
        faces = np.diff(triangles.parts.face_start)
        factor = np.repeat(np.concatenate([np.ones(len(faces) - len(each)), each]), faces)
        matt = triangles.reflectivity
        plain = (matt != GLASS_REFLECTIVITY) & (matt <= 1.0)
        return replace(triangles, reflectivity=np.where(plain, matt * factor, matt))


def draw_realism(seed: int, index: int, grade: float | None = None, roughness_m3: float | None = None) -> Realism:
    """Draw ground and sizes of a clip; of its ground's steepest grade and roughness, those that are None."""
    rng = stream(seed, "ground and sizes", "clip", str(index))
    market = rng.uniform(*_MARKET)
    each = tuple((market + rng.uniform(-_MARKET_SPREAD, _MARKET_SPREAD, 3)).tolist())
    slack = rng.uniform(*_SLACK_M, 2).tolist()
    ground, own = _draw_ground(rng, grade, roughness_m3), int(rng.integers(2**62))
    return Realism(ground, own, (each[0], each[1], each[2]), (slack[0], slack[1]), rng.uniform(*_GLOSS))


def _draw_ground(rng: np.random.Generator, grade: float | None, roughness_m3: float | None) -> Ground:
    """Draw hills, whose grade is at most that drawn, and bumps by the spectrum of ISO 8608."""
    edges = np.geomspace(*_ROUGH_PER_M, _BUMPS + 1)
    per_m = np.concatenate([1 / rng.uniform(*_HILL_M, _HILLS), np.sqrt(edges[:-1] * edges[1:])])
    away = 2 * np.pi * rng.random(_HILLS + _BUMPS)
    turns = np.rint(_PERIOD_M * per_m[:, None] * np.column_stack([np.cos(away), np.sin(away)])).astype(np.int64)
    usual = rng.uniform(*_GRADE), math.exp(rng.uniform(*np.log(_ROUGHNESS_M3)))
    grade, roughness_m3 = (
        own if given is None else given for own, given in zip(usual, (grade, roughness_m3), strict=True)
    )
    hills = grade / _HILLS / (2 * np.pi * per_m[:_HILLS])
    density = roughness_m3 * (per_m[_HILLS:] / _DENSITY_AT_PER_M) ** -2
    bumps = np.sqrt(2 * density * np.diff(edges))
    return Ground(turns, 2 * np.pi * rng.random(len(turns)), np.concatenate([hills, bumps]))


@njit(cache=True, nogil=True)
def _heights(table: Singles, xy: Floats, per_m: float) -> Floats:
    """Interpolate a table (C, C) that repeats, with `per_m` entries a metre, at places (N, 2) m."""
    heights, size = np.empty(len(xy)), len(table)
    for n in range(len(xy)):
        x, y = xy[n, 0] * per_m, xy[n, 1] * per_m
        i, j = math.floor(x), math.floor(y)
        u, v = x - i, y - j
        i, j = i % size, j % size
        k, m = (i + 1) % size, (j + 1) % size
        low = table[i, j] * (1 - u) + table[k, j] * u
        high = table[i, m] * (1 - u) + table[k, m] * u
        heights[n] = low * (1 - v) + high * v
    return heights


def realistic_lidar(lidar: LidarConfig, rng: np.random.Generator) -> LidarConfig:
    """Draw mount, optics and timing for a LiDAR, as on real cars."""
    pattern = lidar.pattern if isinstance(lidar.pattern, str) else lidar.pattern.name
    low, high = np.log(_DROPOUT_ENERGY)
    turn = rng.normal(0.0, _TILT_RAD, 2).clip(-4 * _TILT_RAD, 4 * _TILT_RAD)
    columns = _COLUMNS.get(pattern, (lidar.columns,))
    return replace(
        lidar,
        columns=columns[int(rng.integers(len(columns)))],
        dropout_energy=math.exp(rng.uniform(low, high)),
        above_m=rng.uniform(*_ABOVE_M),
        x_m=rng.uniform(*_AHEAD_M),
        min_range_m=rng.uniform(*_NEAREST_M),
        max_range_m=rng.uniform(*_FARTHEST_M),
        imperfections=Imperfections(
            roll_rad=float(turn[0]),
            pitch_rad=float(turn[1]),
            up_m=float(rng.normal(0.0, _UP_M)),
            edge_rad=rng.uniform(*_EDGE_RAD),
            falloff=rng.uniform(*_FALLOFF),
            lost_share=rng.uniform(*_LOST),
            through=rng.uniform(*_THROUGH),
            beam_rad=rng.uniform(*_BEAM_RAD),
            unit=int(rng.integers(2**31)),
            speckle=rng.uniform(*_SPECKLE),
            gain=math.exp(rng.uniform(*np.log(_GAIN))),
            gamma=rng.uniform(*_GAMMA),
            turn_s=0.1 if rng.random() < 0.7 else 0.05,
            stamp=rng.random(),
            uncorrected=float(rng.normal(0.0, _UNCORRECTED)),
            second_unit=_SECOND_UNIT.get(pattern, 0),
        ),
    )
