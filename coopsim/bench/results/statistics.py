"""Statistics of a few seeds: intervals of means and rates, and tests of paired differences.

SciPy has no studentised bootstrap, and its `permutation_test` doubles a one-sided p-value, so both are written here. It
has no interval for the difference of paired rates, either. What is needed of `scipy.stats` is imported where it is
used: its import would take a fifth of the start of a command.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from scipy.special import ndtri, stdtr, stdtrit

from coopsim.geometry.se3 import Floats
from coopsim.support.rng import stream

CONFIDENCE, LEVEL = 0.95, 0.05
"""Confidence of intervals, and the largest corrected p-value that is significant."""

RESAMPLES = 2**15
"""More than flips of signs, so that their number never limits what can be significant."""

EXACT_UP_TO = 14
"""Number of seeds up to which every flip of signs is tried; for more, 2 ** 14 random ones."""

_ROUNDING = 1e-12
"""Share of the values' size below which a spread is a rounding error."""

_NO_SPREAD = 0.1
"""Share of the seeds' standard error below which that of a resample says nothing, as where it missed the odd one."""


@dataclass(frozen=True, slots=True)
class Interval:
    """A mean over `count` seeds with its 95 % confidence interval: NaN without values, and ends NaN if not known, as of
    one seed. The mean of a rate (`is_rate`) need not be in the middle, so "± half" would be wrong.
    """

    mean: float
    low: float
    high: float
    count: int
    is_rate: bool = False

    @property
    def half_width(self) -> float:
        """Half of the interval's length; NaN if it is not known."""
        return (self.high - self.low) / 2

    @property
    def whiskers(self) -> tuple[float, float]:
        """Lengths of the interval below and above the mean; 0 where they are not known."""
        known = not math.isnan(self.half_width)
        return (self.mean - self.low, self.high - self.mean) if known else (0.0, 0.0)


def mean_interval(values: Floats) -> Interval:
    """Compute Student's interval of the mean of independent values (N,); NaNs are left out.

    A bootstrap of three or five values gives intervals that are far too short (Hesterberg 2015, "What Teachers Should
    Know About the Bootstrap"), and benchmarks have few seeds.
    """
    known = np.asarray(values, dtype=np.float64)
    known = known[~np.isnan(known)]
    count = len(known)
    if not count:
        return Interval(math.nan, math.nan, math.nan, 0)
    mean = float(known.mean())
    if count < 2:
        return Interval(mean, math.nan, math.nan, count)
    half = _student_quantile(count) * float(known.std(ddof=1)) / math.sqrt(count)
    return Interval(mean, mean - half, mean + half, count)


@lru_cache
def _student_quantile(count: int) -> float:
    return float(stdtrit(count - 1, (1 + CONFIDENCE) / 2))


_NORMAL = float(ndtri((1 + CONFIDENCE) / 2))


def rate_interval(values: Floats) -> Interval:
    """Compute Wilson's interval of a rate, from values (N,) of independent samples in per cent; NaNs are left out.

    Student's interval of crashes that never happened has no length; Wilson's (1927) keeps its level for rates near 0
    and 1, and for few samples (Brown, Cai and DasGupta 2001, "Interval Estimation for a Binomial Proportion"). Where
    values are neither 0 nor 100, because a sample is a mean over several conditions or seeds, the number of samples is
    replaced by the effective one, p (1 - p) / variance of the mean (Korn and Graubard 1998), if that is larger.
    """
    known = np.asarray(values, dtype=np.float64)
    known = known[~np.isnan(known)] / 100
    count = len(known)
    if not count:
        return Interval(math.nan, math.nan, math.nan, 0, is_rate=True)
    rate, effective = float(known.mean()), float(count)
    if count > 1 and not _is_yes_no(known):
        variance = float(known.var(ddof=1)) / count
        effective = max(effective, rate * (1 - rate) / variance) if variance > _ROUNDING else effective
    low, high = _wilson(rate, effective)
    return Interval(100 * rate, 100 * low, 100 * high, count, is_rate=True)


def _is_yes_no(shares: Floats) -> bool:
    return bool(np.isin(shares, (0.0, 1.0)).all())


def _wilson(rate: float, count: float) -> tuple[float, float]:
    weight = _NORMAL**2 / count
    middle = (rate + weight / 2) / (1 + weight)
    half = math.sqrt(rate * (1 - rate) * weight + weight**2 / 4) / (1 + weight)
    return min(max(middle - half, 0.0), rate), max(min(middle + half, 1.0), rate)  # rounding apart


