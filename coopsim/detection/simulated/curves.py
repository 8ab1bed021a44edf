"""The parts of a fitted detector: curves over range or returns, and models of detection, score and box errors."""

from __future__ import annotations

import itertools
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from scipy.special import expit, ndtr, ndtri

from coopsim.detection.simulated.persistence import Persistence
from coopsim.errors import InvalidValueError
from coopsim.geometry.se3 import Floats
from coopsim.support.checks import require_between, require_finite_number
from coopsim.types import Mask

_EDGE = 1e-12  # of probabilities, so that their normal quantiles are finite


@dataclass(frozen=True, slots=True)
class Curve:
    """A piecewise linear function; constant before its first point and after its last.

    Attributes:
        at: (K,) abscissas of the points, strictly rising.
        value: (K,) ordinates.
    """

    at: tuple[float, ...]
    value: tuple[float, ...]

    def __post_init__(self) -> None:
        for name in ("at", "value"):
            numbers = getattr(self, name)
            if not isinstance(numbers, (tuple, list)):
                raise InvalidValueError(f"{name} must be a sequence of numbers, got {numbers!r}")
            for number in numbers:
                require_finite_number(**{name: number})
            object.__setattr__(self, name, tuple(map(float, numbers)))
        if not self.at or len(self.at) != len(self.value):
            raise InvalidValueError(
                f"a curve needs as many values as places, at least one, got {len(self.value)} and {len(self.at)}"
            )
        if any(left >= right for left, right in itertools.pairwise(self.at)):
            raise InvalidValueError(f"at must rise, got {self.at}")

    def __call__(self, at: Floats) -> Floats:
        """Evaluate the function at (N,) abscissas; returns (N,)."""
        return np.interp(at, self.at, self.value)

    def require_values(self, name: str, least: float, most: float) -> None:
        """Raise `InvalidValueError` unless all ordinates are in [least, most]."""
        for value in self.value:
            require_between(least, most, **{name: value})


@dataclass(frozen=True, slots=True)
class DetectionModel:
    """Model of the detection of an object (or a phantom) in a frame.

    A Gaussian copula: a standard normal `evidence`, correlated over time, is compared with the quantile of
    1 - probability. So misses come in runs, and some objects are always missed.

    Attributes:
        probability: probability of detection over the variable that decides it.
        persistence: correlation of the evidence over time.
    """

    probability: Curve
    persistence: Persistence = field(default_factory=Persistence)

    def __post_init__(self) -> None:
        require_parts(Curve, probability=self.probability)
        require_parts(Persistence, persistence=self.persistence)
        self.probability.require_values("probability", 0, 1)

    def decide(self, probability: Floats, evidence: Floats) -> tuple[Mask, Floats]:
        """Decide which objects are detected.

        Args:
            probability: (N,) of detection.
            evidence: (N,) standard normal.

        Returns:
            The mask (N,) of detected objects, and a margin (N,), standard normal among the detected.
        """
        level = ndtr(-evidence)  # uniform; the smaller, the more evidence
        margin: Floats = -ndtri(np.clip(level / np.maximum(probability, _EDGE), _EDGE, 1 - _EDGE))
        return level < probability, margin


@dataclass(frozen=True, slots=True)
class ScoreModel:
    """The score s of a detection: logit((s - `floor`) / (1 - `floor`)) is normal.

    Attributes:
        floor: the detector's threshold, below which nothing is reported; in [0, 1).
        logit: mean of the logit over the range in m.
        spread: standard deviation of the logit over the range in m.
        margin_correlation: correlation with the margin of the `DetectionModel`, in [-1, 1].
        persistence: correlation over time of the part that is independent of the margin.
    """

    floor: float
    logit: Curve
    spread: Curve
    margin_correlation: float = 0.0
    persistence: Persistence = field(default_factory=Persistence)

    def __post_init__(self) -> None:
        require_parts(Curve, logit=self.logit, spread=self.spread)
        require_parts(Persistence, persistence=self.persistence)
        require_between(0, 0.999, floor=self.floor)
        require_between(-1, 1, margin_correlation=self.margin_correlation)
        self.spread.require_values("spread", 0, np.inf)

    def score(self, range_m: Floats, margin: Floats, normal: Floats) -> Floats:
        """Return scores (N,) from range, margin of detection and an independent standard normal number; each (N,)."""
        mixed = self.margin_correlation * margin + np.sqrt(1 - self.margin_correlation**2) * normal
        score: Floats = self.floor + (1 - self.floor) * expit(self.logit(range_m) + self.spread(range_m) * mixed)
        return score


@dataclass(frozen=True, slots=True)
class ErrorModel:
    """The error x of one number of a box: x = `median` + `spread` * z * exp(`tail` * z^2 / 2), z standard normal.

    This is Tukey's h-distribution: the larger the tail, the more outliers; with 0 it is normal.

    Attributes:
        spread: over the range in m.
        median: median error over the range in m.
        tail: in [0, 0.5].
        persistence: correlation of z over time.
    """

    spread: Curve
    median: Curve = field(default_factory=lambda: Curve((0.0,), (0.0,)))
    tail: float = 0.0
    persistence: Persistence = field(default_factory=Persistence)

    def __post_init__(self) -> None:
        require_parts(Curve, spread=self.spread, median=self.median)
        require_parts(Persistence, persistence=self.persistence)
        require_between(0, 0.5, tail=self.tail)
        self.spread.require_values("spread", 0, np.inf)

    def error(self, range_m: Floats, normal: Floats) -> Floats:
        """Return errors (N,) from ranges and standard normal numbers, (N,) each."""
        return self.median(range_m) + self.spread(range_m) * normal * np.exp(self.tail * normal**2 / 2)


def require_parts(wanted: type[Any], **parts: object) -> None:
    """Raise `InvalidValueError` unless each is an object of the class `wanted`."""
    for name, part in parts.items():
        if not isinstance(part, wanted):
            raise InvalidValueError(f"{name} must be a coopsim {wanted.__name__}, got {part!r}")
