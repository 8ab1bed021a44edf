"""Parts of a fitted detector: curves, and models of detection, score, box errors and class confusion."""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from scipy.special import expit, ndtr, ndtri

from coopsim.detection.simulated.persistence import Persistence, PersistentNormals
from coopsim.errors import InvalidValueError
from coopsim.geometry.se3 import Floats
from coopsim.support.checks import require_between, require_choice, require_finite_number, require_probability
from coopsim.support.kernels import njit
from coopsim.types import Ints, Mask
from coopsim.types.taxonomy import CLASS_NAMES

_EDGE = 1e-12  # of probabilities, so that their normal quantiles are finite


@dataclass(frozen=True, slots=True)
class Curve:
    """Piecewise linear function by K points at rising abscissas; constant before and after them."""

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


class Curves:
    """K curves over the same variable, evaluated together: the bits of each `Curve`, in a fraction of the time."""

    def __init__(self, *curves: Curve) -> None:
        self._count = np.array([len(curve.at) for curve in curves])
        self._at = np.zeros((len(curves), int(self._count.max())))
        self._value = np.zeros_like(self._at)
        for k, curve in enumerate(curves):
            self._at[k, : len(curve.at)], self._value[k, : len(curve.at)] = curve.at, curve.value

    def __call__(self, at: Floats) -> Floats:
        """Evaluate the functions at (N,) abscissas; returns (K, N)."""
        values: Floats = _interpolate(at, self._count, self._at, self._value)
        return values


@njit(cache=True, nogil=True)
def _interpolate(at: Floats, count: Ints, places: Floats, values: Floats) -> Floats:
    """Interpolate at (N,) abscissas, in the order of operations of `np.interp`, for `count` (K,) points; (K, N).

    Abscissas are no NaN.
    """
    found = np.empty((len(count), len(at)))
    for k in range(len(count)):
        last = count[k] - 1
        for n in range(len(at)):
            if not at[n] > places[k, 0]:
                found[k, n] = values[k, 0]
                continue
            if at[n] >= places[k, last]:
                found[k, n] = values[k, last]
                continue
            j = 0
            while at[n] >= places[k, j + 1]:
                j += 1
            slope = (values[k, j + 1] - values[k, j]) / (places[k, j + 1] - places[k, j])
            found[k, n] = values[k, j] if at[n] == places[k, j] else slope * (at[n] - places[k, j]) + values[k, j]
    return found


@dataclass(frozen=True, slots=True)
class DetectionModel:
    """Model of the detection of an object (or a phantom) in a frame.

    A Gaussian copula: a standard normal `evidence`, correlated over time by `persistence`, is compared with the
    quantile of 1 - `probability`, a curve over the variable that decides it. So misses come in runs, and some objects
    are always missed.
    """

    probability: Curve
    persistence: Persistence = field(default_factory=Persistence)

    def __post_init__(self) -> None:
        require_parts(Curve, probability=self.probability)
        require_parts(Persistence, persistence=self.persistence)
        self.probability.require_values("probability", 0, 1)

    def decide(self, probability: Floats, evidence: Floats) -> tuple[Mask, Floats]:
        """Decide which objects are detected, by probability (N,) and standard normal evidence (N,).

        Returns the mask (N,) of detected objects, and a margin (N,), standard normal among the detected.
        """
        level = ndtr(-evidence)  # uniform; the smaller, the more evidence
        share = level / np.maximum(probability, _EDGE)
        margin: Floats = -ndtri(np.minimum(np.maximum(share, _EDGE), 1 - _EDGE))
        return level < probability, margin


@dataclass(frozen=True, slots=True)
class ScoreModel:
    """Model of the score s of a detection: logit((s - `floor`) / (1 - `floor`)) is normal.

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
        return self.score_of(self.logit(range_m), self.spread(range_m), margin, normal)

    def score_of(self, logit: Floats, spread: Floats, margin: Floats, normal: Floats) -> Floats:
        """Return scores (N,) from the curves' values at the range, and as `score`."""
        mixed = self.margin_correlation * margin + math.sqrt(1 - self.margin_correlation**2) * normal
        score: Floats = self.floor + (1 - self.floor) * expit(logit + spread * mixed)
        return score


