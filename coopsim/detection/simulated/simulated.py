"""A detector without a network: it reports the truth as far as the LiDAR's returns support it.

An object can be detected only if enough of its returns were received; from there on recall rises, and noise falls, with
the number of returns, and noise grows with range. The score states, with noise of its own, how probable the detection
was; false positives score low. All errors are independent from frame to frame (unlike those of `CorrelatedDetector`).
"""

from __future__ import annotations

from dataclasses import asdict, dataclass

import numpy as np

from coopsim.detection.oracle import Oracle, OracleDetector
from coopsim.detection.simulated.confusion import ClassConfusion
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


@dataclass(frozen=True, slots=True)
class SimulatedDetectorConfig:
    """Parameters of `SimulatedDetector`.

    With n returns at range r (m):

    - P(detect) = `max_recall` * (1 - exp(-(n - `min_points` + 1) / `recall_points`)) for n >= `min_points`,
      else 0;
    - noise has the scale s = 1 + `range_gain_per_m` * r + `sparse_gain` / sqrt(n);
    - score = logistic(`score_gain` * (P - `score_offset`) + `score_noise` * N(0, 1)).

    Attributes:
        min_points: fewest returns with which an object can be detected.
        recall_points: returns beyond `min_points` at which 63 % of `max_recall` is reached.
        max_recall: recall of a perfectly sampled object, in [0, 1].
        position_noise_m: of x, y and z at scale 1.
        size_noise: of length, width and height, relative, at scale 1.
        yaw_noise_rad: of the heading at scale 1.
        yaw_flip: probability that the heading is reported the wrong way round.
        range_gain_per_m: growth of the noise with range.
        sparse_gain: growth of the noise for few points.
        score_gain: steepness of the score.
        score_offset: P(detect) at which the score is 0.5.
        score_noise: standard deviation of the score's logit.
        false_positives: mean number of false boxes a frame (Poisson), at most 10 000.
        false_positive_range_m: they lie at least half a car length and at most this far away.
        false_positive_logit: mean logit of their score.
        confusion: how classes are confused, anew in each frame; None: every label is right.
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

    _FALSE_SIZE_M = np.array([4.3, 1.9, 1.6])

    def __init__(self, config: SimulatedDetectorConfig | None = None) -> None:
        require_instance(SimulatedDetectorConfig, config=config)
        self.config = config or SimulatedDetectorConfig()

    def detect(self, view: SensorView, oracle: Oracle, rng: np.random.Generator) -> Detections:
        """Report the objects of one frame; see `OracleDetector.detect`."""
        actors, returns = oracle.actors, oracle.returns
        probability = self.recall(returns)
        # Draws are made for every actor, seen or not, so that a hidden actor does not shift the noise of the others.
        detected = rng.random(len(actors)) < probability
        boxes = self._disturb(actors.boxes, returns, rng)
        score = self._score(probability, rng)
        false = self._false_positives(rng)
        label = actors.label
        if self.config.confusion is not None:
            label = self.config.confusion.confuse(label, rng.random(len(actors)))
        return Detections.concatenate([Detections(boxes, score, label)[detected], false])

    def recall(self, returns: Ints) -> Floats:
        """Return P(detect) for numbers of returns (N,)."""
        config = self.config
        surplus = np.maximum(returns - config.min_points + 1, 0)
        return config.max_recall * -np.expm1(-surplus / config.recall_points)

    def noise_scale(self, returns: Ints, range_m: Floats) -> Floats:
        """Return the factor on all box noise, (N,), for numbers of returns and ranges (N,)."""
        sparse = self.config.sparse_gain / np.sqrt(np.maximum(returns, 1))
        return 1.0 + self.config.range_gain_per_m * range_m + sparse

    def _disturb(self, boxes: Boxes3D, returns: Ints, rng: np.random.Generator) -> Boxes3D:
        config, count = self.config, len(boxes)
        scale = self.noise_scale(returns, np.linalg.norm(boxes.center[:, :2], axis=1))[:, None]
        # A small object leaves less room to be wrong in: a person's box is not missed by a car's error.
        room = np.minimum(1.0, boxes.size[:, :1] / self._FALSE_SIZE_M[0])
        center = boxes.center + rng.standard_normal((count, 3)) * config.position_noise_m * scale * room
        size = boxes.size * np.exp(rng.standard_normal((count, 3)) * config.size_noise * scale)
        turn = rng.standard_normal(count) * config.yaw_noise_rad * scale[:, 0]
        flip = np.where(rng.random(count) < config.yaw_flip, np.pi, 0.0)
        return Boxes3D(center, size, wrap_angle(boxes.yaw + turn + flip))

    def _score(self, probability: Floats, rng: np.random.Generator) -> Floats:
        config = self.config
        noise = config.score_noise * rng.standard_normal(len(probability))
        return _logistic(config.score_gain * (probability - config.score_offset) + noise)

    def _false_positives(self, rng: np.random.Generator) -> Detections:
        config = self.config
        count = int(rng.poisson(config.false_positives))
        if not count:
            return Detections.empty()
        range_m = rng.uniform(self._FALSE_SIZE_M[0] / 2, max(config.false_positive_range_m, 3.0), count)
        bearing = rng.uniform(-np.pi, np.pi, count)
        size = self._FALSE_SIZE_M * np.exp(0.1 * rng.standard_normal((count, 3)))
        center = np.column_stack([range_m * np.cos(bearing), range_m * np.sin(bearing), size[:, 2] / 2])
        boxes = Boxes3D(center, size, rng.uniform(-np.pi, np.pi, count))
        score = _logistic(config.false_positive_logit + config.score_noise * rng.standard_normal(count))
        label = np.full(count, int(ObjectClass.CAR))
        if config.confusion is not None:
            label = config.confusion.confuse(label, rng.random(count))
        return Detections(boxes, score, label)


def _logistic(logit: Floats) -> Floats:
    return 1.0 / (1.0 + np.exp(-logit))
