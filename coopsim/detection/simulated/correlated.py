"""A simulated detector whose misses, errors and false positives last, as those of real ones do.

`SimulatedDetector` errs anew in every frame, which a filter averages away. This one errs about an object the same way
for a while: see `coopsim.detection.simulated.persistence`. Its numbers are curves that a fit to recordings gives
(`docs/reference/detector.md`).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from coopsim.detection.simulated.clutter import Clutter, ClutterConfig
from coopsim.detection.simulated.curves import Found, Scored, Spread, require_parts
from coopsim.detection.simulated.persistence import LastingNormals
from coopsim.detection.simulated.simulated import Detector, count_returns
from coopsim.errors import InvalidValueError, UnknownNameError
from coopsim.geometry.boxes import Boxes3D
from coopsim.geometry.se3 import SE3, Floats, wrap_angle
from coopsim.support.checks import require_count, require_finite_number, require_instance, require_positive
from coopsim.types import Detections, Ints, Sweep
from coopsim.world.snapshot import Actors

ERRORS = ("along", "across", "up", "length", "width", "height", "yaw")
"""What a box errs in: m along and across its heading and upwards, logarithms of its sizes, rad."""

_CAR_LENGTH_M = 4.5


@dataclass(frozen=True, slots=True)
class CorrelatedDetectorConfig:
    """Parameters of `CorrelatedDetector`.

    Attributes:
        reach_x_m: it sees nothing farther ahead or behind.
        reach_y_m: it sees nothing farther to its sides.
        min_points: fewest returns with which an object can be found.
        found: how an object is found: probability over the natural logarithm of the number of returns.
        scored: its score.
        errors: by name, one for each of `ERRORS`.
        clutter: false positives; None: there are none.
        heading_from_rad: for a detector that does not tell front from back: all headings it reports, in the agent's
            frame, are in the half turn that begins here. None: it tells them apart.
    """

    reach_x_m: float
    reach_y_m: float
    found: Found
    scored: Scored
    errors: Mapping[str, Spread]
    min_points: int = 1
    clutter: ClutterConfig | None = None
    heading_from_rad: float | None = None

    def __post_init__(self) -> None:
        require_positive(reach_x_m=self.reach_x_m, reach_y_m=self.reach_y_m)
        require_count(1, min_points=self.min_points)
        require_parts(Found, found=self.found)
        require_parts(Scored, scored=self.scored)
        require_instance(ClutterConfig, clutter=self.clutter)
        if self.heading_from_rad is not None:
            require_finite_number(heading_from_rad=self.heading_from_rad)
        require_parts(Mapping, errors=self.errors)
        for name in self.errors:
            if name not in ERRORS:
                raise UnknownNameError("error", name, ERRORS)
        missing = [name for name in ERRORS if not isinstance(self.errors.get(name), Spread)]
        if missing:
            raise InvalidValueError(f"errors must have a Spread for each of {', '.join(ERRORS)}; no {missing[0]}")


class CorrelatedDetector(Detector):
    """Truth, thinned and disturbed as a real detector would, with a memory; see `CorrelatedDetectorConfig`.

    The environment makes one for every agent and episode from the one it is given (`begin`).

    Args:
        config: how it errs.
        seed: the episode's seed.
        agent: whose it is.
        dt_s: time between two frames.
    """

    needs_sweeps = False

    def __init__(
        self, config: CorrelatedDetectorConfig, seed: int = 0, agent: str = "agent", dt_s: float = 0.1
    ) -> None:
        require_parts(CorrelatedDetectorConfig, config=config)
        self.config = config
        of_errors = (config.errors[name].persistence for name in ERRORS)
        persistences = (config.found.persistence, config.scored.persistence, *of_errors)
        self._normals = LastingNormals(seed, f"detector of {agent}", persistences, dt_s)
        self._reach_m = np.array([config.reach_x_m, config.reach_y_m])
        self._clutter = None
        if config.clutter is not None:
            self._clutter = Clutter(config.clutter, seed, agent, dt_s, self._reach_m)
        self._world_SE3_base = SE3.identity()

    def begin(self, seed: int, agent: str, dt_s: float) -> CorrelatedDetector:
        return CorrelatedDetector(self.config, seed, agent, dt_s)

    def move(self, world_SE3_base: SE3) -> None:
        self._world_SE3_base = world_SE3_base

    def detect(self, sweeps: Mapping[str, Sweep], truth: Actors, rng: np.random.Generator) -> Detections:
        return self.detect_from_returns(count_returns(sweeps, truth.id), truth, rng)

    def detect_from_returns(self, returns: Ints, truth: Actors, rng: np.random.Generator) -> Detections:
        normals = self._normals.step(truth.id)
        place = truth.boxes.center[:, :2]
        range_m = np.linalg.norm(place, axis=1)
        boxes = self._disturb(truth.boxes, range_m, normals[:, 2:])
        found, clearly = self.config.found.decide(self.recall(returns), normals[:, 0])
        found &= (np.abs(boxes.center[:, :2]) <= self._reach_m).all(axis=1)
        score = self.config.scored.score(range_m, clearly, normals[:, 1])
        real = Detections(boxes, score, truth.label)[found]
        if self._clutter is None:
            return real
        return Detections.concatenate([real, self._clutter.detect(self._world_SE3_base, place)])

    def recall(self, returns: Ints) -> Floats:
        """P(found) within reach for (N,) numbers of returns."""
        chance = self.config.found.chance(np.log(np.maximum(returns, 1)))
        return np.where(returns >= self.config.min_points, chance, 0.0)

    def _disturb(self, boxes: Boxes3D, range_m: Floats, normals: Floats) -> Boxes3D:
        error = {
            name: self.config.errors[name].error(range_m, normal)
            for name, normal in zip(ERRORS, normals.T, strict=True)
        }
        # A small object leaves less room to be wrong in: a person's box is not missed by a car's error.
        room = np.minimum(1.0, boxes.size[:, 0] / _CAR_LENGTH_M)
        along, across = error["along"] * room, error["across"] * room
        cos, sin = np.cos(boxes.yaw), np.sin(boxes.yaw)
        shift = np.column_stack([along * cos - across * sin, along * sin + across * cos, error["up"] * room])
        grown = np.exp(np.column_stack([error[name] for name in ("length", "width", "height")]))
        return Boxes3D(boxes.center + shift, boxes.size * grown, self._reported(boxes.yaw + error["yaw"]))

    def _reported(self, yaw: Floats) -> Floats:
        start = self.config.heading_from_rad
        return wrap_angle(yaw if start is None else start + (yaw - start) % np.pi)
