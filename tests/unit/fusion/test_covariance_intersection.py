"""Covariance intersection: never too sure, whatever the correlation, and as sure as that allows."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.optimize import minimize_scalar

from coopsim.errors import InvalidValueError
from coopsim.fusion.track_fusion import PULL, covariance_intersection, intersection_weight
from coopsim.tracking.motion import kalman

Floats = np.ndarray[Any, np.dtype[np.float64]]
SEEDS = st.integers(0, 2**32 - 1)


def covariances(rng: np.random.Generator, count: int, size: int = 4) -> Floats:
    """Random directions, standard deviations from centimetres to a hundred metres."""
    axes = np.linalg.qr(rng.normal(size=(count, size, size)))[0]
    return axes * (10.0 ** rng.uniform(-3, 4, (count, 1, size))) @ axes.transpose(0, 2, 1)


def pairs(seed: int, count: int = 20) -> tuple[Floats, Floats, Floats, Floats]:
    rng = np.random.default_rng(seed)
    a, b = rng.normal(0, 10, (2, count, 4))
    return a, covariances(rng, count), b, covariances(rng, count)


def log_det(covariance: Floats) -> Floats:
    return np.linalg.slogdet(covariance)[1]


@given(SEEDS)
def test_consistent_for_every_correlation(seed: int) -> None:
    """The true covariance of the fused mean, for a random cross-covariance A^1/2 K B^1/2' with |K| <= 1, is below P."""
    rng = np.random.default_rng(seed)
    a, A, b, B = pairs(seed)
    _, P, weight = covariance_intersection(a, A, b, B)
    left, _, right = np.linalg.svd(rng.normal(size=A.shape))
    K = left * rng.choice([-1.0, 1.0, rng.uniform(-1, 1)], (len(A), 1, 4)) @ right
    cross = np.linalg.cholesky(A) @ K @ np.linalg.cholesky(B).transpose(0, 2, 1)
    share_a = P @ np.linalg.inv(A) * weight[:, None, None]
    share_b = P @ np.linalg.inv(B) * (1 - weight[:, None, None])
    mixed = share_a @ cross @ share_b.transpose(0, 2, 1)
    true = share_a @ A @ share_a.transpose(0, 2, 1) + share_b @ B @ share_b.transpose(0, 2, 1)
    true += mixed + mixed.transpose(0, 2, 1)
    factor = np.linalg.inv(np.linalg.cholesky(P))
    relative = factor @ true @ factor.transpose(0, 2, 1)  # P^-1/2 true P^-1/2 <= I
    assert np.linalg.eigvalsh((relative + relative.transpose(0, 2, 1)) / 2).max() <= 1 + 1e-6


@given(SEEDS)
def test_never_less_sure_than_the_better_input(seed: int) -> None:
    a, A, b, B = pairs(seed)
    _, P, weight = covariance_intersection(a, A, b, B)
    assert (log_det(P) <= np.minimum(log_det(A), log_det(B)) + PULL / 4 + 1e-9).all()
    assert ((weight >= 0) & (weight <= 1)).all()


@given(SEEDS)
def test_at_parity_with_a_scalar_minimiser(seed: int) -> None:
    _, A, _, B = pairs(seed, count=3)
    for first, second, weight in zip(A, B, intersection_weight(A, B), strict=True):

        def cost(w: float, first: Floats = first, second: Floats = second) -> float:
            return -float(log_det(w * np.linalg.inv(first) + (1 - w) * np.linalg.inv(second)))

        best = minimize_scalar(cost, bounds=(0, 1), method="bounded", options={"xatol": 1e-10})
        assert cost(weight) <= best.fun + PULL / 4 + 1e-9

        pulled = minimize_scalar(lambda w: cost(w) + PULL * (w - 0.5) ** 2, bounds=(0, 1), method="bounded")
        assert weight == pytest.approx(pulled.x, abs=2e-3)


@given(SEEDS)
def test_symmetric_in_its_arguments(seed: int) -> None:
    a, A, b, B = pairs(seed)
    mean, P, weight = covariance_intersection(a, A, b, B)
    swapped_mean, swapped_P, swapped_weight = covariance_intersection(b, B, a, A)
    np.testing.assert_allclose(swapped_weight, 1 - weight, atol=1e-6)
    np.testing.assert_allclose(swapped_mean, mean, atol=1e-3)
    np.testing.assert_allclose(log_det(swapped_P), log_det(P), atol=1e-6)


def test_the_same_twice_is_the_same_where_a_kalman_update_halves_it() -> None:
    a, A, _, _ = pairs(0)
    mean, P, weight = covariance_intersection(a, A, a, A)
    np.testing.assert_allclose(mean, a, rtol=1e-6)
    np.testing.assert_allclose(P, A, rtol=1e-6, atol=1e-9)
    np.testing.assert_allclose(weight, 0.5, atol=1e-6)
    _, halved = kalman.update(a, A, np.zeros_like(a), A)
    np.testing.assert_allclose(halved, A / 2, rtol=1e-4, atol=1e-6)


@pytest.mark.parametrize("rounding", [0.0, 1e-7])
def test_equally_sure_estimates_meet_in_the_middle_whatever_rounding_says(rounding: float) -> None:
    rng = np.random.default_rng(0)
    A = covariances(rng, 50)
    B = A * (1 + rounding * rng.choice([-1, 1], (50, 1, 1)))
    np.testing.assert_allclose(intersection_weight(A, B), 0.5, atol=1e-3)


def test_whoever_knows_one_axis_gives_that_axis() -> None:
    across, along = np.diag([0.01, 100.0]), np.diag([100.0, 0.01])
    mean, P, weight = covariance_intersection(
        np.array([[1.0, 50.0]]), across[None], np.array([[-30.0, 2.0]]), along[None]
    )
    np.testing.assert_allclose(weight, 0.5, atol=1e-9)
    np.testing.assert_allclose(mean, [[1.0, 2.0]], atol=0.01)
    np.testing.assert_allclose(P[0], np.diag([0.02, 0.02]), atol=1e-4)


def test_whoever_knows_everything_better_stands() -> None:
    a, b = np.array([[1.0, 2.0]]), np.array([[5.0, 5.0]])
    mean, P, weight = covariance_intersection(a, np.eye(2)[None], b, 4 * np.eye(2)[None])
    np.testing.assert_array_equal(np.round(weight, 9), 1)
    np.testing.assert_allclose(mean, a, atol=1e-9)
    np.testing.assert_allclose(P, np.eye(2)[None], atol=1e-9)


def test_no_pairs() -> None:
    mean, P, weight = covariance_intersection(*(np.zeros(shape) for shape in ((0, 4), (0, 4, 4)) * 2))
    assert mean.shape == (0, 4) and P.shape == (0, 4, 4) and weight.shape == (0,)


@pytest.mark.parametrize(
    ("change", "match"),
    [
        ({1: -np.eye(4)[None]}, "positive definite"),
        ({3: np.full((1, 4, 4), np.nan)}, "factor of a covariance to intersect must be finite"),
        ({3: np.zeros((1, 4, 4))}, "positive definite"),
    ],
)
def test_what_cannot_be_fused_is_named(change: dict[int, Floats], match: str) -> None:
    inputs = [np.zeros((1, 4)), np.eye(4)[None], np.zeros((1, 4)), np.eye(4)[None]]
    for position, value in change.items():
        inputs[position] = value
    with pytest.raises(InvalidValueError, match=match):
        covariance_intersection(*inputs)
