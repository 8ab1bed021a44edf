"""What few seeds can say: levels are kept in simulation, and nothing is claimed that they cannot show."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy import stats

from coopsim.bench.results.statistics import (
    EXACT_UP_TO,
    LEVEL,
    bootstrap_difference,
    holm,
    mean_interval,
    seeds_needed,
    sign_flip_p_value,
    smallest_p_value,
)

VALUES = st.lists(st.floats(-1e3, 1e3).map(lambda value: round(value, 3)), min_size=1, max_size=9)
RUNS = 400


@given(VALUES)
def test_the_interval_of_a_mean_is_student_s(values: list[float]) -> None:
    known = np.array(values)
    interval = mean_interval(np.array([np.nan, *values, np.nan]))
    assert interval.count == len(values) and interval.mean == pytest.approx(known.mean(), abs=1e-9)
    if len(values) == 1:
        assert math.isnan(interval.low) and math.isnan(interval.high) and math.isnan(interval.half_width)
    elif known.std() > 1e-6:
        low, high = stats.t.interval(0.95, len(known) - 1, known.mean(), stats.sem(known))
        assert (interval.low, interval.high) == (pytest.approx(low, abs=1e-6), pytest.approx(high, abs=1e-6))


def test_of_nothing_there_is_no_mean() -> None:
    interval = mean_interval(np.full(3, np.nan))
    assert interval.count == 0 and math.isnan(interval.mean) and math.isnan(interval.half_width)


def draws(shape: str, count: int) -> NDArray[np.float64]:
    """(RUNS, `count`) differences whose true mean is 0."""
    rng = np.random.default_rng(count)
    return {
        "normal": rng.normal(size=(RUNS, count)),
        "heavy": rng.standard_t(3, size=(RUNS, count)),
        "uniform": rng.uniform(-1, 1, size=(RUNS, count)),
    }[shape]


@pytest.mark.parametrize("count", [4, 6, 10, 20])
@pytest.mark.parametrize("shape", ["normal", "heavy", "uniform"])
def test_intervals_cover_and_false_positives_are_rare(shape: str, count: int) -> None:
    covered, bootstrap, verdicts = 0, 0, 0
    for row in draws(shape, count):
        interval, p_value = bootstrap_difference(row, resamples=1000)
        covered += interval.low <= 0 <= interval.high
        bootstrap += p_value <= LEVEL
        verdicts += max(p_value, sign_flip_p_value(row)) <= LEVEL
    slack = 3 * math.sqrt(LEVEL * (1 - LEVEL) / RUNS)  # three standard errors of the simulation itself
    assert covered / RUNS >= 1 - LEVEL - slack
    assert bootstrap / RUNS <= LEVEL + slack and verdicts / RUNS <= LEVEL + slack


def test_half_the_cover_would_be_noticed() -> None:
    # The percentile bootstrap, which is not what is used here, falls far short with five seeds.
    rows = draws("normal", 5)
    means = rows[:, np.random.default_rng(0).integers(5, size=(500, 5))].mean(axis=2)
    low, high = np.quantile(means, [0.025, 0.975], axis=1)
    assert ((low <= 0) & (high >= 0)).mean() < 1 - LEVEL - 3 * math.sqrt(LEVEL * (1 - LEVEL) / RUNS)


def test_a_clear_difference_is_found() -> None:
    rows = draws("normal", 10) + 2.0
    found = [max(bootstrap_difference(row, 1000)[1], sign_flip_p_value(row)) <= LEVEL for row in rows]
    assert np.mean(found) > 0.95


@pytest.mark.parametrize("count", [2, 5, 8])
def test_sign_flips_are_scipy_s_permutations(count: int) -> None:
    for row in draws("heavy", count)[:5]:
        reference = stats.permutation_test(
            (row,), lambda sample, axis: np.mean(sample, axis=axis), permutation_type="samples", n_resamples=np.inf,
            vectorized=True,
        )  # fmt: skip
        assert sign_flip_p_value(row) == pytest.approx(reference.pvalue)


def test_many_seeds_are_flipped_at_random_and_alike_every_time() -> None:
    row = draws("normal", 30)[0]
    p_value = sign_flip_p_value(row)
    assert p_value == sign_flip_p_value(row)
    assert p_value == pytest.approx(stats.ttest_1samp(row, 0).pvalue, abs=0.02)
    assert sign_flip_p_value(np.ones(30)) == pytest.approx(smallest_p_value(30), rel=0.01)


@given(VALUES)
def test_no_number_of_seeds_shows_more_than_it_can(values: list[float]) -> None:
    assert sign_flip_p_value(np.array(values)) >= smallest_p_value(len(values))


@given(VALUES, st.sampled_from([0.25, 1.0, 8.0]))
def test_unit_sign_and_order_of_seeds_do_not_matter(values: list[float], unit: float) -> None:
    row = np.array(values)
    interval, p_value = bootstrap_difference(row, 500)
    scaled, p_scaled = bootstrap_difference(-unit * row, 500)
    assert p_scaled == p_value and sign_flip_p_value(-unit * row) == sign_flip_p_value(row)
    assert scaled.low == pytest.approx(-unit * interval.high, rel=1e-6, abs=1e-6)
    assert sign_flip_p_value(row[::-1]) == pytest.approx(sign_flip_p_value(row))


@pytest.mark.parametrize("count", [1, 2, 3])
def test_up_to_three_seeds_have_no_bootstrap_interval(count: int) -> None:
    interval, _ = bootstrap_difference(np.arange(1.0, count + 1))
    assert (interval.low, interval.high) == (-math.inf, math.inf)


def test_no_difference_at_all() -> None:
    interval, p_value = bootstrap_difference(np.zeros(5))
    assert (interval.mean, interval.low, interval.high, p_value) == (0, 0, 0, 1)
    assert sign_flip_p_value(np.zeros(5)) == 1
    same, _ = bootstrap_difference(np.full(6, 0.1))
    assert same.low == same.high == pytest.approx(0.1), "what rounding spreads is no spread"


@pytest.mark.parametrize("others", [np.ones(19), 1 + 1e-9 * np.arange(19), np.linspace(0.99, 1.01, 19)])
def test_nearly_constant_differences_are_significant(others: NDArray[np.float64]) -> None:
    values = np.array([*others, 0.0])
    interval, p_value = bootstrap_difference(values)
    assert max(p_value, sign_flip_p_value(values)) < 0.001
    low, high = stats.t.interval(0.95, 19, values.mean(), stats.sem(values))
    assert (interval.low, interval.high) == (pytest.approx(low), pytest.approx(high))


def test_one_difference_among_zeros_is_not_significant() -> None:
    values = np.array([1.0, *np.zeros(19)])
    interval, p_value = bootstrap_difference(values)
    assert p_value > 0.3 and interval.low < 0 < interval.high < 1


def test_counts_that_hardly_ever_differ_keep_the_level() -> None:
    rng, wrong = np.random.default_rng(0), 0
    for _ in range(RUNS):
        values = rng.choice([-1.0, 0.0, 1.0], 20, p=[0.1, 0.8, 0.1])
        wrong += max(bootstrap_difference(values, 1000)[1], sign_flip_p_value(values)) <= LEVEL
    assert wrong / RUNS <= LEVEL + 3 * math.sqrt(LEVEL * (1 - LEVEL) / RUNS)


@given(st.lists(st.floats(0, 1), min_size=1, max_size=12))
def test_holm_is_its_definition(raw: list[float]) -> None:
    corrected = holm(np.array(raw))
    order = sorted(range(len(raw)), key=lambda k: raw[k])
    for level in (0.01, 0.05, 0.3):
        rejected = set()
        for step, k in enumerate(order):  # one after another, until the first that is too large
            if raw[k] * (len(raw) - step) > level:
                break
            rejected.add(k)
        assert {k for k in range(len(raw)) if corrected[k] <= level} == rejected


def test_seeds_that_it_takes() -> None:
    assert [seeds_needed(comparisons) for comparisons in (1, 2, 8, 100)] == [6, 7, 9, 12]
    for comparisons in range(1, 200):
        needed = seeds_needed(comparisons)
        assert needed is not None
        assert comparisons * smallest_p_value(needed) <= LEVEL < comparisons * smallest_p_value(needed - 1)
    assert seeds_needed(1000) is None and smallest_p_value(1000) == smallest_p_value(EXACT_UP_TO + 1)
