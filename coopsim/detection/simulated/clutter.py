"""False positives that stay where they are: things in the world that a detector takes for cars for a while.

Phantoms stand at places of the world that the episode's seed decides, at most one at a time in a cell of a grid,
whichever agent passes. So two agents may report the same phantom, it passes by as an agent moves, and while it exists
each agent reports it or not as its own evidence says.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
from scipy.special import ndtri

from coopsim.detection.simulated.confusion import ClassConfusion
from coopsim.detection.simulated.curves import Curve, DetectionModel, ScoreModel, require_parts
from coopsim.detection.simulated.persistence import Persistence, PersistentNormals
from coopsim.errors import InvalidValueError
from coopsim.geometry.boxes import Boxes3D
from coopsim.geometry.se3 import SE3, Floats, wrap_angle
from coopsim.support.checks import require_between, require_non_negative, require_positive
from coopsim.support.rng import stream, uniform_draws
from coopsim.types import Detections, Ints
from coopsim.types.taxonomy import ObjectClass

CELL_M = 10.0
"""Side of the grid's cells, each of which holds at most one phantom."""

_WRAP, _LIVES = 2**10, 2**11  # cells per side, and lives in each, until the pattern repeats: 10 km
_TINY = 2.0**-54


@dataclass(frozen=True, slots=True)
class ClutterConfig:
    """Parameters of `Clutter`.

    Attributes:
        density_per_m2: phantoms per square metre of the world, in [0, 0.01].
        detection: how a phantom is reported: probability over the range in m, and its persistence.
        score: its score.
        life_s: for how long each phantom exists.
        density_spread: standard deviation of an episode's density relative to the mean (gamma-distributed).
        size_m: mean length, width and height.
        size_noise: standard deviation of their logarithms.
        jitter_m: standard deviation of x, y and z from frame to frame.
        heading_quantiles_rad: (K,) quantiles of the reported heading in the agent's frame, at equal steps of
            probability.
    """

    density_per_m2: float
    detection: DetectionModel
    score: ScoreModel
    life_s: float
    density_spread: float = 0.0
    size_m: tuple[float, float, float] = (4.5, 1.95, 1.75)
    size_noise: float = 0.05
    jitter_m: float = 0.0
    heading_quantiles_rad: tuple[float, ...] = field(default=(-math.pi, math.pi))

    def __post_init__(self) -> None:
        require_between(0, CELL_M**-2, density_per_m2=self.density_per_m2)
        require_parts(DetectionModel, detection=self.detection)
        require_parts(ScoreModel, score=self.score)
        require_positive(life_s=self.life_s)
        require_non_negative(density_spread=self.density_spread, size_noise=self.size_noise, jitter_m=self.jitter_m)
        object.__setattr__(self, "size_m", tuple(self.size_m))
        if len(self.size_m) != 3:
            raise InvalidValueError(f"size_m must be length, width and height, got {self.size_m!r}")
        for size in self.size_m:
            require_positive(size_m=size)
        # A curve's own checks serve for the quantiles, which are a function of probability.
        probability = tuple(np.linspace(0.0, 1.0, len(self.heading_quantiles_rad)))
        quantiles = Curve(probability, tuple(self.heading_quantiles_rad))
        object.__setattr__(self, "heading_quantiles_rad", quantiles.value)