def rate_difference(before: Floats, after: Floats) -> tuple[Interval, float] | None:
    """Compare paired rates (N,) that are 0 or 100 per cent. Return the difference's interval and McNemar's p-value.

    The test is exact and two-sided (McNemar 1947): of the pairs that differ, each is as likely to go either way, so
    it is the sign-flip test of yes or no. The interval is Newcombe's (1998, "Improved confidence intervals for the
    difference between binomial proportions based on paired data", method 10), made of Wilson's intervals.

    Returns:
        Interval of after - before, in per cent, and the p-value; None if a value is neither 0 nor 100.
    """
    yes = np.asarray(before, dtype=np.float64) / 100, np.asarray(after, dtype=np.float64) / 100
    if not all(_is_yes_no(each) for each in yes):
        return None
    count = len(yes[0])
    rates = [float(each.mean()) for each in yes]
    (low_0, high_0), (low_1, high_1) = (_wilson(rate, count) for rate in rates)
    shared, change = _shared(*yes), rates[1] - rates[0]
    down, up = (rates[1] - low_1, high_0 - rates[0]), (high_1 - rates[1], rates[0] - low_0)
    low, high = (math.sqrt(max(a * a - 2 * shared * a * b + b * b, 0.0)) for a, b in (down, up))
    worse, better = int((yes[1] > yes[0]).sum()), int((yes[1] < yes[0]).sum())
    p_value = _fair(worse, better)
    return Interval(100 * change, 100 * (change - low), 100 * (change + high), count, is_rate=True), p_value


def _fair(worse: int, better: int) -> float:
    """Return the two-sided p-value of a fair coin that fell so often on one side, and so often on the other."""
    from scipy.stats import binomtest

    return float(binomtest(worse, worse + better).pvalue) if worse + better else 1.0


def _shared(before: Floats, after: Floats) -> float:
    """Return Newcombe's correlation of yes and no of pairs, corrected for continuity."""
    a, d = float((before * after).sum()), float(((1 - before) * (1 - after)).sum())
    b, c = float((before * (1 - after)).sum()), float(((1 - before) * after).sum())
    size = math.sqrt((a + b) * (c + d) * (a + c) * (b + d))
    surplus = a * d - b * c
    surplus = max(surplus - len(before) / 2, 0.0) if surplus > 0 else surplus
    return surplus / size if size else 0.0


def bootstrap_difference(differences: Floats, resamples: int = RESAMPLES) -> tuple[Interval, float]:
    """Test paired differences (N,) by a bootstrap over seeds. Return the mean's interval, and the p-value of no change.

    This is the symmetric bootstrap-t (Efron and Tibshirani 1993, section 12.5; Hall 1988): seeds are drawn with
    replacement, and the interval follows from the quantile of the *studentised* mean, which keeps its level for few
    seeds where percentiles of the mean do not. With three seeds or fewer, more than one resample in twenty is of a
    single seed and has no spread, so the ends of the interval are infinite. (Differences that are all 0 have an
    interval of no length.) With more seeds, resamples lack a spread where nearly all differences are equal: of
    19 times 1 and one 0 a third miss the 0. If more than one in twenty has less than a tenth of the seeds'
    own, interval and p-value are Student's.

    Calls with equally many seeds resample them alike, so that all conditions of a seed go together.
    """
    values = np.asarray(differences, dtype=np.float64)
    count, mean = len(values), float(values.mean())
    floor = _ROUNDING * float(np.abs(values).max())
    spread = _standard_error(values.mean(), np.square(values - mean).mean(), count, floor)
    drawn = _resampled_counts(count, resamples) / count
    # About the mean, where squares do not cancel.
    centred = values - mean
    means = drawn @ centred
    errors = _standard_error(means, drawn @ np.square(centred) - np.square(means), count, floor)
    means[np.abs(means) <= floor] = 0.0
    observed = 0.0 if abs(mean) <= floor else abs(float(_ratio(np.array(mean), spread)))
    studentised = np.abs(_ratio(means, errors))
    p_value = (1 + int((studentised >= observed * (1 - 1e-9)).sum())) / (1 + resamples)
    if count > 3 and spread and (errors < _NO_SPREAD * spread).mean() > LEVEL:
        return mean_interval(values), float(2 * stdtr(count - 1, -observed))
    quantile = float(np.quantile(studentised, CONFIDENCE, method="higher"))
    half = quantile * float(spread) if spread else 0.0 if count > 3 or not values.any() else math.inf
    return Interval(mean, mean - half, mean + half, count), p_value


@lru_cache(maxsize=16)
def _resampled_counts(count: int, resamples: int) -> Floats:
    """Return how often each seed is in each resample, (B, N)."""
    draws = stream(0, "bootstrap over seeds", str(count))
    return draws.multinomial(count, np.full(count, 1 / count), size=resamples).astype(np.float64)


