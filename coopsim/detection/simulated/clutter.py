"""False positives that stay where they are: things in the world that a detector takes for cars for a while.

Phantoms stand at places of the world that the episode's seed decides, at most one at a time in a cell of a grid,
whichever agent passes. So two agents may report the same phantom, it passes by as an agent moves, and while it exists
each agent reports it or not as its own evidence says.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtri

from coopsim.detection.simulated.curves import (
    ClassConfusion,
    Curve,
    Curves,
    DetectionModel,
    ScoreModel,
    confuse,
    require_parts,
)
from coopsim.detection.simulated.persistence import Persistence, PersistentNormals, uniform_at
from coopsim.errors import InvalidValueError
from coopsim.geometry.boxes import Boxes3D, in_region
from coopsim.geometry.se3 import SE3, Floats, SE3Batch, wrap_angle
from coopsim.support.checks import require_between, require_non_negative, require_positive
from coopsim.support.kernels import njit
from coopsim.support.rng import draw_key, stream
from coopsim.types import Detections, Ints, Mask
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
        detection: a phantom's probability of being reported over the range in m, and its persistence.
        score: its score.
        life_s: time for which each phantom exists.
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


@dataclass(frozen=True, slots=True, eq=False)
class FalsePositives:
    """False positives of all agents in one frame, in base frames, and the numbers (N,) of their agents."""

    owner: Ints
    detections: Detections


class Clutter:
    """False positives of A agents over one episode; asked once in each frame, in order.

    The episode's seed also decides where the phantoms are. `dt_s` (A,) is the time between two frames of each agent,
    `reach_m` (2,) half the length and width of the detector's field of view. Without confusion all are reported as
    cars.
    """

    def __init__(
        self,
        config: ClutterConfig,
        seed: int,
        agents: Sequence[str],
        dt_s: Sequence[float],
        reach_m: Floats,
        confusion: ClassConfusion | None = None,
    ) -> None:
        self._config = config
        self._by_range = Curves(config.detection.probability, config.score.logit, config.score.spread)
        self._reach_m = np.asarray(reach_m, dtype=np.float64)
        kinds = (config.detection.persistence, config.score.persistence, *(Persistence() for _ in range(3)))
        self._normals = PersistentNormals(seed, [f"clutter of {agent}" for agent in agents], kinds, dt_s)
        self._levels = None if confusion is None else confusion.levels
        label_keys = [draw_key(seed, f"classes of clutter of {agent}") for agent in agents]
        self._keys = np.array([draw_key(seed, purpose) for purpose in ("phantoms' lives", "phantoms")], np.uint64)
        self._label_keys = np.array(label_keys, np.uint64)
        factor, spread = 1.0, config.density_spread
        if spread > 0:
            factor = float(stream(seed, "clutter density").gamma(spread**-2, spread**2))
        self._share = min(config.density_per_m2 * factor * CELL_M**2, 1.0)
        self._lives_per_frame = np.array([between_s / config.life_s for between_s in dt_s])
        self._frame = np.zeros(len(agents), np.int64)
        quantiles = config.heading_quantiles_rad
        self._headings = np.linspace(0.0, 1.0, len(quantiles)), np.array(quantiles)
        far = int(np.linalg.norm(self._reach_m) // CELL_M) + 1
        steps = np.arange(-far, far + 1)
        self._around = np.stack(np.meshgrid(steps, steps, indexing="ij"), axis=-1).reshape(-1, 2)

    def detect(
        self,
        asked: Ints,
        world_SE3_base: Sequence[SE3],
        base_SE3_world: SE3Batch,
        start: Ints,
        solid_m: Floats,
        room_m: float = 3.0,
    ) -> FalsePositives:
        """Report the false positives of a frame.

        The agents `asked` (B,) have true poses and their inverses. Their real objects have centers `solid_m` (N, 2) in
        the base frames, each agent's from `start` (B + 1,) on; no phantom is reported within `room_m` of one.
        """
        at_m = np.array([pose.translation[:2] for pose in world_SE3_base]).reshape(-1, 2)
        lived = self._frame[asked] * self._lives_per_frame[asked]
        self._frame[asked] += 1
        begin, ids, places_m, looks = _phantoms(at_m, self._around, lived, self._keys, self._share)
        row, center = _move(begin, places_m, base_SE3_world.rotation, base_SE3_world.translation)
        range_m = np.sqrt(center[:, 0] * center[:, 0] + center[:, 1] * center[:, 1])
        near = np.flatnonzero(in_region(center, self._reach_m) & (range_m > room_m))
        normals = self._normals.step(asked, begin, ids, near)
        probability, logit, spread = self._by_range(range_m[near])
        reported, margin = self._config.detection.decide(probability, normals[:, 0])
        reported &= _is_free(center[near], row[near], start, solid_m, room_m)
        rows, normals = near[reported], normals[reported]
        score = self._config.score.score_of(logit[reported], spread[reported], margin[reported], normals[:, 1])
        # Phantoms stand at the height 0, wherever those who see them are.
        floor_m = base_SE3_world.translation[row[rows], 2]
        boxes = self._boxes(center[rows], floor_m, looks[rows], self._config.jitter_m * normals[:, 2:])
        label = self._label(self._label_keys[asked[row[rows]]], ids[rows])
        return FalsePositives(row[rows], Detections(boxes, score, label))

    def _label(self, keys: NDArray[np.uint64], ids: Ints) -> Ints:
        """Return the reported classes of phantoms: those of cars, confused for a phantom's whole life."""
        label = np.full(len(ids), int(ObjectClass.CAR))
        return label if self._levels is None else confuse(self._levels, label, _uniform_by_key(keys, ids))

    def _boxes(self, center: Floats, floor_m: Floats, looks: Floats, jitter: Floats) -> Boxes3D:
        size = np.array(self._config.size_m) * np.exp(self._config.size_noise * ndtri(looks[:, :3] + _TINY))
        center = np.column_stack([center, floor_m + size[:, 2] / 2]) + jitter
        yaw = np.interp(looks[:, 3], *self._headings)
        return Boxes3D(center, size, wrap_angle(yaw))