class Clutter:
    """One agent's false positives over one episode; asked once in each frame, in order.

    Args:
        config: the phantoms.
        seed: the episode's seed, which also decides where the phantoms are.
        agent: name of the agent, which owns the evidence.
        dt_s: time between two frames.
        reach_m: (2,) half the length and width of the detector's field of view.
        confusion: how classes are confused; None: all phantoms are reported as cars.
    """

    def __init__(
        self,
        config: ClutterConfig,
        seed: int,
        agent: str,
        dt_s: float,
        reach_m: Floats,
        confusion: ClassConfusion | None = None,
    ) -> None:
        self._config, self._seed = config, seed
        self._reach_m = np.asarray(reach_m, dtype=np.float64)
        kinds = (config.detection.persistence, config.score.persistence, *(Persistence() for _ in range(3)))
        self._normals = PersistentNormals(seed, f"clutter of {agent}", kinds, dt_s)
        self._confusion, self._labels_owner = confusion, f"classes of clutter of {agent}"
        factor, spread = 1.0, config.density_spread
        if spread > 0:
            factor = float(stream(seed, "clutter density").gamma(spread**-2, spread**2))
        self._share = min(config.density_per_m2 * factor * CELL_M**2, 1.0)
        self._lives_per_frame, self._frame = dt_s / config.life_s, 0
        far = int(np.linalg.norm(self._reach_m) // CELL_M) + 1
        steps = np.arange(-far, far + 1)
        self._around = np.stack(np.meshgrid(steps, steps, indexing="ij"), axis=-1).reshape(-1, 2)

    def detect(self, world_SE3_base: SE3, solid_m: Floats, room_m: float = 3.0) -> Detections:
        """Report this frame's false positives, in the agent's base frame.

        Args:
            world_SE3_base: the agent's true pose.
            solid_m: (N, 2) centers of real objects, in its base frame; no phantom is reported near one.
            room_m: least distance from the center of a real object.
        """
        ids, centers, looks = self._phantoms(world_SE3_base.translation[:2])
        self._frame += 1
        center = world_SE3_base.inverse().apply(np.column_stack([centers, np.zeros(len(centers))]))[:, :2]
        normals = self._normals.step(ids)
        range_m = np.linalg.norm(center, axis=1)
        model = self._config.detection
        reported, margin = model.decide(model.probability(range_m), normals[:, 0])
        reported &= (np.abs(center) <= self._reach_m).all(axis=1) & (range_m > room_m)
        rows = np.flatnonzero(reported)
        if len(solid_m) and len(rows):
            gap_m = np.linalg.norm(center[rows, None] - solid_m[None], axis=2).min(axis=1)
            rows = rows[gap_m > room_m]
        score = self._config.score.score(range_m[rows], margin[rows], normals[rows, 1])
        jitter = self._config.jitter_m * normals[rows, 2:]
        return Detections(self._boxes(center[rows], looks[rows], jitter), score, self._label(ids[rows]))

    def _label(self, ids: Ints) -> Ints:
        """Return the reported classes of phantoms: those of cars, confused for a phantom's whole life."""
        label = np.full(len(ids), int(ObjectClass.CAR))
        if self._confusion is None:
            return label
        return self._confusion.confuse(label, uniform_draws(self._seed, self._labels_owner, ids, 1)[:, 0])

    def _boxes(self, center: Floats, looks: Floats, jitter: Floats) -> Boxes3D:
        size = np.array(self._config.size_m) * np.exp(self._config.size_noise * ndtri(looks[:, :3] + _TINY))
        center = np.column_stack([center, size[:, 2] / 2]) + jitter
        quantiles = self._config.heading_quantiles_rad
        yaw = np.interp(looks[:, 3], np.linspace(0.0, 1.0, len(quantiles)), quantiles)
        return Boxes3D(center, size, wrap_angle(yaw))

    def _phantoms(self, at_m: Floats) -> tuple[Ints, Floats, Floats]:
        """Return the phantoms around a place (2,) now: ids (N,), world positions (N, 2), uniform draws (N, 4)."""
        cells = np.floor(at_m / CELL_M).astype(np.int64) + self._around
        numbers = cell_ids(cells)
        begun = uniform_draws(self._seed, "phantoms' lives", numbers, 1)[:, 0]  # not all cells change at once
        life = np.floor(self._frame * self._lives_per_frame + begun).astype(np.int64) % _LIVES
        ids = numbers * _LIVES + life
        drawn = uniform_draws(self._seed, "phantoms", ids, 7)
        there = drawn[:, 0] < self._share
        return ids[there], (cells[there] + drawn[there, 1:3]) * CELL_M, drawn[there, 3:]


def cell_ids(cells: Ints) -> Ints:
    """Assign integers (N,) in [0, 2^20) to cells (N, 2)."""
    wrapped = cells % _WRAP
    numbers: Ints = wrapped[:, 0] * _WRAP + wrapped[:, 1]
    return numbers
