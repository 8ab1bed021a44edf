"""A road's reference line in the plane: lines, arcs, spirals and cubics.

Lines, arcs and spirals have a curvature that is linear along them. With heading h(u) = h + k u + r u^2 / 2, a place is
the integral of (cos h, sin h): in closed form where r = 0, else by Gauss-Legendre quadrature with five nodes on panels
that turn by at most 0.5 rad (the error is below 1e-10 m). Places of cubics are found by length: a table of 128 steps
gives the parameter, so `s` is the distance along the curve as the standard has it, also where the file's parameter
runs from 0 to 1. The same functions on every processor: `coopsim.geometry.exact`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Self

import numpy as np

from coopsim.data.maps.elements import Element, numbers
from coopsim.data.maps.notes import Notes
from coopsim.data.maps.opendrive.records import index_of
from coopsim.geometry import exact
from coopsim.geometry.se3 import Floats

_LONGEST_M, _MOST_TURN_RAD = 1e6, 200.0
_STEP_M, _LEAST_STEP_M, _SAG_M = 4.0, 0.25, 0.005
"""Points lie at most `_STEP_M` apart, and closer where a chord would leave the curve by more than `_SAG_M`."""
_PANEL_RAD = 0.5
_TABLE = 128

_ROOT = np.sqrt(10.0 / 7.0)
_NODES = np.array([0.0, *(sign * np.sqrt(5.0 + inner * 2.0 * _ROOT) / 3.0 for sign in (-1, 1) for inner in (-1, 1))])
_WEIGHTS = np.array([128 / 225, *[(322 + inner * 13 * np.sqrt(70.0)) / 900 for _ in (0, 1) for inner in (1, -1)]])
"""Nodes in [-1, 1] and weights of Gauss-Legendre quadrature."""

_KINDS = ("line", "arc", "spiral", "poly3", "paramPoly3")
_U = ("aU", "bU", "cU", "dU", "aV", "bV", "cV", "dV")


@dataclass(frozen=True, slots=True, eq=False)
class Cubic:
    """A curve of cubics in its own frame, with a table from length to parameter.

    Attributes:
        factors: (2, 4) of u and v.
        length_m: (T,) from the start, rising.
        parameter: (T,).
    """

    factors: Floats
    length_m: Floats
    parameter: Floats

    @classmethod
    def of(cls, factors: Floats, most: float, length_m: float | None = None) -> Self:
        """Tabulate up to the parameter `most`; or, where the curve is longer, up to `length_m`."""
        parameter = np.linspace(0.0, most, _TABLE + 1)
        middle = (parameter[1:] + parameter[:-1]) / 2
        half = (parameter[1:] - parameter[:-1]) / 2
        speed = exact.norm(_slope(factors, middle[:, None] + half[:, None] * _NODES), axis=0)
        total = np.concatenate([[0.0], np.cumsum(half * (speed * _WEIGHTS).sum(axis=1))])
        if length_m is not None and total[-1] > length_m:  # poly3: its last parameter is where the length is reached
            return cls.of(factors, float(np.interp(length_m, total, parameter)))
        return cls(factors, total, parameter)

    def at(self, u: Floats, length_m: float) -> tuple[Floats, Floats]:
        """Return places and directions (2, K) at distances (K,) of a curve that the file says to be `length_m` long."""
        p = np.interp(u * (self.length_m[-1] / length_m), self.length_m, self.parameter)
        a, b, c, d = self.factors.T[:, :, None]
        slope = _slope(self.factors, p)
        return a + p * (b + p * (c + p * d)), slope / np.maximum(exact.norm(slope, axis=0), 1e-12)

    @property
    def sharpest(self) -> float:
        """The largest curvature, 1/m, between steps of the table."""
        slope = _slope(self.factors, self.parameter)
        ahead = slope / np.maximum(exact.norm(slope, axis=0), 1e-12)
        step = np.maximum(np.diff(self.length_m), 1e-9)
        return float((exact.norm(np.diff(ahead, axis=1), axis=0) / step).max())


def _slope(factors: Floats, p: Floats) -> Floats:
    """Return derivatives (2, ...) by the parameter (...)."""
    _, b, c, d = (factors[:, k].reshape(2, *[1] * p.ndim) for k in range(4))
    return b + p * (2.0 * c + p * 3.0 * d)


@dataclass(frozen=True, slots=True, eq=False)
class PlanView:
    """A reference line.

    Attributes:
        pieces: (G, 7): s, x, y, heading, length, curvature at the start, its change per metre.
        cubics: pieces that are cubics, by index.
        grid: (K,) m along it, from 0 to its end: where to look so that chords keep to the curve.
    """

    pieces: Floats
    cubics: dict[int, Cubic]
    grid: Floats

    @classmethod
    def read(cls, road: Element, notes: Notes) -> Self:
        """Read the `<planView>` of a road."""
        elements = road.at_path("planView", "geometry")
        if not elements:
            raise road.error("must have a <planView> with a <geometry>")
        rows = numbers(elements, ("s", "x", "y", "hdg", "length"))
        order = np.argsort(rows[:, 0], kind="stable")
        pieces, cubics, steps = list[list[float]](), dict[int, Cubic](), list[float]()
        for index in order:
            element, row = elements[index], rows[index]
            if not 0.0 < row[4] <= _LONGEST_M:
                if row[4] == 0.0 and len(rows) > 1:
                    notes.repair("pieces of reference lines without length are left out", f"line {element.line}")
                    continue
                raise element.error(f"length must be in (0, {_LONGEST_M:g}] m, got {row[4]:g}")
            curvature, rate, cubic = _shape(element, row[4])
            sharpest = max(abs(curvature), abs(curvature + rate * row[4]))
            if cubic is not None:
                cubics[len(pieces)], sharpest = cubic, cubic.sharpest
            pieces.append([*row, curvature, rate])
            steps.append(min(max(math.sqrt(8.0 * _SAG_M / max(sharpest, 1e-9)), _LEAST_STEP_M), _STEP_M))
        if not pieces:
            raise road.error("must have a <geometry> with a length")
        table = np.array(pieces)
        table[:, 0] -= table[0, 0]
        counts = np.ceil(table[:, 4] / steps).astype(int) + 1
        notes.take_points(counts.sum(), road)
        runs = [np.linspace(row[0], row[0] + row[4], count) for row, count in zip(table, counts, strict=True)]
        return cls(table, cubics, np.unique(np.concatenate(runs)))

    @property
    def length_m(self) -> float:
        """Length of the line."""
        return float(self.grid[-1])

    @property
    def widest_gap_m(self) -> float:
        """The widest gap between the end of a piece and the next one's start."""
        gaps = [0.0]
        for row, after in zip(self.pieces[:-1], self.pieces[1:], strict=True):
            ends, _ = self.at(np.array([row[0] + row[4]]), after[0])
            gaps.append(float(exact.norm(ends[0] - after[1:3])))
        return max(gaps)

    def at(self, s: Floats, end: float = np.inf) -> tuple[Floats, Floats]:
        """Return places and unit directions (K, 2) at distances (K,); pieces that start at `end` do not count."""
        index = index_of(self.pieces[:, 0], s, end)
        rows = self.pieces[index]
        u = s - rows[:, 0]
        heading, curvature, rate = rows[:, 3], rows[:, 5], rows[:, 6]
        turned = heading + u * (curvature + u * rate / 2)
        ahead = np.stack([exact.cos(turned), exact.sin(turned)])
        moved = _bent(u, heading, curvature)
        spiral = rate != 0.0
        if spiral.any():
            moved[:, spiral] = _spiral(u[spiral], heading[spiral], curvature[spiral], rate[spiral])
        for piece in sorted(self.cubics.keys() & set(index.tolist())):
            mine, row = index == piece, self.pieces[piece]
            turn = np.array([[exact.cos(row[3]), -exact.sin(row[3])], [exact.sin(row[3]), exact.cos(row[3])]])
            for out, local in zip((moved, ahead), self.cubics[piece].at(u[mine], row[4]), strict=True):
                out[:, mine] = turn[:, :1] * local[0] + turn[:, 1:] * local[1]
        return rows[:, 1:3] + moved.T, ahead.T


