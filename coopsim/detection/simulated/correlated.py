"""A simulated detector whose misses, errors and false positives persist, as those of real detectors do.

The errors of `SimulatedDetector` are new in every frame, so a filter averages them away. This detector errs about an
object in the same way for a while: see `coopsim.detection.simulated.persistence`. Its parameters are curves fitted to
recordings (`docs/detector.md`).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Self

import numpy as np

from coopsim.detection.oracle import Oracle, OracleDetector, Oracles, split_by_agent
from coopsim.detection.simulated.clutter import Clutter, ClutterConfig
from coopsim.detection.simulated.curves import (
    ClassConfusion,
    Curves,
    DetectionModel,
    ErrorModel,
    LabelNoise,
    ScoreModel,
    require_parts,
)
from coopsim.detection.simulated.persistence import PersistentNormals
from coopsim.errors import InvalidValueError, UnknownNameError
from coopsim.geometry.boxes import Boxes3D, in_region
from coopsim.geometry.se3 import Floats, wrap_angle
from coopsim.support.checks import require_count, require_finite_number, require_instance, require_positive
from coopsim.types import AgentSpec, Detections, Ints, SensorView

ERRORS = ("along", "across", "up", "length", "width", "height", "yaw")
"""The errors of a box: m along and across its heading and upwards, logarithms of its sizes, rad."""

_CAR_LENGTH_M = 4.5


@dataclass(frozen=True, slots=True)
class CorrelatedDetectorConfig:
    """Parameters of `CorrelatedDetector`.

    Attributes:
        reach_x_m: farthest detection ahead and behind.
        reach_y_m: farthest detection to the sides.
        detection: probability of detection over the natural logarithm of the number of returns.
        score: model of the scores.
        errors: error models by name, one for each of `ERRORS`.
        min_points: fewest returns with which an object can be detected.
        clutter: false positives; None: there are none.
        heading_from_rad: for a detector that does not tell front from back: all headings it reports, in the agent's
            frame, are in the half turn that begins here. None: it tells them apart.
        confusion: confusion of classes; None: every label is right, and false positives are cars.
    """

    reach_x_m: float
    reach_y_m: float
    detection: DetectionModel
    score: ScoreModel
    errors: Mapping[str, ErrorModel]
    min_points: int = 1
    clutter: ClutterConfig | None = None
    heading_from_rad: float | None = None
    confusion: ClassConfusion | None = None

    def __post_init__(self) -> None:
        require_positive(reach_x_m=self.reach_x_m, reach_y_m=self.reach_y_m)
        require_count(1, min_points=self.min_points)
        require_parts(DetectionModel, detection=self.detection)
        require_parts(ScoreModel, score=self.score)
        require_instance(ClutterConfig, clutter=self.clutter)
        require_instance(ClassConfusion, confusion=self.confusion)
        if self.heading_from_rad is not None:
            require_finite_number(heading_from_rad=self.heading_from_rad)
        require_parts(Mapping, errors=self.errors)
        for name in self.errors:
            if name not in ERRORS:
                raise UnknownNameError("error", name, ERRORS)
        missing = [name for name in ERRORS if not isinstance(self.errors.get(name), ErrorModel)]
        if missing:
            raise InvalidValueError(f"errors must have an ErrorModel for each of {', '.join(ERRORS)}; no {missing[0]}")

    @property
    def reach_m(self) -> Floats:
        """(2,): `reach_x_m` and `reach_y_m`."""
        return np.array([self.reach_x_m, self.reach_y_m])


class _PersistentErrors:
    """The persistent errors of all agents' detectors over one episode."""

    def __init__(self, config: CorrelatedDetectorConfig, seed: int, specs: Mapping[str, AgentSpec]) -> None:
        errors = (config.errors[name].persistence for name in ERRORS)
        kinds = (config.detection.persistence, config.score.persistence, *errors)
        agents, owners = list(specs), [f"detector of {agent}" for agent in specs]
        dt_s = [spec.dt_s * spec.sense_every for spec in specs.values()]
        self.row = {agent: k for k, agent in enumerate(agents)}
        self.normals = PersistentNormals(seed, owners, kinds, dt_s)
        self.labels = None
        if config.confusion is not None:
            self.labels = LabelNoise(config.confusion, seed, owners, dt_s)
        self.clutter = None
        if config.clutter is not None:
            self.clutter = Clutter(config.clutter, seed, agents, dt_s, config.reach_m, config.confusion)


