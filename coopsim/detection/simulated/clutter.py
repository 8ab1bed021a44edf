"""False positives that stay where they are: things in the world that a detector takes for cars for a while.

Phantoms stand at places of the world that the episode's seed decides, at most one at a time in a cell of a grid,
whoever drives by. So two agents may believe in the same one, it passes by as the agent moves, and while it is there it
comes and goes for each of them as its evidence does.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
from scipy.special import ndtri

from coopsim.detection.simulated.curves import Curve, Found, Scored, require_parts
from coopsim.detection.simulated.persistence import LastingNormals, Persistence
from coopsim.errors import InvalidValueError
from coopsim.geometry.boxes import Boxes3D
from coopsim.geometry.se3 import SE3, Floats, wrap_angle
from coopsim.support.checks import require_between, require_non_negative, require_positive
from coopsim.support.rng import chances, stream
from coopsim.types import Detections, Ints
from coopsim.types.taxonomy import ObjectClass

CELL_M = 10.0
"""Side of the cells, of which each has at most one phantom."""

_WRAP, _LIVES = 2**10, 2**11  # cells per side, and lives in each, until the pattern repeats: 10 km
_TINY = 2.0**-54


@dataclass(frozen=True, slots=True)
class ClutterConfig:
    """What false positives there are.

    Attributes:
        density_per_m2: phantoms per square metre of the world, in [0, 0.01].
        life_s: for how long each is there.
        density_spread: standard deviation of an episode's density relative to the mean (gamma-distributed).
        found: how a phantom is believed: probability over the range in m, and how that lasts.
        scored: its score.
        size_m: mean length, width and height.
        size_noise: standard deviation of their logarithms.
        jitter_m: standard deviation of x, y and z from frame to frame.
        turned: (K,) quantiles of the reported heading in the agent's frame, rad, at equal steps of probability.
    """

    density_per_m2: float
    found: Found
    scored: Scored
    life_s: float
    density_spread: float = 0.0
    size_m: tuple[float, float, float] = (4.5, 1.95, 1.75)
    size_noise: float = 0.05
    jitter_m: float = 0.0
    turned: tuple[float, ...] = field(default=(-math.pi, math.pi))

    def __post_init__(self) -> None:
        require_between(0, CELL_M**-2, density_per_m2=self.density_per_m2)
        require_parts(Found, found=self.found)
        require_parts(Scored, scored=self.scored)
        require_positive(life_s=self.life_s)
        require_non_negative(density_spread=self.density_spread, size_noise=self.size_noise, jitter_m=self.jitter_m)
        object.__setattr__(self, "size_m", tuple(self.size_m))
        if len(self.size_m) != 3:
            raise InvalidValueError(f"size_m must be length, width and height, got {self.size_m!r}")
        for size in self.size_m:
            require_positive(size_m=size)
        # A curve's own checks serve for the quantiles, which are one over probability.
        quantiles = Curve(tuple(np.linspace(0.0, 1.0, len(self.turned))), tuple(self.turned))
        object.__setattr__(self, "turned", quantiles.value)


class Clutter:
    """One agent's false positives over one episode; asked once in each frame, in order.

    Args:
        config: what there is.
        seed: the episode's seed, which also decides where the phantoms are.
        agent: whose they are.
        dt_s: time between two frames.
        reach_m: (2,) half the length and width of what the detector looks at.
    """

    def __init__(self, config: ClutterConfig, seed: int, agent: str, dt_s: float, reach_m: Floats) -> None:
        self._config, self._seed = config, seed
        self._reach_m = np.asarray(reach_m, dtype=np.float64)
        kinds = (config.found.persistence, config.scored.persistence, *(Persistence() for _ in range(3)))
        self._normals = LastingNormals(seed, f"clutter of {agent}", kinds, dt_s)
        factor, spread = 1.0, config.density_spread
        if spread > 0:
            factor = float(stream(seed, "clutter density").gamma(spread**-2, spread**2))
        self._share = min(config.density_per_m2 * factor * CELL_M**2, 1.0)
        self._lives_per_frame, self._frame = dt_s / config.life_s, 0
        far = int(np.linalg.norm(self._reach_m) // CELL_M) + 1
        steps = np.arange(-far, far + 1)
        self._around = np.stack(np.meshgrid(steps, steps, indexing="ij"), axis=-1).reshape(-1, 2)

    def detect(self, world_SE3_base: SE3, solid_m: Floats, room_m: float = 3.0) -> Detections:
        """The false positives of an agent that is there.

        Args:
            world_SE3_base: its true pose.
            solid_m: (N, 2) where real objects are, in its base frame; no phantom is beside one.
            room_m: from the middle of a real object.
        """
        ids, places, looks = self._phantoms(world_SE3_base.translation[:2])
        self._frame += 1
        place = world_SE3_base.inverse().apply(np.column_stack([places, np.zeros(len(places))]))[:, :2]
        normals = self._normals.step(ids)
        range_m = np.linalg.norm(place, axis=1)
        believed, clearly = self._config.found.decide(self._config.found.chance(range_m), normals[:, 0])
        believed &= (np.abs(place) <= self._reach_m).all(axis=1) & (range_m > room_m)
        rows = np.flatnonzero(believed)
        if len(solid_m) and len(rows):
            away = np.linalg.norm(place[rows, None] - solid_m[None], axis=2).min(axis=1)
            rows = rows[away > room_m]
        score = self._config.scored.score(range_m[rows], clearly[rows], normals[rows, 1])
        jitter = self._config.jitter_m * normals[rows, 2:]
        boxes = self._boxes(place[rows], looks[rows], jitter)
        return Detections(boxes, score, np.full(len(rows), int(ObjectClass.CAR)))

    def _boxes(self, place: Floats, looks: Floats, jitter: Floats) -> Boxes3D:
        size = np.array(self._config.size_m) * np.exp(self._config.size_noise * ndtri(looks[:, :3] + _TINY))
        center = np.column_stack([place, size[:, 2] / 2]) + jitter
        turned = self._config.turned
        yaw = np.interp(looks[:, 3], np.linspace(0.0, 1.0, len(turned)), turned)
        return Boxes3D(center, size, wrap_angle(yaw))

    def _phantoms(self, at_m: Floats) -> tuple[Ints, Floats, Floats]:
        """Those that are there now around a place (2,): ids (N,), places (N, 2) in the world, and looks (N, 4)."""
        cells = np.floor(at_m / CELL_M).astype(np.int64) + self._around
        numbers = cell_ids(cells)
        begun = chances(self._seed, "phantoms' lives", numbers, 1)[:, 0]  # not all cells change at once
        life = np.floor(self._frame * self._lives_per_frame + begun).astype(np.int64) % _LIVES
        ids = numbers * _LIVES + life
        drawn = chances(self._seed, "phantoms", ids, 7)
        there = drawn[:, 0] < self._share
        return ids[there], (cells[there] + drawn[there, 1:3]) * CELL_M, drawn[there, 3:]


def cell_ids(cells: Ints) -> Ints:
    """(N,) numbers in [0, 2^20) of cells (N, 2)."""
    wrapped = cells % _WRAP
    numbers: Ints = wrapped[:, 0] * _WRAP + wrapped[:, 1]
    return numbers
