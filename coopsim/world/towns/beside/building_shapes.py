"""Ground plans of buildings, of convex parts.

A plan has its front along x, from 0 to its width, and leads away from the street along y, from 0 to its depth, m.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from coopsim.geometry import exact
from coopsim.geometry.se3 import Floats
from coopsim.world.places.layout import rectangle

_SLIT_M = 0.02  # between parts: faces in one plane would flicker


class Part(NamedTuple):
    """A part of a building.

    Attributes:
        outline: (K, 2) m, convex.
        height: share of the building's height.
    """

    outline: Floats
    height: float = 1.0


Shape = Callable[[float, float, np.random.Generator], list[Part]]
"""Draws the parts of a building of a width and depth, m."""


def plain(width_m: float, depth_m: float, rng: np.random.Generator) -> list[Part]:
    """Return a rectangle."""
    return [Part(rectangle((0.0, width_m), (0.0, depth_m)))]


def cut(width_m: float, depth_m: float, rng: np.random.Generator) -> list[Part]:
    """Return a rectangle with one or both corners at the front cut off."""
    corner_m = min(width_m, depth_m) * rng.uniform(0.15, 0.35)
    right = [[width_m - corner_m, 0.0], [width_m, corner_m]] if rng.random() < 0.6 else [[width_m, 0.0]]
    return [Part(np.array([[0.0, corner_m], [corner_m, 0.0], *right, [width_m, depth_m], [0.0, depth_m]]))]


def with_bay(width_m: float, depth_m: float, rng: np.random.Generator) -> list[Part]:
    """Return a rectangle with a bay window or porch in front of it."""
    out_m, half_m = min(1.4, 0.15 * depth_m), width_m * rng.uniform(0.12, 0.2)
    at = width_m * rng.uniform(0.3, 0.7)
    front = np.array([[at - half_m, out_m], [at - 0.6 * half_m, 0], [at + 0.6 * half_m, 0], [at + half_m, out_m]])
    house = rectangle((0.0, width_m), (out_m + _SLIT_M, depth_m))
    return [Part(house), Part(front, float(rng.uniform(0.45, 0.95)))]


def l_shape(width_m: float, depth_m: float, rng: np.random.Generator) -> list[Part]:
    """Return a front and a wing behind one end of it."""
    front_m, wing_m = depth_m * rng.uniform(0.4, 0.55), width_m * rng.uniform(0.3, 0.45)
    x = (0.0, wing_m) if rng.random() < 0.5 else (width_m - wing_m, width_m)
    wing = rectangle(x, (front_m + _SLIT_M, depth_m))
    return [Part(rectangle((0.0, width_m), (0.0, front_m))), Part(wing, float(rng.uniform(0.5, 1.0)))]


def u_shape(width_m: float, depth_m: float, rng: np.random.Generator) -> list[Part]:
    """Return a front with two wings around a courtyard, which opens to the back or to the street."""
    front_m, wing_m = depth_m * rng.uniform(0.35, 0.45), width_m * rng.uniform(0.25, 0.32)
    y = front_m + _SLIT_M, depth_m
    height = float(rng.uniform(0.6, 1.0))
    parts = [Part(rectangle((0.0, width_m), (0.0, front_m))), Part(rectangle((0.0, wing_m), y), height)]
    parts.append(Part(rectangle((width_m - wing_m, width_m), y), height))
    if rng.random() < 0.4:
        parts = [Part(part.outline * [1.0, -1.0] + [0.0, depth_m], part.height) for part in parts]
    return parts


def around_courtyard(width_m: float, depth_m: float, rng: np.random.Generator) -> list[Part]:
    """Return four wings around a closed courtyard."""
    wing_m = min(width_m, depth_m) * rng.uniform(0.26, 0.32)
    low, high = wing_m + _SLIT_M, depth_m - wing_m - _SLIT_M
    back = float(rng.uniform(0.6, 1.0))
    return [
        Part(rectangle((0.0, width_m), (0.0, wing_m))),
        Part(rectangle((0.0, width_m), (depth_m - wing_m, depth_m)), back),
        Part(rectangle((0.0, wing_m), (low, high))),
        Part(rectangle((width_m - wing_m, width_m), (low, high)), back),
    ]


def terrace(width_m: float, depth_m: float, rng: np.random.Generator) -> list[Part]:
    """Return houses wall to wall, of different depths and heights."""
    count = max(2, round(width_m / rng.uniform(6.0, 9.0)))
    edges = np.linspace(0.0, width_m, count + 1)
    edges[1:-1] += rng.uniform(-0.8, 0.8, count - 1)
    fronts = np.where(rng.random(count) < 0.25, rng.uniform(0.3, 1.2, count), 0.0)
    depths, heights = depth_m * rng.uniform(0.75, 1.0, count), rng.choice([0.75, 0.85, 1.0, 1.0], count)
    return [
        Part(rectangle((edges[k] + _SLIT_M / 2, edges[k + 1] - _SLIT_M / 2), (fronts[k], depths[k])), float(heights[k]))
        for k in range(count)
    ]


def with_annex(width_m: float, depth_m: float, rng: np.random.Generator) -> list[Part]:
    """Return a building with a lower one at its side, such as a garage or a shop."""
    annex_m = width_m * rng.uniform(0.25, 0.35)
    y = sorted(depth_m * rng.uniform([0.0, 0.6], [0.35, 0.9]))
    main, beside = (annex_m + _SLIT_M, width_m), (0.0, annex_m)
    if rng.random() < 0.5:
        main, beside = (0.0, width_m - annex_m - _SLIT_M), (width_m - annex_m, width_m)
    return [Part(rectangle(main, (0.0, depth_m))), Part(rectangle(beside, (y[0], y[1])), float(rng.uniform(0.35, 0.5)))]


def many_sided(width_m: float, depth_m: float, rng: np.random.Generator) -> list[Part]:
    """Return a tower of six or eight sides."""
    count = int(rng.choice([6, 8]))
    angle = (np.arange(count) + 0.5) * 2 * np.pi / count
    corners = np.column_stack([width_m * (1 + exact.cos(angle)), depth_m * (1 + exact.sin(angle))]) / 2
    return [Part(corners)]


def church(width_m: float, depth_m: float, rng: np.random.Generator) -> list[Part]:
    """Return a tower at the street, a nave behind it and a choir of three sides."""
    tower_m, choir_m = 0.45 * width_m, 0.35 * width_m
    low, high = (width_m - tower_m) / 2, (width_m + tower_m) / 2
    nave = rectangle((0.0, width_m), (tower_m + _SLIT_M, depth_m - choir_m))
    back = depth_m - choir_m + _SLIT_M
    quarter_m = 0.3 * width_m
    choir = [[0.12 * width_m, back], [0.88 * width_m, back], [width_m - quarter_m, depth_m], [quarter_m, depth_m]]
    return [Part(rectangle((low, high), (0.0, tower_m))), Part(nave, 0.45), Part(np.array(choir), 0.35)]
