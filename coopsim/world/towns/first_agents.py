"""The first connected cars and masts of a town: near enough to each other to see things in common."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import combinations
from typing import Any

import numpy as np

from coopsim.geometry import exact
from coopsim.geometry.se3 import Floats

CARS, MASTS = 3, 2
"""Usual numbers of connected cars and of roadside units."""

_NEAR_M = 77.0  # between any two; cars start up to a metre before or behind their places
_CHOICE = 16  # starts, and a quarter as many masts: those tried with each other where the usual ones are too far apart

Entry = Mapping[str, Any]


def bring_near(starts: Sequence[Entry], spots: Floats, masts: Sequence[Entry]) -> tuple[list[Entry], list[Entry]]:
    """Return starts and masts in an order in which the first ones are near each other, if there are such.

    Usual orders are kept, as far as possible: first comes each next mast that is near the first cars and the masts so
    far. If the first ones are too far apart all the same, other cars come first, as far apart from each other as may
    be.

    Args:
        starts: the key `starts` of a description, by rank.
        spots: (N, 2) m, their places.
        masts: the key `rsus`.
    """
    feet = np.array([mast["at"] for mast in masts]).reshape(-1, 2)
    order = _near_first(feet, spots[:CARS])
    if _widest_m(np.vstack([spots[:CARS], feet[order[:MASTS]]])) < _NEAR_M:
        return list(starts), [masts[k] for k in order]
    cars, units = _widest_near(spots, feet) or (tuple(range(len(starts)))[:CARS], tuple(order)[:MASTS])
    ranked = [*cars, *(k for k in range(len(starts)) if k not in cars)]
    kept = [*units, *(k for k in order if k not in units)]
    return [{**starts[k], "connected": rank + 1} for rank, k in enumerate(ranked)], [masts[k] for k in kept]


def _near_first(feet: Floats, cars: Floats) -> list[int]:
    """Return the order of masts (M, 2) by the rule of `bring_near`."""
    left, chosen, agents = list(range(len(feet))), list[int](), cars
    while left:
        near = [k for k in left if exact.norm(agents - feet[k], axis=1).max(initial=0.0) < _NEAR_M]
        if not near:
            break
        left.remove(near[0])
        chosen.append(near[0])
        agents = np.vstack([agents, feet[near[0]]])
    return chosen + left


def _widest_near(spots: Floats, feet: Floats) -> tuple[tuple[int, ...], tuple[int, ...]] | None:
    """Return the first cars and masts that are near each other, the cars far apart; None: there are none."""
    best, widest_m = None, -1.0
    for units in combinations(range(min(len(feet), _CHOICE // 4)), min(MASTS, len(feet))):
        away_m = exact.norm(spots[:, None] - feet[list(units)], axis=2).max(axis=1)
        reached = np.argsort(away_m, kind="stable")[:_CHOICE].tolist()
        for cars in combinations([k for k in reached if away_m[k] < _NEAR_M], CARS):
            apart_m = [float(exact.norm(spots[a] - spots[b])) for a, b in combinations(cars, 2)]
            near = max(apart_m) < _NEAR_M and _widest_m(feet[list(units)]) < _NEAR_M
            if near and min(apart_m) > widest_m:
                best, widest_m = (cars, units), min(apart_m)
    return best


def _widest_m(places: Floats) -> float:
    """Return the greatest distance between any two places (N, 2)."""
    return float(exact.norm(places[:, None] - places, axis=2).max(initial=0.0))
