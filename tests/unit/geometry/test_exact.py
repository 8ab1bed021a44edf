"""Exact functions: the nearest number to the true value, of arrays as in kernels."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from numba import njit

from coopsim.geometry import exact

ANGLES = np.random.default_rng(0).uniform(-20.0, 20.0, 2000)
VECTORS = np.random.default_rng(1).normal(0.0, 30.0, (2, 2000))


def nearest(name: str, *values: Any) -> list[float]:
    mpmath = pytest.importorskip("mpmath")
    with mpmath.workprec(160):
        return [float(getattr(mpmath, name)(*map(mpmath.mpf, each))) for each in zip(*values, strict=True)]


@pytest.mark.parametrize("name", ["sin", "cos", "tan"])
def test_sines_are_the_nearest_numbers(name: str) -> None:
    assert getattr(exact, name)(ANGLES).tolist() == nearest(name, ANGLES)


@pytest.mark.parametrize(("name", "theirs"), [("arctan2", "atan2"), ("hypot", "hypot")])
def test_angles_and_lengths_of_vectors_are_the_nearest_numbers(name: str, theirs: str) -> None:
    assert getattr(exact, name)(*VECTORS).tolist() == nearest(theirs, *VECTORS)


@pytest.mark.parametrize("y", [-2.0, -0.0, 0.0, 2.0])
@pytest.mark.parametrize("x", [-2.0, 0.0, 2.0])
def test_angles_on_the_axes(y: float, x: float) -> None:
    found = float(exact.arctan2(y, x))
    assert found == math.atan2(y, x) and math.copysign(1.0, found) == math.copysign(1.0, y)


def test_arcs() -> None:
    sines = np.linspace(-1.0, 1.0, 41)
    np.testing.assert_allclose(exact.arcsin(sines), np.arcsin(sines), rtol=0, atol=1e-15)
    np.testing.assert_allclose(exact.arccos(sines), np.arccos(sines), rtol=0, atol=1e-15)


def test_products_and_lengths() -> None:
    vectors = VECTORS.T.reshape(40, 50, 2)
    np.testing.assert_allclose(exact.norm(vectors), np.linalg.norm(vectors, axis=-1), rtol=1e-15)
    np.testing.assert_allclose(exact.norm(vectors, axis=0), np.linalg.norm(vectors, axis=0), rtol=1e-14)
    assert exact.norm(vectors, axis=2, keepdims=True).shape == (40, 50, 1)
    np.testing.assert_allclose(exact.dot(vectors, vectors[0, 0]), vectors @ vectors[0, 0], rtol=0, atol=1e-11)
    assert exact.hypot(0.0, 0.0) == 0.0 and exact.hypot(3, -4) == 5.0


@njit
def _in_a_kernel(y: float, x: float) -> tuple[float, float, float]:
    return exact.arctan2(y, x), exact.hypot(x, y), exact.cos(x)


def test_kernels_get_the_same_numbers() -> None:
    y, x = VECTORS[:, 0].tolist()
    assert _in_a_kernel(y, x) == (exact.arctan2(y, x), exact.hypot(x, y), exact.cos(x))
