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

from coopsim.detection.oracle import Oracle, OracleDetector
from coopsim.detection.simulated.clutter import Clutter, ClutterConfig
from coopsim.detection.simulated.confusion import ClassConfusion, LabelNoise
from coopsim.detection.simulated.curves import DetectionModel, ErrorModel, ScoreModel, require_parts
from coopsim.detection.simulated.persistence import PersistentNormals
from coopsim.errors import InvalidValueError, UnknownNameError
from coopsim.geometry.boxes import Boxes3D
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
        detection: how objects are detected: probability over the natural logarithm of the number of returns.
        score: their scores.
        errors: error models by name, one for each of `ERRORS`.
        min_points: fewest returns with which an object can be detected.
        clutter: false positives; None: there are none.
        heading_from_rad: for a detector that does not tell front from back: all headings it reports, in the agent's
            frame, are in the half turn that begins here. None: it tells them apart.
        confusion: how classes are confused; None: every label is right, and false positives are cars.
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


class _Memory:
    """The persistent errors of one agent's detector over one episode."""

    def __init__(self, config: CorrelatedDetectorConfig, seed: int, agent: str, dt_s: float) -> None:
        errors = (config.errors[name].persistence for name in ERRORS)
        kinds = (config.detection.persistence, config.score.persistence, *errors)
        self.normals = PersistentNormals(seed, f"detector of {agent}", kinds, dt_s)
        self.labels = None
        if config.confusion is not None:
            self.labels = LabelNoise(config.confusion, seed, f"detector of {agent}", dt_s)
        self.clutter = None
        if config.clutter is not None:
            self.clutter = Clutter(config.clutter, seed, agent, dt_s, config.reach_m, config.confusion)


class CorrelatedDetector(OracleDetector):
    """A detector fitted to a real one, with errors that persist; see `CorrelatedDetectorConfig`."""

    def __init__(self, config: CorrelatedDetectorConfig) -> None:
        require_parts(CorrelatedDetectorConfig, config=config)
        self.config = config
        self._memories: dict[str, _Memory] = {}

    def begin(self, specs: Mapping[str, AgentSpec], seed: int) -> Self:
        """Return a detector for one episode, with a memory for each agent."""
        begun = type(self)(self.config)
        begun._memories = {
            agent: _Memory(self.config, seed, agent, spec.dt_s * spec.sense_every) for agent, spec in specs.items()
        }
        return begun

    def detect(self, view: SensorView, oracle: Oracle, rng: np.random.Generator) -> Detections:
        """Report the objects of one frame; see `OracleDetector.detect`. All draws come from the memory, none from rng.

        Raises:
            InvalidValueError: `begin` was not called, or without this agent.
        """
        if view.agent not in self._memories:
            raise InvalidValueError(f"CorrelatedDetector has not begun an episode with {view.agent!r}: call begin")
        memory, actors = self._memories[view.agent], oracle.actors
        normals = memory.normals.step(actors.id)
        label = actors.label if memory.labels is None else memory.labels.step(actors.id, actors.label)
        center = actors.boxes.center[:, :2]
        range_m = np.linalg.norm(center, axis=1)
        boxes = self._disturb(actors.boxes, range_m, normals[:, 2:])
        detected, margin = self.config.detection.decide(self.recall(oracle.returns), normals[:, 0])
        detected &= (np.abs(boxes.center[:, :2]) <= self.config.reach_m).all(axis=1)
        score = self.config.score.score(range_m, margin, normals[:, 1])
        real = Detections(boxes, score, label)[detected]
        if memory.clutter is None:
            return real
        return Detections.concatenate([real, memory.clutter.detect(oracle.world_SE3_base, center)])

    def recall(self, returns: Ints) -> Floats:
        """Return the probability of detection within reach, (N,), for numbers of returns (N,)."""
        probability = self.config.detection.probability(np.log(np.maximum(returns, 1)))
        return np.where(returns >= self.config.min_points, probability, 0.0)

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
        return Boxes3D(boxes.center + shift, boxes.size * grown, self._folded(boxes.yaw + error["yaw"]))

    def _folded(self, yaw: Floats) -> Floats:
        """Return headings (N,), folded into the half turn of `heading_from_rad` where there is one."""
        start = self.config.heading_from_rad
        return wrap_angle(yaw if start is None else start + (yaw - start) % np.pi)
