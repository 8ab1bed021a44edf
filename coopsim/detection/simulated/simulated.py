"""A detector without a network: it reports the truth as far as the LiDAR's returns support it.

An object can be detected only if enough of its returns were received; from there on recall rises, and noise falls, with
the number of returns, and noise grows with range. The score states, with noise of its own, how probable the detection
was; false positives score low. All errors are independent from frame to frame (unlike those of `CorrelatedDetector`).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import NamedTuple

import numpy as np

from coopsim.detection.oracle import Oracle, OracleDetector, Oracles, split_by_agent
from coopsim.detection.simulated.curves import ClassConfusion, confuse
from coopsim.geometry.boxes import Boxes3D
from coopsim.geometry.se3 import Floats, wrap_angle
from coopsim.support.checks import (
    require_between,
    require_count,
    require_finite_number,
    require_instance,
    require_non_negative,
    require_positive,
    require_probability,
)
from coopsim.types import Detections, Ints, SensorView
from coopsim.types.taxonomy import ObjectClass

_FALSE_SIZE_M = np.array([4.3, 1.9, 1.6])


@dataclass(frozen=True, slots=True)
class SimulatedDetectorConfig:
    """Parameters of `SimulatedDetector`.

    With n returns at range r (m), P(detect) = `max_recall` * (1 - exp(-(n - `min_points` + 1) / `recall_points`)) for n
    >= `min_points`, else 0; noise has the scale s = 1 + `range_gain_per_m` * r + `sparse_gain` / sqrt(n); the score =
    logistic(`score_gain` * (P - `score_offset`) + `score_noise` * N(0, 1)).

    Attributes:
        min_points: fewest returns with which an object can be detected.
        recall_points: returns beyond `min_points` at which 63 % of `max_recall` is reached.
        max_recall: recall of a perfectly sampled object, in [0, 1].
        position_noise_m: noise on x, y and z at scale 1.
        size_noise: relative noise on length, width and height at scale 1.
        yaw_noise_rad: noise on the heading at scale 1.
        yaw_flip: probability that the heading is reported the wrong way round.
        range_gain_per_m: growth of the noise with range.
        sparse_gain: growth of the noise for few points.
        score_gain: steepness of the score.
        score_offset: P(detect) at which the score is 0.5.
        score_noise: standard deviation of the score's logit.
        false_positives: mean number of false boxes a frame (Poisson), at most 10 000.
        false_positive_range_m: they lie at least half a car length and at most this far away.
        false_positive_logit: mean logit of their score.
        confusion: confusion of classes, anew in each frame; None: every label is right.
    """

    min_points: int = 5
    recall_points: float = 12.0
    max_recall: float = 0.97
    position_noise_m: float = 0.06
    size_noise: float = 0.03
    yaw_noise_rad: float = 0.02
    yaw_flip: float = 0.01
    range_gain_per_m: float = 0.015
    sparse_gain: float = 4.0
    score_gain: float = 5.0
    score_offset: float = 0.45
    score_noise: float = 0.5
    false_positives: float = 0.5
    false_positive_range_m: float = 80.0
    false_positive_logit: float = -1.2
    confusion: ClassConfusion | None = None

    def __post_init__(self) -> None:
        unsigned = asdict(self)
        del unsigned["confusion"]
        require_finite_number(**{name: unsigned.pop(name) for name in ("score_offset", "false_positive_logit")})
        require_non_negative(**unsigned)
        require_between(0, 10_000, false_positives=self.false_positives)
        require_count(1, min_points=self.min_points)
        require_positive(recall_points=self.recall_points)
        require_probability(max_recall=self.max_recall, yaw_flip=self.yaw_flip)
        require_instance(ClassConfusion, confusion=self.confusion)


class SimulatedDetector(OracleDetector):
    """A detector whose recall and noise follow the number of returns; see `SimulatedDetectorConfig` for the model."""

    def __init__(self, config: SimulatedDetectorConfig | None = None) -> None:
        require_instance(SimulatedDetectorConfig, config=config)
        self.config = config or SimulatedDetectorConfig()
        confusion = self.config.confusion
        self._levels = None if confusion is None else confusion.levels

    def detect(self, view: SensorView, oracle: Oracle, rng: np.random.Generator) -> Detections:
        """Report the objects of one frame; see `OracleDetector.detect`."""
        return self._detect(Oracles.of({view.agent: oracle}), [rng])[view.agent]

    def detect_all(
        self, views: Mapping[str, SensorView], oracles: Mapping[str, Oracle], rngs: Mapping[str, np.random.Generator]
    ) -> dict[str, Detections]:
        """Report the objects of one frame for all agents; see `OracleDetector.detect_all`."""
        if not views:
            return {}
        return self._detect(Oracles.of(oracles, views), [rngs[agent] for agent in views])

    def _detect(self, oracles: Oracles, rngs: Sequence[np.random.Generator]) -> dict[str, Detections]:
        draws, false_boxes, lifts = _BoxNoise(len(oracles.returns)), [], []
        for rng, begin, end in zip(rngs, oracles.start.tolist(), oracles.start[1:].tolist(), strict=False):
            draws.fill(begin, end, rng)
            false_boxes.append(self._draw_false_boxes(rng))
            lifts.append(rng.spawn(1)[0])  # whose draws do not shift those of the boxes
            if self._levels is not None:
                rng.random(out=draws.label[begin:end])
        probability = self.recall(oracles.returns)
        rows = np.flatnonzero(draws.detected < probability)
        boxes = self._disturb(oracles.actors.boxes[rows], oracles.returns[rows], draws, rows)
        score = self._score(probability[rows], draws.score[rows])
        label = oracles.actors.label[rows]
        if self._levels is not None:
            label = confuse(self._levels, label, draws.label[rows])
        owner = np.searchsorted(oracles.start, rows, "right") - 1
        false = np.repeat(np.arange(len(false_boxes)), [len(each.range_m) for each in false_boxes])
        found = Detections(boxes, score, label)
        if len(false):
            spread_m = self._height_spread_m(oracles.actors.boxes[rows], oracles.returns[rows])
            each = [
                self._lift_m(rng, spread_m[owner == agent], len(drawn.range_m))
                for agent, (rng, drawn) in enumerate(zip(lifts, false_boxes, strict=True))
            ]
            found = Detections.concatenate([found, self._false_positives(false_boxes, np.concatenate(each))])
        return split_by_agent(found, oracles.agents, np.concatenate([owner, false]))

    def recall(self, returns: Ints) -> Floats:
        """Return P(detect) for numbers of returns (N,)."""
        config = self.config
        surplus = np.maximum(returns - config.min_points + 1, 0)
        return config.max_recall * -np.expm1(-surplus / config.recall_points)

    def noise_scale(self, returns: Ints, range_m: Floats) -> Floats:
        """Return the factor on all box noise, (N,), for numbers of returns and ranges (N,)."""
        sparse = self.config.sparse_gain / np.sqrt(np.maximum(returns, 1))
        return 1.0 + self.config.range_gain_per_m * range_m + sparse

    def _disturb(self, boxes: Boxes3D, returns: Ints, draws: _BoxNoise, rows: Ints) -> Boxes3D:
        config = self.config
        scale = self.noise_scale(returns, np.linalg.norm(boxes.center[:, :2], axis=1))[:, None]
        center = boxes.center + draws.center[rows] * config.position_noise_m * scale * _size_factor(boxes)
        size = boxes.size * np.exp(draws.size[rows] * config.size_noise * scale)
        turn = draws.yaw[rows] * config.yaw_noise_rad * scale[:, 0]
        flip = np.where(draws.flip[rows] < config.yaw_flip, np.pi, 0.0)
        return Boxes3D(center, size, wrap_angle(boxes.yaw + turn + flip))

    def _height_spread_m(self, boxes: Boxes3D, returns: Ints) -> Floats:
        """Return the standard deviation of the heights at which `_disturb` puts the undersides of true boxes, (N,)."""
        config = self.config
        scale = self.noise_scale(returns, np.linalg.norm(boxes.center[:, :2], axis=1))
        by_size = config.size_noise * boxes.size[:, 2] / 2
        return scale * np.hypot(config.position_noise_m * _size_factor(boxes)[:, 0], by_size)

    def _lift_m(self, rng: np.random.Generator, spread_m: Floats, count: int) -> Floats:
        """Draw the heights of the undersides of an agent's false positives, (`count`,).

        Each has the spread of one of the agent's reported objects, (N,), or without any that of an object at its side.
        """
        if not len(spread_m):
            spread_m = np.array([self.config.position_noise_m])
        return rng.choice(spread_m, count) * rng.standard_normal(count)

    def _score(self, probability: Floats, normal: Floats) -> Floats:
        config = self.config
        return _logistic(config.score_gain * (probability - config.score_offset) + config.score_noise * normal)

    def _draw_false_boxes(self, rng: np.random.Generator) -> _FalseBoxes:
        """Draw one agent's false positives."""
        count = int(rng.poisson(self.config.false_positives))
        if not count:
            return _NO_FALSE_BOXES
        range_m = rng.uniform(_FALSE_SIZE_M[0] / 2, max(self.config.false_positive_range_m, 3.0), count)
        bearing = rng.uniform(-np.pi, np.pi, count)
        size = rng.standard_normal((count, 3))
        yaw = rng.uniform(-np.pi, np.pi, count)
        score = rng.standard_normal(count)
        return _FalseBoxes(range_m, bearing, size, yaw, score, rng.random(count) if self._levels is not None else score)

    def _false_positives(self, false_boxes: Sequence[_FalseBoxes], lift_m: Floats) -> Detections:
        """Return the N false positives of all agents, one agent's after another's; `lift_m` (N,) is of undersides."""
        config = self.config
        all_of = _FalseBoxes(*map(np.concatenate, zip(*false_boxes, strict=True)))
        size = _FALSE_SIZE_M * np.exp(0.1 * all_of.size)
        x, y = all_of.range_m * np.cos(all_of.bearing), all_of.range_m * np.sin(all_of.bearing)
        boxes = Boxes3D(np.column_stack([x, y, size[:, 2] / 2 + lift_m]), size, all_of.yaw)
        score = _logistic(config.false_positive_logit + config.score_noise * all_of.score)
        label = np.full(len(score), int(ObjectClass.CAR))
        if self._levels is not None:
            label = confuse(self._levels, label, all_of.label)
        return Detections(boxes, score, label)


