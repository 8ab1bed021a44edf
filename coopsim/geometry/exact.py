"""Functions of lengths and angles with the same bits on every processor: what draws places uses no others.

IEEE 754 fixes +, -, *, / and the square root to the last bit, and only these are used here. The last bit of numpy's and
the C library's sine or hypotenuse depends on the instructions of the processor, and that of a product of matrices on
the order in which BLAS adds. A decision may hang on it, and with it a whole town.

Numbers are kept as sums of two, of which the second holds what rounding takes from the first (Dekker, "A floating-point
technique for extending the available precision", 1971). So results are the nearest number to the true value, but for
rare ones, as those of a good C library are.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from coopsim.support.arrays import Floats
from coopsim.support.kernels import njit, vectorize

_Pair = tuple[float, float]

_QUARTER_RAD = math.pi / 2
_QUARTER_PARTS = tuple(map(float.fromhex, ("0x1.921fb544p+0", "0x1.0b4611a6p-34", "0x1.3198a2e037073p-69")))
"""A quarter turn as a sum; the first two have 33 bits, so products with whole numbers are exact."""
_SPLIT = 2.0**27 + 1.0
_DECIMALS = 9


@njit(cache=True, nogil=True, inline="always")
def _sum(a: float, b: float) -> _Pair:
    """Return a sum and its rounding error."""
    total = a + b
    part = total - a
    return total, (a - (total - part)) + (b - part)


@njit(cache=True, nogil=True, inline="always")
def _product(a: float, b: float) -> _Pair:
    """Return a product and its rounding error."""
    total, a_split, b_split = a * b, _SPLIT * a, _SPLIT * b
    a_high, b_high = a_split - (a_split - a), b_split - (b_split - b)
    a_low, b_low = a - a_high, b - b_high
    return total, ((a_high * b_high - total) + a_high * b_low + a_low * b_high) + a_low * b_low


@njit(cache=True, nogil=True, inline="always")
def _pair_product(a: _Pair, b: _Pair) -> _Pair:
    high, low = _product(a[0], b[0])
    return _sum(high, low + (a[0] * b[1] + a[1] * b[0]))


@njit(cache=True, nogil=True)
def _pair_quotient(a: _Pair, b: _Pair) -> _Pair:
    share = a[0] / b[0]
    back = _pair_product((share, 0.0), b)
    return _sum(share, ((a[0] - back[0]) + (a[1] - back[1])) / b[0])


@njit(cache=True, nogil=True)
def _sine(angle_rad: float, quarters: int) -> _Pair:
    """Return the sine of an angle below 1e6 rad plus whole quarter turns, by its series around the nearest quarter."""
    turns = np.rint(angle_rad / _QUARTER_RAD)
    rest, low = _sum(angle_rad, -turns * _QUARTER_PARTS[0])
    rest, more = _sum(rest, -turns * _QUARTER_PARTS[1])
    rest, low = _sum(rest, low + more - turns * _QUARTER_PARTS[2])
    quarter = (int(turns) + quarters) % 4
    is_cosine, square, total = quarter % 2, _pair_product((rest, low), (rest, low)), (1.0, 0.0)
    for n in range(20, 0, -2):
        term = _pair_quotient(_pair_product(total, square), (float(n * (n - 1 if is_cosine else n + 1)), 0.0))
        high, error = _sum(1.0, -term[0])
        total = _sum(high, error - term[1])
    if not is_cosine:
        total = _pair_product((rest, low), total)
    return total if quarter < 2 else (-total[0], -total[1])


@vectorize(cache=True)
def sin(angle_rad: Any) -> Any:
    """Return the sine of angles, rad."""
    return _sine(angle_rad, 0)[0]


@vectorize(cache=True)
def cos(angle_rad: Any) -> Any:
    """Return the cosine of angles, rad."""
    return _sine(angle_rad, 1)[0]


@vectorize(cache=True)
def tan(angle_rad: Any) -> Any:
    """Return the tangent of angles, rad."""
    return _pair_quotient(_sine(angle_rad, 0), _sine(angle_rad, 1))[0]


@vectorize(cache=True)
def arctan2(y: Any, x: Any) -> Any:
    """Return the angles, rad, of vectors, in [-pi, pi]; that of (0, 0) is 0."""
    across, along = abs(y), abs(x)
    if across == 0.0 and along == 0.0:
        return 0.0 * y
    slope = min(across, along) / max(across, along)
    for _ in range(3):  # halve the angle, so that few terms do
        slope = slope / (1.0 + math.sqrt(1.0 + slope * slope))
    total = 0.0
    for n in range(17, 0, -2):
        total = 1.0 / n - total * slope * slope
    angle_rad = 8.0 * slope * total
    angle_rad = _QUARTER_RAD - angle_rad if across > along else angle_rad
    angle_rad = math.pi - angle_rad if x < 0 else angle_rad
    sine, cosine = _sine(angle_rad, 0), _sine(angle_rad, 1)
    ahead, back = _pair_product((across, 0.0), cosine), _pair_product((x, 0.0), sine)
    left = (ahead[0] - back[0]) + (ahead[1] - back[1])  # of the vector, seen along the angle: a step of Newton's method
    return math.copysign(angle_rad + left / (x * cosine[0] + across * sine[0]), y)


@vectorize(cache=True)
def hypot(x: Any, y: Any) -> Any:
    """Return the lengths of vectors."""
    first, second = _product(x, x), _product(y, y)
    high, low = _sum(first[0], second[0])
    length = math.sqrt(high)
    square = _product(length, length)
    rest = (high - square[0]) + (low + first[1] + second[1] - square[1])
    return length + rest / (2.0 * length if length > 0.0 else 1.0)


def arcsin(sine: Any) -> Any:
    """Return the angles, rad, in [-pi/2, pi/2], of sines."""
    return arctan2(sine, np.sqrt((1.0 - sine) * (1.0 + sine)))


def arccos(cosine: Any) -> Any:
    """Return the angles, rad, in [0, pi], of cosines."""
    return arctan2(np.sqrt((1.0 - cosine) * (1.0 + cosine)), cosine)


def dot(first: Floats, second: Floats) -> Floats:
    """Return the inner products (...) of vectors (..., D)."""
    return np.asarray((first * second).sum(axis=-1))


def norm(vectors: Floats, axis: int = -1, *, keepdims: bool = False) -> Floats:
    """Return the lengths of vectors, which lie along an axis."""
    return np.asarray(np.sqrt((vectors * vectors).sum(axis=axis, keepdims=keepdims)))


def settled(values: Any) -> Any:
    """Round results of any other function to nine decimals, where processors agree."""
    return np.round(values, _DECIMALS)