def _shape(element: Element, length_m: float) -> tuple[float, float, Cubic | None]:
    """Return the curvature at the start of a piece, its change per metre, and the curve of cubics."""
    shapes = element.all(*_KINDS)
    if len(shapes) != 1:
        there = ", ".join(f"<{each.tag}>" for each in element.children) or "nothing"
        raise element.error(f"must have one of {', '.join(f'<{kind}>' for kind in _KINDS)}, got {there}")
    shape = shapes[0]
    curvature = rate = 0.0
    if shape.tag == "arc":
        curvature = shape.number("curvature")
    elif shape.tag == "spiral":
        curvature = shape.number("curvStart")
        rate = (shape.number("curvEnd") - curvature) / length_m
    if max(abs(curvature), abs(curvature + rate * length_m)) * length_m > _MOST_TURN_RAD:
        raise shape.error(
            f"turns by more than {_MOST_TURN_RAD:g} rad in {length_m:g} m, which is more than is accepted"
        )
    if shape.tag == "poly3":
        factors = np.array([[0.0, 1.0, 0.0, 0.0], [shape.number(name, 0.0) for name in "abcd"]])
        return 0.0, 0.0, Cubic.of(factors, length_m, length_m)
    if shape.tag == "paramPoly3":
        kind = shape.get("pRange", "normalized")
        if kind not in ("arcLength", "normalized"):
            raise shape.error(f"pRange must be arcLength or normalized, got {kind!r}")
        cubic = Cubic.of(numbers([shape], _U, 0.0).reshape(2, 4), 1.0 if kind == "normalized" else length_m)
        if not length_m / 2 <= cubic.length_m[-1] <= 2 * length_m:
            along = cubic.length_m[-1]
            raise shape.error(f"is {along:g} m long, but length is {length_m:g} m; accepted: half to twice of it")
        return 0.0, 0.0, cubic
    return curvature, rate, None


def _bent(u: Floats, heading: Floats, curvature: Floats) -> Floats:
    """Return how far (2, K) one comes along lines and arcs: the chord, in its direction."""
    half = u * curvature / 2
    small = np.abs(half) < 1e-4
    chord = u * np.where(small, 1.0 - half * half / 6.0, exact.sin(half) / np.where(small, 1.0, half))
    return np.stack([chord * exact.cos(heading + half), chord * exact.sin(heading + half)])


def _spiral(u: Floats, heading: Floats, curvature: Floats, rate: Floats) -> Floats:
    """Return how far (2, K) one comes along spirals."""
    sharpest = np.maximum(np.abs(curvature), np.abs(curvature + rate * u))
    panels = int(np.ceil((sharpest * np.abs(u)).max() / _PANEL_RAD)) + 1
    half = (u / (2.0 * panels))[:, None]
    total = np.zeros((2, len(u)))
    for panel in range(panels):
        along = half * (2.0 * panel + 1.0 + _NODES)
        turned = heading[:, None] + along * (curvature[:, None] + along * rate[:, None] / 2)
        for axis, wave in enumerate((exact.cos, exact.sin)):
            total[axis] += (half * wave(turned) * _WEIGHTS).sum(axis=1)
    return total
