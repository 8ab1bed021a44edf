"""Models of a message's delay on a link. Waiting for the medium comes on top: `coopsim.comms.channel.bandwidth`.

Every model maps one standard normal number to a delay that grows with it. So two runs that differ only in the model
delay the same messages longest, and every delay takes one draw.
"""

from __future__ import annotations

import csv
import math
import re
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from scipy.special import gammaincinv, ndtr

from coopsim.errors import InvalidValueError
from coopsim.geometry.se3 import Floats
from coopsim.support.arrays import as_numbers
from coopsim.support.checks import require_between
from coopsim.types import seconds_to_ns

MOST_S = 3600.0
"""The longest delay: more than any episode is a slip, and might not fit the clock."""

_LEAST_S = 1e-9
_MOST_USUAL_S = 10.0
_MILLISECONDS = re.compile(r"(^|[^a-z])ms[^a-z0-9]*$", re.IGNORECASE)


class Latency(ABC):
    """Distribution of delays."""

    @abstractmethod
    def delay_s(self, normal: float) -> float:
        """Return the delay (s) at the quantile of a standard normal number; it never falls as `normal` grows."""

    def draw_ns(self, rng: np.random.Generator) -> int:
        """Draw one message's delay, ns, in [0, `MOST_S`]. Takes one normal from `rng`, whatever the parameters."""
        return seconds_to_ns(min(max(0.0, self.delay_s(float(rng.standard_normal()))), MOST_S))


@dataclass(frozen=True, slots=True)
class GaussianLatency(Latency):
    """Gaussian delay, cut off at zero; any value, not only multiples of a frame.

    Attributes:
        mean_s: mean delay, at most `MOST_S`.
        jitter_s: standard deviation, at most `MOST_S`; 0: a fixed delay.
    """

    mean_s: float = 0.0
    jitter_s: float = 0.0

    def __post_init__(self) -> None:
        require_between(0, MOST_S, mean_s=self.mean_s, jitter_s=self.jitter_s)

    def delay_s(self, normal: float) -> float:
        return self.mean_s + self.jitter_s * normal


def fixed_delay_ns(latency: Latency) -> int | None:
    """Return the delay that a model gives every message, ns; None if its draws matter."""
    if type(latency) is GaussianLatency and not latency.jitter_s:  # a subclass may have another rule
        return seconds_to_ns(min(max(0.0, latency.mean_s), MOST_S))
    return None


@dataclass(frozen=True, slots=True)
class _PositiveLatency(Latency):
    """Positive delay by mean, in [1e-9, `MOST_S`], and standard deviation, in [0, `MOST_S`]."""

    mean_s: float
    jitter_s: float

    def __post_init__(self) -> None:
        require_between(_LEAST_S, MOST_S, mean_s=self.mean_s)
        require_between(0, MOST_S, jitter_s=self.jitter_s)


@dataclass(frozen=True, slots=True)
class LogNormalLatency(_PositiveLatency):
    """Log-normal delay by mean (s) and standard deviation (s): never negative, with a long tail."""

    def delay_s(self, normal: float) -> float:
        variance = 2 * math.log(math.hypot(1.0, self.jitter_s / self.mean_s))  # of the logarithm
        exponent = math.log(self.mean_s) - variance / 2 + math.sqrt(variance) * normal
        return math.exp(min(exponent, math.log(MOST_S)))


@dataclass(frozen=True, slots=True)
class GammaLatency(_PositiveLatency):
    """Gamma-distributed delay by mean (s) and standard deviation (s): never negative, lighter tail than log-normal."""

    def delay_s(self, normal: float) -> float:
        ratio = self.jitter_s / self.mean_s
        if ratio**2 < 1e-6:  # a gamma so narrow is normal, and its quantile is hard to compute
            return self.mean_s + self.jitter_s * normal
        return float(gammaincinv(ratio**-2, float(ndtr(normal)))) * self.mean_s * ratio**2


@dataclass(frozen=True, slots=True)
class EmpiricalLatency(Latency):
    """Delays drawn with equal probability from measured ones.

    Attributes:
        samples_s: at least one delay, each in [0, `MOST_S`], in any order.
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
        object.__setattr__(self, "samples_s", tuple(np.atleast_1d(self.samples_s).tolist()))
        object.__setattr__(self, "_sorted_s", samples)

    @classmethod
    def from_csv(cls, path: str | Path) -> EmpiricalLatency:
        """Read delays from a file with one column, a number in each line; the first line may be a heading.

        They are seconds, or milliseconds if the heading ends in "ms" ("latency_ms", "delay [ms]"). Seconds with a
        median above 10 s are refused: they look like milliseconds.

        Raises:
            InvalidValueError: the file cannot be read; the message names file, line and cause.
        """
        heading, samples, unit_s = "", [], 1.0
        for number, row in enumerate(_rows(path), start=1):
            if len(row) > 1:
                raise InvalidValueError(f"{path}, line {number}: delays are one column, got {len(row)}")
            if not row or not row[0].strip():
                continue
            if number == 1 and not _is_number(row[0]):
                heading = row[0].strip()
                unit_s = 1e-3 if _MILLISECONDS.search(heading) else 1.0
                continue
            most = MOST_S / unit_s
            if not (_is_number(row[0]) and 0 <= float(row[0]) <= most):
                unit = "s" if unit_s == 1 else "ms"
                raise InvalidValueError(f"{path}, line {number}: a delay is in [0, {most:g}] {unit}, got {row[0]!r}")
            samples.append(float(row[0]) * unit_s)
        if not samples:
            raise InvalidValueError(f"{path}: there must be at least one delay")
        if np.median(samples) > _MOST_USUAL_S:
            raise InvalidValueError(
                f"{path}: half of the delays are above {_MOST_USUAL_S:g} s, which they are taken for; if they are "
                f'milliseconds, the heading must end in "ms", got {heading or "none"!r}'
            )
        return cls(tuple(samples))

    def delay_s(self, normal: float) -> float:
        rank = int(ndtr(normal) * len(self._sorted_s))
        return float(self._sorted_s[min(rank, len(self._sorted_s) - 1)])


def empirical_latency(
    path: str | Path | None = None, samples_s: Sequence[float] | float | None = None
) -> EmpiricalLatency:
    """Make an empirical latency from a file (see `EmpiricalLatency.from_csv`) or from delays, never from both."""
    if (path is None) == (samples_s is None):
        raise InvalidValueError(f"an empirical latency has either path or samples_s, got {path!r} and {samples_s!r}")
    return EmpiricalLatency(samples_s) if path is None else EmpiricalLatency.from_csv(path)  # type: ignore[arg-type]


LATENCIES: Mapping[str, Callable[..., Latency]] = {
    "gaussian": GaussianLatency,
    "log_normal": LogNormalLatency,
    "gamma": GammaLatency,
    "empirical": empirical_latency,
}
"""Latencies by the names that files have for them."""


def _rows(path: str | Path) -> list[list[str]]:
    if not isinstance(path, (str, Path)):
        raise InvalidValueError(f"the path of a file of delays must be a str or a Path, got {path!r}")
    try:
        return list(csv.reader(Path(path).read_text(encoding="utf-8-sig").splitlines()))
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise InvalidValueError(f"cannot read the delays in {path}: {error}") from error


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True