class _BoxNoise:
    """Numbers drawn in a frame for N objects, each agent's from its own stream: uniform or, of boxes and scores,
    normal.

    Drawn for every object, seen or not, so that a hidden one does not shift the noise of the others. `fill` does not
    draw labels.
    """

    __slots__ = ("center", "detected", "flip", "label", "score", "size", "yaw")

    def __init__(self, count: int) -> None:
        self.detected, self.yaw, self.flip, self.score, self.label = np.empty((5, count))
        self.center, self.size = np.empty((2, count, 3))

    def fill(self, begin: int, end: int, rng: np.random.Generator) -> None:
        """Draw the rows of one agent."""
        rng.random(out=self.detected[begin:end])
        rng.standard_normal(out=self.center[begin:end])
        rng.standard_normal(out=self.size[begin:end])
        rng.standard_normal(out=self.yaw[begin:end])
        rng.random(out=self.flip[begin:end])
        rng.standard_normal(out=self.score[begin:end])


class _FalseBoxes(NamedTuple):
    """Numbers drawn for N false positives: range (m), bearing and heading (rad); size (N, 3) and score, standard
    normal; label, uniform, anything where classes are not confused.
    """

    range_m: Floats
    bearing: Floats
    size: Floats
    yaw: Floats
    score: Floats
    label: Floats


_NO_FALSE_BOXES = _FalseBoxes(*(np.zeros((0, 3) if name == "size" else 0) for name in _FalseBoxes._fields))


def _size_factor(boxes: Boxes3D) -> Floats:
    """Return the factor on position noise, (N, 1): a person's box is not missed by a car's error."""
    room: Floats = np.minimum(1.0, boxes.size[:, :1] / _FALSE_SIZE_M[0])
    return room


def _logistic(logit: Floats) -> Floats:
    return 1.0 / (1.0 + np.exp(-logit))