class CorrelatedDetector(OracleDetector):
    """A detector fitted to a real one, with errors that persist; see `CorrelatedDetectorConfig`."""

    def __init__(self, config: CorrelatedDetectorConfig) -> None:
        require_parts(CorrelatedDetectorConfig, config=config)
        self.config = config
        errors = [config.errors[name] for name in ERRORS]
        medians, spreads = [each.median for each in errors], [each.spread for each in errors]
        self._by_range = Curves(*medians, *spreads, config.score.logit, config.score.spread)
        self._tails = np.array([each.tail for each in errors])[:, None]
        self._reach_m = config.reach_m
        self._persistent = _PersistentErrors(config, 0, {})

    def begin(self, specs: Mapping[str, AgentSpec], seed: int) -> Self:
        """Return a detector for one episode, with a memory for each agent."""
        begun = type(self)(self.config)
        begun._persistent = _PersistentErrors(self.config, seed, specs)
        return begun

    def detect(self, view: SensorView, oracle: Oracle, rng: np.random.Generator) -> Detections:
        """Report the objects of one frame; see `OracleDetector.detect`. All draws come from the memory, none from rng.

        Raises:
            InvalidValueError: `begin` was not called, or without this agent.
        """
        return self._detect(Oracles.of({view.agent: oracle}))[view.agent]

    def detect_all(
        self, views: Mapping[str, SensorView], oracles: Mapping[str, Oracle], rngs: Mapping[str, np.random.Generator]
    ) -> dict[str, Detections]:
        """Report the objects of one frame for all agents; see `detect`."""
        if not views:
            return {}
        return self._detect(Oracles.of(oracles, views))

    def _detect(self, oracles: Oracles) -> dict[str, Detections]:
        memory, actors, start = self._persistent, oracles.actors, oracles.start
        for agent in oracles:
            if agent not in memory.row:
                raise InvalidValueError(f"CorrelatedDetector has not begun an episode with {agent!r}: call begin")
        asked = np.array([memory.row[agent] for agent in oracles], np.int64)
        maybe = np.flatnonzero(oracles.returns >= self.config.min_points)
        normals = memory.normals.step(asked, start, actors.id, maybe)
        label = actors.label[maybe]
        if memory.labels is not None:
            label = memory.labels.step(asked, start, actors.id, maybe, label)
        rows, real = self._report(actors.boxes[maybe], oracles.returns[maybe], label, normals)
        owner = np.searchsorted(start, maybe[rows], "right") - 1
        if memory.clutter is not None:
            poses = oracles.world_SE3_base, oracles.base_SE3_world
            false = memory.clutter.detect(asked, *poses, start, np.ascontiguousarray(actors.boxes.center[:, :2]))
            owner = np.concatenate([owner, false.owner])
            real = Detections.concatenate([real, false.detections])
        return split_by_agent(real, oracles.agents, owner)

    def _report(self, boxes: Boxes3D, returns: Ints, label: Ints, normals: Floats) -> tuple[Ints, Detections]:
        """Return the rows (M,) of the detected among N objects, and their detections.

        `returns` and reported `label` are (N,); `normals` (N, 9) are standard normal, of detection, score and `ERRORS`.
        """
        x, y = boxes.center[:, 0], boxes.center[:, 1]
        *medians_and_spreads, logit, spread = self._by_range(np.sqrt(x * x + y * y))
        disturbed = self._disturb(boxes, np.array(medians_and_spreads), normals[:, 2:])
        detected, margin = self.config.detection.decide(self.recall(returns), normals[:, 0])
        detected &= in_region(disturbed.center, self._reach_m)
        score = self.config.score.score_of(logit, spread, margin, normals[:, 1])
        return np.flatnonzero(detected), Detections(disturbed, score, label)[detected]

    def recall(self, returns: Ints) -> Floats:
        """Return the probability of detection within reach, (N,), for numbers of returns (N,)."""
        probability = self.config.detection.probability(np.log(np.maximum(returns, 1)))
        return np.where(returns >= self.config.min_points, probability, 0.0)

    def _disturb(self, boxes: Boxes3D, curves: Floats, normals: Floats) -> Boxes3D:
        """Return N boxes with errors, by the medians, then the spreads of all errors at their ranges (14, N)."""
        normal = np.ascontiguousarray(normals.T)
        error = curves[:7] + curves[7:] * normal * np.exp(self._tails * normal**2 / 2)  # as `ErrorModel.error`
        # A small object leaves less room to be wrong in: a person's box is not missed by a car's error.
        room = np.minimum(1.0, boxes.size[:, 0] / _CAR_LENGTH_M)
        along, across = error[0] * room, error[1] * room
        cos, sin = np.cos(boxes.yaw), np.sin(boxes.yaw)
        shift = np.array([along * cos - across * sin, along * sin + across * cos, error[2] * room])
        shift, grown = np.ascontiguousarray(shift.T), np.ascontiguousarray(np.exp(error[3:6]).T)
        return Boxes3D.trusted(boxes.center + shift, boxes.size * grown, self._folded(boxes.yaw + error[6]))

    def _folded(self, yaw: Floats) -> Floats:
        """Return headings (N,), folded into the half turn of `heading_from_rad` where there is one."""
        start = self.config.heading_from_rad
        return wrap_angle(yaw if start is None else start + (yaw - start) % np.pi)
