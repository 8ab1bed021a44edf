"""A detector without a network: it looks at the truth, but sees only what the LiDAR's returns support.

An object is detectable only if enough of its returns were received; from there on recall rises, and noise
falls, with the number of returns, and noise grows with range. The score reports, with noise of its own,
how probable the detection was; false positives score low.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import ClassVar

import numpy as np
from numba import njit

from coopsim.errors import InvalidValueError
from coopsim.geometry.boxes import Boxes3D
from coopsim.geometry.se3 import SE3, Floats, wrap_angle
from coopsim.support.checks import (
    require_between,
    require_count,
    require_finite_number,
    require_instance,
    require_non_negative,
    require_positive,
    require_probability,
)
from coopsim.types import Detections, Ints, Sweep
from coopsim.types.taxonomy import ObjectClass
from coopsim.world.snapshot import Actors


class Detector(ABC):
    """Boxes from one agent's sweeps.

    Attributes:
        embedding_dim: length of the embeddings that its detections have; 0: none.
        states_covariance: whether its detections have covariances.
        needs_sweeps: False for a detector that has `detect_from_returns`, too, and so works where there is no LiDAR.
    """

    embedding_dim: int = 0
    states_covariance: bool = False
    needs_sweeps: ClassVar[bool] = True

    def begin(self, seed: int, agent: str, dt_s: float) -> Detector:
        """The detector of one agent for one episode: this one itself, unless it remembers anything.

        Args:
            seed: the episode's seed.
            agent: the agent's name, which owns its random streams.
            dt_s: time between two frames.
        """
        return self

    def move(self, world_SE3_base: SE3) -> None:
        """Told before each frame's detection where the agent truly is. For simulated detectors only."""

    @abstractmethod
    def detect(self, sweeps: Mapping[str, Sweep], truth: Actors, rng: np.random.Generator) -> Detections:
        """Detect the objects of one frame, in the agent's base frame.

        Args:
            sweeps: by sensor name, with instance ids.
            truth: all actors but the agent itself, in its base frame. Only a simulated detector looks at it.
            rng: the agent's stream for this purpose.
        """

    def detect_from_returns(self, returns: Ints, truth: Actors, rng: np.random.Generator) -> Detections:
        """Detect the objects of one frame by how many returns a LiDAR would have of each.

        Args:
            returns: (N,) by actor.
            truth: the N actors, as in `detect`.
            rng: as in `detect`.

        Raises:
            InvalidValueError: the detector needs sweeps.
        """
        raise InvalidValueError(f"{type(self).__name__} needs sweeps, which there are none of")


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

    def __post_init__(self) -> None:
        unsigned = asdict(self)
        require_finite_number(**{name: unsigned.pop(name) for name in ("score_offset", "false_positive_logit")})
        require_non_negative(**unsigned)
        require_between(0, 10_000, false_positives=self.false_positives)
        require_count(1, min_points=self.min_points)
        require_positive(recall_points=self.recall_points)
        require_probability(max_recall=self.max_recall, yaw_flip=self.yaw_flip)


class SimulatedDetector(Detector):
    """Truth, thinned and disturbed as the returns allow; see `SimulatedDetectorConfig` for the model."""

    needs_sweeps = False
    _FALSE_SIZE_M = np.array([4.3, 1.9, 1.6])

    def __init__(self, config: SimulatedDetectorConfig | None = None) -> None:
        require_instance(SimulatedDetectorConfig, config=config)
        self.config = config or SimulatedDetectorConfig()

    def detect(self, sweeps: Mapping[str, Sweep], truth: Actors, rng: np.random.Generator) -> Detections:
        return self.detect_from_returns(count_returns(sweeps, truth.id), truth, rng)

    def detect_from_returns(self, returns: Ints, truth: Actors, rng: np.random.Generator) -> Detections:
        probability = self.recall(returns)
        # Draws are made for every actor, seen or not, so that which one is hidden does not shift the others'.
        found = rng.random(len(truth)) < probability
        boxes = self._disturb(truth.boxes, returns, rng)
        score = self._score(probability, rng)
        real = Detections(boxes, score, truth.label)[found]
        return Detections.concatenate([real, self._false_positives(rng)])

    def recall(self, returns: Ints) -> Floats:
        """P(detect) for (N,) numbers of returns."""
        config = self.config
        surplus = np.maximum(returns - config.min_points + 1, 0)
        return config.max_recall * -np.expm1(-surplus / config.recall_points)

    def noise_scale(self, returns: Ints, range_m: Floats) -> Floats:
        """The factor on all box noise, (N,), for numbers of returns and ranges (N,)."""
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
        return Detections(boxes, score, np.full(count, int(ObjectClass.CAR)))


def count_returns(sweeps: Mapping[str, Sweep], ids: Ints) -> Ints:
    """Number of LiDAR returns from each of the actors `ids` (N,), over all sweeps; (N,)."""
    counts = np.zeros(len(ids), dtype=np.int64)
    order = np.argsort(ids)
    ordered = ids[order]
    for name, sweep in sweeps.items():
        if sweep.instance is None:
            raise InvalidValueError(f"sweep {name!r} has no instance ids to count returns by")
        counts[order] += _tally(sweep.instance, ordered)
    return counts


@njit(cache=True, nogil=True)
def _tally(instance: Ints, ids: Ints) -> Ints:
    """How often each of `ids` (N,), which rise, is among instances (P,); (N,)."""
    counts = np.zeros(len(ids) + 1, np.int64)  # the last is of all others
    slot = len(ids)
    for p in range(len(instance)):
        if p == 0 or instance[p] != instance[p - 1]:  # neighbouring rays mostly hit the same actor
            slot = np.searchsorted(ids, instance[p])
            if slot < len(ids) and ids[slot] != instance[p]:
                slot = len(ids)
        counts[slot] += 1
    return counts[:-1]


def _logistic(logit: Floats) -> Floats:
    return 1.0 / (1.0 + np.exp(-logit))