@njit(cache=True, nogil=True)
def _phantoms(
    at_m: Floats, around: Ints, lived: Floats, keys: NDArray[np.uint64], share: float
) -> tuple[Ints, Ints, Floats, Floats]:
    """Return the phantoms around places (B, 2) of the world: first of each place (B + 1,), ids, world positions, four
    numbers.

    Cells are looked at by their offsets `around` (C, 2); `share` of them have a phantom. `lived` (B,) lives have passed
    since the episode's start. `keys` (2,) decide the lives, and the phantoms.
    """
    most = len(at_m) * len(around)
    begin, ids = np.zeros(len(at_m) + 1, np.int64), np.empty(most, np.int64)
    places_m, looks, found = np.empty((most, 2)), np.empty((most, 4)), 0
    once, columns = np.uint64(1), np.uint64(7)
    for b in range(len(at_m)):
        home = int(np.floor(at_m[b, 0] / CELL_M)), int(np.floor(at_m[b, 1] / CELL_M))
        for c in range(len(around)):
            x, y = home[0] + around[c, 0], home[1] + around[c, 1]
            number = x % _WRAP * _WRAP + y % _WRAP
            begun = uniform_at(keys[0], np.uint64(number), once, np.uint64(0))  # not all cells change at once
            phantom = number * _LIVES + int(np.floor(lived[b] + begun)) % _LIVES
            owner = np.uint64(phantom)
            if uniform_at(keys[1], owner, columns, np.uint64(0)) >= share:
                continue
            ids[found] = phantom
            places_m[found, 0] = (x + uniform_at(keys[1], owner, columns, np.uint64(1))) * CELL_M
            places_m[found, 1] = (y + uniform_at(keys[1], owner, columns, np.uint64(2))) * CELL_M
            for look in range(4):
                looks[found, look] = uniform_at(keys[1], owner, columns, np.uint64(3 + look))
            found += 1
        begin[b + 1] = found
    return begin, ids[:found].copy(), places_m[:found].copy(), looks[:found].copy()


@njit(cache=True, nogil=True)
def _move(begin: Ints, places_m: Floats, turn: Floats, shift: Floats) -> tuple[Ints, Floats]:
    """Move places (N, 2) on the ground by their agents' rotations (B, 3, 3) and translations (B, 3).

    Returns the number of each one's agent (N,), and the moved places (N, 2).
    """
    row, moved = np.empty(len(places_m), np.int64), np.empty_like(places_m)
    for b in range(len(begin) - 1):
        for n in range(begin[b], begin[b + 1]):
            row[n] = b
            for axis in range(2):
                along = places_m[n, 0] * turn[b, axis, 0] + places_m[n, 1] * turn[b, axis, 1]
                moved[n, axis] = along + shift[b, axis]
    return row, moved


@njit(cache=True, nogil=True)
def _is_free(center: Floats, row: Ints, start: Ints, solid_m: Floats, room_m: float) -> Mask:
    """Return which places (N, 2), of the agents `row` (N,), are farther than `room_m` from these agents' objects."""
    free = np.ones(len(center), np.bool_)
    for n in range(len(center)):
        for solid in range(start[row[n]], start[row[n] + 1]):
            dx, dy = center[n, 0] - solid_m[solid, 0], center[n, 1] - solid_m[solid, 1]
            if np.sqrt(dx * dx + dy * dy) <= room_m:
                free[n] = False
                break
    return free


@njit(cache=True, nogil=True)
def _uniform_by_key(keys: NDArray[np.uint64], ids: Ints) -> Floats:
    """Return one number (N,) of `uniform_numbers` for each key (N,) and owner (N,)."""
    drawn = np.empty(len(ids))
    for n in range(len(ids)):
        drawn[n] = uniform_at(keys[n], np.uint64(ids[n]), np.uint64(1), np.uint64(0))
    return drawn
