"""Trees along streets, in gardens and on lawns, and small buildings behind others."""

from __future__ import annotations

import numpy as np

from coopsim.geometry import exact
from coopsim.geometry.se3 import Floats
from coopsim.support.rng import stream
from coopsim.world.places.layout import rectangle
from coopsim.world.towns.beside.building_shapes import Part
from coopsim.world.towns.beside.people_ways import PeopleWays
from coopsim.world.towns.beside.private_ground import PrivateGround
from coopsim.world.towns.beside.site import Site, frame_between
from coopsim.world.towns.streets.kerb_sides import STREET, Round
from coopsim.world.towns.streets.plan import LANE_M

_LINED = 0.4  # share of sides of streets with trees at the kerb
_FROM_KERB_M = 0.7
_APART_M = (9.0, 17.0)
_CROSSWALK_FREE_M = 7.0
_END_FREE_M = 14.0  # from junctions, so that drivers see each other
_TRUNK_M = 0.3
_EVERY_M = (26.0, 7.0)  # of border for each tree behind it, in towns of openness 0 and 1
_BEHIND_M = (3.0, 38.0)
_SHED_EVERY_M, _SHED_BEHIND_M = 70.0, (20.0, 45.0)


def line_streets(site: Site, rounds: tuple[Round, ...], ways: PeopleWays, seed: int) -> None:
    """Plant rows of trees between kerb and people's way, where no vehicle and nobody passes."""
    for each in rounds:
        places = each.beside(_FROM_KERB_M)
        for k, side in enumerate(each.sides):
            rng = stream(seed, "street trees", str(side.kind), str(side.number), str(side.arm))
            apart_m, size = rng.uniform(*_APART_M), rng.uniform(0.8, 1.15)
            if side.kind != STREET or rng.random() > _LINED:
                continue
            own = np.flatnonzero(each.side == k)
            along = each.along_m[own]
            low, high = along.min() + _END_FREE_M, along.max() - _END_FREE_M
            for at_m in np.arange(low, high, apart_m):
                if any(number == side.number and abs(at_m - at) < _CROSSWALK_FREE_M for number, at in ways.mid_block):
                    continue
                at = places[own[int(np.abs(along - at_m).argmin())]]
                trunk = at + rectangle((-_TRUNK_M, _TRUNK_M), (-_TRUNK_M, _TRUNK_M))
                if site.kerbside.try_take([trunk]):
                    height_m, crown_m = size * rng.uniform(8.0, 10.5), size * rng.uniform(3.0, 3.9)
                    site.add("trees", at=at.tolist(), height_m=round(height_m, 2), crown_m=round(crown_m, 2))


def plant_behind(site: Site, ground: PrivateGround) -> None:
    """Plant trees on private ground and on the islands of roundabouts, and put sheds behind the buildings.

    Args:
        site: the town, changed in place.
        ground: of the town.
    """
    for junction in ground.plan.junctions:
        if junction.kind == "roundabout" and junction.ring_m - LANE_M / 2 > 5.0:
            site.add("trees", at=junction.centre.tolist(), height_m=7.5, crown_m=4.5)
    for number, (each, border) in enumerate(zip(ground.rounds, ground.borders, strict=True)):
        length_m = float(exact.norm(np.diff(border, axis=0), axis=1).sum())
        rng = stream(ground.seed, "sheds", str(number))
        for at in _behind(each, border, int(length_m / _SHED_EVERY_M), _SHED_BEHIND_M, rng):
            size, angle = rng.uniform([4.0, 4.0], [12.0, 8.0]), rng.uniform(0.0, np.pi)
            frame = frame_between(at, at + np.array([exact.cos(angle), exact.sin(angle)]))
            if site.room.is_free(frame.place(rectangle((0.0, size[0]), (0.0, size[1]))), 3.0):
                site.build(frame, [Part(rectangle((0.0, size[0]), (0.0, size[1])))], float(rng.uniform(2.6, 5.0)))
        rng = stream(ground.seed, "trees", str(number))
        count = int(length_m / np.interp(ground.openness, (0.0, 1.0), _EVERY_M))
        for at in _behind(each, border, count, _BEHIND_M, rng):
            height_m, crown_m = rng.uniform(5.0, 13.0), rng.uniform(3.0, 6.5)
            site.plant(at, round(height_m, 2), round(crown_m, 2))


def _behind(each: Round, border: Floats, count: int, away_m: tuple[float, float], rng: np.random.Generator) -> Floats:
    """Draw places (N, 2) m on the far side of a border (M, 2) m."""
    index = rng.integers(len(border), size=count)
    places: Floats = border[index] + rng.uniform(*away_m, count)[:, None] * each.right[index]
    return places