@dataclass(frozen=True, slots=True)
class ErrorModel:
    """Model of the error x of one number of a box: x = `median` + `spread` * z * exp(`tail` * z^2 / 2), z standard
    normal.

    This is Tukey's h-distribution: the larger the tail, in [0, 0.5], the more outliers; with 0 it is normal. Spread
    and median are over the range in m, persistence is that of z.
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


@dataclass(frozen=True, slots=True)
class ClassConfusion:
    """Confusion matrix, and the duration of a confusion.

    Attributes:
        shares: share of the detections of a true class that are reported as another, by true and then by reported
            class. The rest of each row is reported as it is.
        persistence: correlation over time of the standard normal number that decides, for one agent and object.
    """

    shares: Mapping[str, Mapping[str, float]]
    persistence: Persistence = field(default_factory=Persistence)

    def __post_init__(self) -> None:
        if not (isinstance(self.shares, Mapping) and all(isinstance(row, Mapping) for row in self.shares.values())):
            raise InvalidValueError(f"shares must be a mapping of mappings by class, got {self.shares!r}")
        if not isinstance(self.persistence, Persistence):
            raise InvalidValueError(f"persistence must be a coopsim Persistence, got {self.persistence!r}")
        for true, row in self.shares.items():
            require_choice("class in shares", true, CLASS_NAMES)
            for reported, share in row.items():
                require_choice(f"class in shares of {true}", reported, CLASS_NAMES)
                require_probability(**{f"share of {true} reported as {reported}": share})
            if true in row or sum(row.values()) > 1:
                raise InvalidValueError(f"shares of {true} must be of other classes and at most 1 together, got {row}")

    @property
    def matrix(self) -> Floats:
        """The confusion matrix (9, 9): rows are true classes, columns reported ones; each row sums to 1."""
        matrix = np.zeros((len(CLASS_NAMES), len(CLASS_NAMES)))
        for true, row in self.shares.items():
            for reported, share in row.items():
                matrix[CLASS_NAMES.index(true), CLASS_NAMES.index(reported)] = share
        np.fill_diagonal(matrix, 1.0 - matrix.sum(axis=1))
        return matrix

    @property
    def levels(self) -> Floats:
        """The matrix without its diagonal (9, 9), each row added up from its start: what `confuse` is given."""
        others = self.matrix
        np.fill_diagonal(others, 0.0)
        levels: Floats = np.cumsum(others, axis=1)
        return levels


def confuse(levels: Floats, label: Ints, uniform: Floats) -> Ints:
    """Return the reported labels (N,) for true labels (N,) and draws (N,), uniform in [0, 1]."""
    row = levels[label]
    wrong = uniform < row[:, -1]
    reported: Ints = np.where(wrong, np.argmax(uniform[:, None] < row, axis=1), label)
    return reported


class LabelNoise:
    """Class confusions of agents over one episode; call once per frame, in order."""

    def __init__(self, config: ClassConfusion, seed: int, owners: Sequence[str], dt_s: Sequence[float]) -> None:
        self._levels = config.levels
        owners = [f"classes, {owner}" for owner in owners]
        self._normals = PersistentNormals(seed, owners, (config.persistence,), dt_s)

    def step(self, asked: Ints, start: Ints, ids: Ints, wanted: Ints, label: Ints) -> Ints:
        """Return the labels (M,) that are reported for the objects `wanted`, whose true labels (M,) are given.

        The other arguments are those of `PersistentNormals.step`.
        """
        return confuse(self._levels, label, ndtr(self._normals.step(asked, start, ids, wanted)[:, 0]))
