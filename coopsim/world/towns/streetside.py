"""Lots and trees of drawn towns beside streets that were not drawn."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from coopsim.geometry import exact
from coopsim.geometry.outlines import along_of
from coopsim.geometry.se3 import Floats
from coopsim.support.rng import stream
from coopsim.world.places.streetside import LOTS, Streetside
from coopsim.world.towns.kerbs import STREET, Round, Side
from coopsim.world.towns.lots import build_frontages
from coopsim.world.towns.pavements import PeopleWays
from coopsim.world.towns.plan import Plan
from coopsim.world.towns.roadside import line_streets, plant_behind
from coopsim.world.towns.site import Site

_STREET_M = 90.0  # of a line that has lots of one usual kind


@LOTS.register("town")
def build_lots(ground: Streetside) -> Mapping[str, tuple[Any, ...]]:
    """Draw lots along the fronts of some ground, and trees: fields of a description."""
    none = (np.zeros((0, 2)), np.zeros((0, 2)), np.zeros(0))
    openness = stream(ground.seed, "openness").uniform()
    site = Site(Plan((), (), 0), ground.seed, openness, (), none, PeopleWays(()), [], ground.taken, ground.kerbside)
    fronts = _rounds(ground.fronts)
    build_frontages(replace(site, rounds=fronts, borders=list(ground.fronts)))
    line_streets(replace(site, rounds=_rounds(ground.kerbs)))
    borders = (*ground.fronts, *ground.country)
    plant_behind(replace(site, rounds=_rounds(borders), borders=list(borders)))
    return {name: tuple(parts) for name, parts in site.parts.items()}


def _rounds(lines: Sequence[Floats]) -> tuple[Round, ...]:
    """Return lines (N, 2) m as rounds whose parts are sides of streets."""
    rounds, first = list[Round](), 0
    for line in lines:
        along_m = along_of(line)
        count = max(round(along_m[-1] / _STREET_M), 1)
        side = np.minimum((along_m / along_m[-1] * count).astype(np.int64), count - 1)
        side[-1] = -1  # the last point ends the last part, and begins none
        sides = []
        for number in range(count):
            own = side == number
            sides.append(Side(STREET, first + number, 1, line[own], along_m[own], np.zeros(int(own.sum()))))
        ahead = np.gradient(line, axis=0)
        ahead /= np.maximum(exact.norm(ahead, keepdims=True), 1e-9)
        right = np.column_stack([ahead[:, 1], -ahead[:, 0]])
        rounds.append(Round(tuple(sides), side, line, right, np.zeros(len(line)), along_m))
        first += count
    return tuple(rounds)