def _standard_error(mean: Floats, variance: Floats, count: int, floor: float) -> Floats:
    error = np.sqrt(np.maximum(variance, 0.0) / max(count - 1, 1))
    return np.where(error <= floor, 0.0, error)


def _ratio(means: Floats, errors: Floats) -> Floats:
    """Divide means by their errors; 0 / 0 is 0, anything else over 0 is infinite."""
    with np.errstate(divide="ignore", invalid="ignore"):
        ratio: Floats = np.where(means == 0, 0.0, means / errors)
    return ratio


def sign_flip_p_value(differences: Floats) -> float:
    """Compute the two-sided p-value of paired differences (N,) by flipping their signs (Fisher 1935).

    It is exact for symmetric noise. All 2^N flips are tried, or 2^14 random ones for more than 14 seeds. One seed gives
    1, five give at least 0.0625.
    """
    values = np.asarray(differences, dtype=np.float64)
    signs = _signs(len(values))
    sums = np.abs(signs @ values)
    observed = abs(float(values.sum()))
    reached = int((sums >= observed - _ROUNDING * float(np.abs(values).sum())).sum())
    exact = len(values) <= EXACT_UP_TO
    return reached / len(signs) if exact else (reached + 1) / (len(signs) + 1)


@lru_cache(maxsize=16)
def _signs(count: int) -> Floats:
    if count > EXACT_UP_TO:
        return stream(0, "sign flips", str(count)).choice([-1.0, 1.0], size=(2**EXACT_UP_TO, count))
    flips = np.arange(2**count)[:, None] >> np.arange(count) & 1
    signs: Floats = (1 - 2 * flips).astype(np.float64)
    return signs


def largest_difference_p_values(values: Floats, best: int) -> Floats:
    """Test policies against the one that came out best of them, by flipping signs. Return their p-values (P,).

    Each p-value is the share of flips in which *any* two policies are at least as far apart, by their studentised mean
    difference, as this one and the best (Westfall and Young 1993: the maximum statistic). So of equal policies one is
    called worse than the best in `LEVEL` of cases, however many there are, although the best was chosen from the same
    values; no further correction is needed. A sample's signs are flipped for all policies together, which keeps what
    they have in common. `values` (P, N) are more-is-better, paired by sample and finite; `best` is the row of the best.
    """
    count = values.shape[1]
    signs = _signs(count)
    reached = np.zeros(len(signs))
    observed = np.zeros(len(values))
    for row in range(len(values)):
        differences = values[row] - values
        size = np.sqrt(np.square(differences).mean(axis=1))
        # A flip leaves the sum of squares, so the share of it that the mean has orders flips as Student's t does.
        size[size <= _ROUNDING * np.abs(values).max()] = np.inf
        shares = differences / size[:, None]
        reached = np.maximum(reached, np.abs(signs @ shares[row + 1 :].T).max(axis=1, initial=0.0))
        if row == best:
            observed = np.abs(shares.sum(axis=1))
    more = (reached >= observed[:, None] - _ROUNDING * count).sum(axis=1)
    exact = count <= EXACT_UP_TO
    p_values: Floats = more / len(signs) if exact else (more + 1) / (len(signs) + 1)
    return p_values


def smallest_p_value(count: int, *, is_rate: bool = False) -> float:
    """Return the smallest p-value of `count` seeds: the two-sided chance that all differences have the same sign.

    That of a rate, by McNemar's test, becomes smaller with any number of seeds.
    """
    return float(2.0 ** (1 - (count if is_rate else min(count, EXACT_UP_TO + 1))))


def seeds_needed(comparisons: int, *, is_rate: bool = False) -> int | None:
    """Return the seeds needed for one of several comparisons to be significant; None if no number suffices."""
    needed = 1 + math.ceil(math.log2(comparisons / LEVEL))
    return needed if is_rate or needed <= EXACT_UP_TO + 1 else None


def holm(p_values: Floats) -> Floats:
    """Correct p-values (N,) for their number, so that chance alone makes any of them significant in `LEVEL` of cases.

    Holm 1979, "A simple sequentially rejective multiple test procedure"; it needs no independence.
    """
    raw = np.asarray(p_values, dtype=np.float64)
    order = np.argsort(raw, kind="stable")
    stepped = np.maximum.accumulate(raw[order] * np.arange(len(raw), 0, -1))
    corrected = np.empty_like(raw)
    corrected[order] = np.minimum(stepped, 1.0)
    return corrected
