"""What a fit to recordings gives a detector: curves over range or returns, and how single errors are spread."""

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
    """Straight lines between points; constant before the first and after the last.

    Attributes:
        at: (K,) where the points are, rising.
        value: (K,) their values.
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
        """Its values (N,) at (N,) places."""
        return np.interp(at, self.at, self.value)

    def require_values(self, name: str, least: float, most: float) -> None:
        """Raise `InvalidValueError` unless all values are in [least, most]."""
        for value in self.value:
            require_between(least, most, **{name: value})


@dataclass(frozen=True, slots=True)
class Found:
    """Whether an object is found, or a phantom believed: with the probability that a curve gives, not anew each frame.

    A standard normal `evidence` that lasts decides: the object is found where it exceeds the normal quantile of
    1 - probability, so that misses come in runs and some objects are overlooked always (a Gaussian copula).

    Attributes:
        chance: probability over whatever decides it.
        persistence: of the evidence.
    """

    chance: Curve
    persistence: Persistence = field(default_factory=Persistence)

    def __post_init__(self) -> None:
        require_parts(Curve, chance=self.chance)
        require_parts(Persistence, persistence=self.persistence)
        self.chance.require_values("chance", 0, 1)

    def decide(self, probability: Floats, evidence: Floats) -> tuple[Mask, Floats]:
        """Who is found (N,), and how clearly, (N,): standard normal among the found; both arguments are (N,)."""
        level = ndtr(-evidence)  # uniform; the smaller, the more evidence
        clearly: Floats = -ndtri(np.clip(level / np.maximum(probability, _EDGE), _EDGE, 1 - _EDGE))
        return level < probability, clearly


@dataclass(frozen=True, slots=True)
class Scored:
    """Scores s of what is reported: logit((s - `floor`) / (1 - `floor`)) is normal.

    Attributes:
        floor: the detector's threshold: nothing below it is reported; in [0, 1).
        logit: its mean over the range in m.
        spread: its standard deviation over the range in m.
        clearness: correlation with how clearly the object was found, in [-1, 1].
        persistence: of the part that is not due to that.
    """

    floor: float
    logit: Curve
    spread: Curve
    clearness: float = 0.0
    persistence: Persistence = field(default_factory=Persistence)

    def __post_init__(self) -> None:
        require_parts(Curve, logit=self.logit, spread=self.spread)
        require_parts(Persistence, persistence=self.persistence)
        require_between(0, 0.999, floor=self.floor)
        require_between(-1, 1, clearness=self.clearness)
        self.spread.require_values("spread", 0, np.inf)

    def score(self, range_m: Floats, clearly: Floats, own: Floats) -> Floats:
        """(N,) from the range, how clearly it was found, and a standard normal number of its own; each (N,)."""
        normal = self.clearness * clearly + np.sqrt(1 - self.clearness**2) * own
        score: Floats = self.floor + (1 - self.floor) * expit(self.logit(range_m) + self.spread(range_m) * normal)
        return score


@dataclass(frozen=True, slots=True)
class Spread:
    """How one number of a box errs: x = `middle` + `spread` * z * exp(`tail` * z^2 / 2) with a normal z that lasts.

    That is Tukey's h-distribution: the larger the tail, the more outliers; with 0 it is normal.

    Attributes:
        spread: over the range in m.
        middle: median error over the range in m.
        tail: in [0, 0.5].
        persistence: of z.
    """

    spread: Curve
    middle: Curve = field(default_factory=lambda: Curve((0.0,), (0.0,)))
    tail: float = 0.0
    persistence: Persistence = field(default_factory=Persistence)

    def __post_init__(self) -> None:
        require_parts(Curve, spread=self.spread, middle=self.middle)
        require_parts(Persistence, persistence=self.persistence)
        require_between(0, 0.5, tail=self.tail)
        self.spread.require_values("spread", 0, np.inf)

    def error(self, range_m: Floats, normal: Floats) -> Floats:
        """(N,) errors from ranges and standard normal numbers, (N,)."""
        return self.middle(range_m) + self.spread(range_m) * normal * np.exp(self.tail * normal**2 / 2)


def require_parts(wanted: type[Any], **parts: object) -> None:
    """Each must be an object of the class `wanted`; raises `InvalidValueError`."""
    for name, part in parts.items():
        if not isinstance(part, wanted):
            raise InvalidValueError(f"{name} must be a coopsim {wanted.__name__}, got {part!r}")
