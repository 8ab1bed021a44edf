"""How long a message is on the way, by itself: what waiting for the medium adds is in `coopsim.comms.bandwidth`.

Every model turns one standard normal number into a delay that grows with it. So two runs that differ only in the model
have their long delays at the same messages, and a longer delay takes no more draws than a short one.
"""

from __future__ import annotations

import csv
import math
from abc import ABC, abstractmethod
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from scipy.special import gammaincinv, ndtr

from coopsim.arrays import as_numbers
from coopsim.checks import require_between, require_non_negative
from coopsim.errors import InvalidValueError
from coopsim.geometry.se3 import Floats
from coopsim.types import seconds_to_ns

MOST_S = 3600.0
"""The longest delay; what is longer than any episode is a slip, and might not fit the clock."""

_LEAST_S = 1e-9


class Latency(ABC):
    """A distribution of delays."""

    @abstractmethod
    def delay_s(self, normal: float) -> float:
        """The delay at a standard normal number: its quantile, s; never falls as `normal` grows."""

    def draw_ns(self, rng: np.random.Generator) -> int:
        """One message's delay, ns, in [0, `MOST_S`]. Takes one normal from `rng`, whatever the parameters."""
        return seconds_to_ns(min(max(0.0, self.delay_s(float(rng.standard_normal()))), MOST_S))


@dataclass(frozen=True, slots=True)
class GaussianLatency(Latency):
    """A fixed delay with Gaussian jitter, cut off at zero; any value, not only multiples of a frame.

    Attributes:
        mean_s: the delay, at most `MOST_S`.
        jitter_s: its standard deviation, at most `MOST_S`; 0 makes it fixed.
    """

    mean_s: float = 0.0
    jitter_s: float = 0.0

    def __post_init__(self) -> None:
        delays = {"latency_s": self.mean_s, "latency_jitter_s": self.jitter_s}
        require_non_negative(**delays)
        require_between(0, MOST_S, **delays)

    def delay_s(self, normal: float) -> float:
        return self.mean_s + self.jitter_s * normal


@dataclass(frozen=True, slots=True)
class _ByMoments(Latency):
    """A positive delay that two numbers describe.

    Attributes:
        mean_s: its mean, in [1e-9, `MOST_S`].
        jitter_s: its standard deviation, in [0, `MOST_S`].
    """

    mean_s: float
    jitter_s: float

    def __post_init__(self) -> None:
        _require_moments(self.mean_s, self.jitter_s)


@dataclass(frozen=True, slots=True)
class LogNormalLatency(_ByMoments):
    """A log-normal delay, by its mean (s) and standard deviation (s): never negative, with a long tail."""

    def delay_s(self, normal: float) -> float:
        variance = 2 * math.log(math.hypot(1.0, self.jitter_s / self.mean_s))  # of the logarithm
        exponent = math.log(self.mean_s) - variance / 2 + math.sqrt(variance) * normal
        return math.exp(min(exponent, math.log(MOST_S)))


@dataclass(frozen=True, slots=True)
class GammaLatency(_ByMoments):
    """A gamma-distributed delay, by its mean (s) and standard deviation (s): never negative, with a lighter tail than
    `LogNormalLatency`.
    """

    def delay_s(self, normal: float) -> float:
        ratio = self.jitter_s / self.mean_s
        if ratio**2 < 1e-6:  # a gamma so narrow is normal, and its quantile is hard to compute
            return self.mean_s + self.jitter_s * normal
        return float(gammaincinv(ratio**-2, float(ndtr(normal)))) * self.mean_s * ratio**2


@dataclass(frozen=True, slots=True)
class EmpiricalLatency(Latency):
    """Delays drawn, with equal chances, from measured ones.

    Attributes:
        samples_s: at least one, each in [0, `MOST_S`], in any order.
    """

    samples_s: tuple[float, ...]
    _sorted_s: Floats = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        samples = np.sort(as_numbers(self.samples_s, np.float64, "samples_s").reshape(-1))
        if not len(samples):
            raise InvalidValueError("samples_s must be at least one delay, got none")
        wrong = samples[~((samples >= 0) & (samples <= MOST_S))]
        if len(wrong):
            raise InvalidValueError(f"samples_s must be in [0, {MOST_S:g}], got {wrong[0]}")
        object.__setattr__(self, "samples_s", tuple(self.samples_s))
        object.__setattr__(self, "_sorted_s", samples)

    @classmethod
    def from_csv(cls, path: str | Path) -> EmpiricalLatency:
        """Read delays in seconds: a file with one column, a number in each line; a first line may be a heading.

        Raises:
            InvalidValueError: names the file, the line and what is wrong.
        """
        try:
            text = Path(path).read_text(encoding="utf-8")
        except (OSError, UnicodeDecodeError) as error:
            raise InvalidValueError(f"cannot read the delays in {path}: {error}") from error
        samples = []
        for number, row in enumerate(csv.reader(text.splitlines()), start=1):
            if len(row) > 1:
                raise InvalidValueError(f"{path}, line {number}: delays are one column, got {len(row)}")
            if not row or (number == 1 and not _is_number(row[0])):
                continue
            if not (_is_number(row[0]) and 0 <= float(row[0]) <= MOST_S):
                raise InvalidValueError(f"{path}, line {number}: a delay is in [0, {MOST_S:g}] s, got {row[0]!r}")
            samples.append(float(row[0]))
        if not samples:
            raise InvalidValueError(f"{path}: there must be at least one delay")
        return cls(tuple(samples))

    def delay_s(self, normal: float) -> float:
        place = int(ndtr(normal) * len(self._sorted_s))
        return float(self._sorted_s[min(place, len(self._sorted_s) - 1)])


def _require_moments(mean_s: object, jitter_s: object) -> None:
    require_between(_LEAST_S, MOST_S, latency_s=mean_s)
    require_between(0, MOST_S, latency_jitter_s=jitter_s)


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True
