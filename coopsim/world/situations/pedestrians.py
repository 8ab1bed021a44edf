"""Situations 1 and 2: a person steps onto the road from behind a parked van, or from between parked cars.

Both stand in NHTSA's list of pre-crash scenarios as "pedestrian crash without prior vehicle maneuver" (Najm, Smith and
Yanagisawa, DOT HS 810 767, 2007). Speeds are those of Euro NCAP's tests of automatic emergency braking (Vulnerable
Road User protocol 4.5, 2023: scenarios CPNA, CPNCO): cars at 20 to 60 km/h, adults and children at 5 km/h, running
people at 8 km/h.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from coopsim.types.taxonomy import ObjectClass
from coopsim.world.places.layout import Layout
from coopsim.world.script import VehicleRole, WalkRole
from coopsim.world.situations.casting import CONFLICT_S, HEADWAY_S, draw, draw_model, passing, standing
from coopsim.world.situations.sites import KerbSite, Reach, Way, kerb_sites, oncoming_way, with_limits
from coopsim.world.situations.situation import EGO, SITUATIONS, Range, Situation, Stage

_AHEAD_S = (3.5, 4.5)
_ONCOMING_S = ((-2.0, -1.2), (0.2, 1.0), (2.2, 3.2))
_AFTER_M = 30.0
_FAR_SIDE_M = 7.0
_ROOM_M = 5.0  # from the lane to a building: space to walk beside the bay
_BESIDE_BAY_M = 7.0  # drawn parked vehicles keep away from the script's


@dataclass(frozen=True, kw_only=True, eq=False)
class _FromTheKerb(Situation):
    """A person walks onto the road right behind something that is parked.

    Attributes:
        speed_m_s: speed on the street, the ego's too.
        walking_m_s: the person's speed.
        gap_m: distance between the occluder's front and the middle of the person's way.
        late_s: time by which the person reaches the middle of the ego's lane after the ego's front reaches the
            person's way, if neither reacts.
        approach_m: distance from the middle of the ego's lane at which the walk begins, as far as there is space.
        occupied: share of the street's other bays that have a vehicle.
    """

    speed_m_s: Range = (9.7, 15.3)
    walking_m_s: Range = (1.7, 2.6)
    gap_m: Range = (0.3, 0.8)
    late_s: Range = (0.2, 0.7)
    approach_m: Range = (5.5, 9.0)
    occupied: Range = (0.3, 0.9)

    named: ClassVar[str] = "parking_street"
    person: ClassVar[tuple[str, ObjectClass]]
    """Name and class of the person."""

    def occluders(self, rng: np.random.Generator, site: KerbSite, gap_m: float) -> tuple[float, list[VehicleRole]]:
        """Draw the parked vehicles that hide the person; return the place of the person's way, and them."""
        raise NotImplementedError

    def stage(self, layout: Layout, rng: np.random.Generator) -> Stage | None:
        """Draw the situation; see `Situation.stage`."""
        speed, walking, late, gap, approach, occupied = (
            draw(rng, ends)
            for ends in (self.speed_m_s, self.walking_m_s, self.late_s, self.gap_m, self.approach_m, self.occupied)
        )
        reach = Reach(speed * CONFLICT_S, _AFTER_M, speed, speed * (CONFLICT_S + HEADWAY_S[1]))
        towards = Reach(_AFTER_M, _AFTER_M, speed, speed * (CONFLICT_S + _ONCOMING_S[-1][1]))
        for site in kerb_sites(layout, rng.permutation(len(layout.bays)).tolist(), reach):
            oncoming = oncoming_way(site.way, towards, layout.outer_side)
            if oncoming is not None and site.room_m > _ROOM_M:
                break
        else:
            return None
        across_m, parked = self.occluders(rng, site, gap)
        bays = tuple(bay for bay in layout.bays if not _is_beside(site.way, (bay.x_m, bay.y_m), across_m))
        limits = dict.fromkeys((*site.way.roads, *oncoming.roads), speed)
        length_m = float((ego := draw_model(rng, ObjectClass.CAR)).size_m[0])
        fronts_s = CONFLICT_S - (across_m - length_m / 2) / speed
        traffic = _traffic(rng, site.way, oncoming, fronts_s, speed)
        near_m = min(approach, site.room_m - 0.6, walking * (CONFLICT_S + late))
        path = [site.way.position(across_m, layout.outer_side * aside) for aside in (near_m, 0.0, -_FAR_SIDE_M)]
        starts_s = CONFLICT_S + late - near_m / walking
        walk = WalkRole(*self.person, np.array(path), walking, max(starts_s, 0.0), conflicts=True)
        return Stage(
            replace(with_limits(layout, limits), bays=bays),
            passing(EGO, site.way, fronts_s, speed, connected=True, model=ego.name),
            (*traffic, *parked),
            (walk,),
            path[1],
            int(occupied * len(bays)),
        )


def _traffic(rng: np.random.Generator, way: Way, oncoming: Way, ego_s: float, speed: float) -> list[VehicleRole]:
    """Draw the other traffic: one car far ahead of the ego, one behind it, three that come towards it."""
    ahead, behind = ego_s - draw(rng, _AHEAD_S), ego_s + draw(rng, HEADWAY_S)
    cars = [passing("ahead", way, ahead, speed), passing("behind", way, behind, speed)]
    times = [CONFLICT_S + draw(rng, ends) for ends in _ONCOMING_S]
    return cars + [passing(f"oncoming {k}", oncoming, at_s, speed) for k, at_s in enumerate(times, start=1)]


def _is_beside(way: Way, point: tuple[float, float], across_m: float) -> bool:
    """Return whether a bay is where the script's vehicles are parked and its person walks."""
    offset = np.array(point) - way.position(across_m)
    return bool(np.hypot(*offset) < _BESIDE_BAY_M + across_m)


def _in_bay(rng: np.random.Generator, site: KerbSite) -> float:
    """Draw the distance from the way's middle, to its left, to the middle of a vehicle in the bay."""
    return site.bay_m - math.copysign(1.0, site.bay_m) * draw(rng, (-0.2, 0.2))


@SITUATIONS.register("occluded_pedestrian")
@dataclass(frozen=True, kw_only=True, eq=False)
class OccludedPedestrian(_FromTheKerb):
    """An adult walks onto the road in front of a parked van or truck."""

    name = "occluded_pedestrian"
    person: ClassVar[tuple[str, ObjectClass]] = ("pedestrian", ObjectClass.PEDESTRIAN)

    def occluders(self, rng: np.random.Generator, site: KerbSite, gap_m: float) -> tuple[float, list[VehicleRole]]:
        """Draw a van."""
        van = draw_model(rng, ObjectClass.VAN)
        aside_m = _in_bay(rng, site)
        return float(van.size_m[0]) / 2 + gap_m, [standing("van", site.way, 0.0, aside_m, van)]


@SITUATIONS.register("child_between_cars")
@dataclass(frozen=True, kw_only=True, eq=False)
class ChildBetweenCars(_FromTheKerb):
    """A child runs onto the road between two parked cars."""

    name = "child_between_cars"
    person: ClassVar[tuple[str, ObjectClass]] = ("child", ObjectClass.CHILD)

    gap_m: Range = (0.5, 0.9)

    def occluders(self, rng: np.random.Generator, site: KerbSite, gap_m: float) -> tuple[float, list[VehicleRole]]:
        """Draw two cars, the same distance from the child's way."""
        first, second = draw_model(rng, ObjectClass.CAR), draw_model(rng, ObjectClass.CAR)
        aside_m = [_in_bay(rng, site) for _ in range(2)]
        across_m = float(first.size_m[0]) / 2 + gap_m
        after_m = across_m + gap_m + float(second.size_m[0]) / 2
        return across_m, [
            standing("first car", site.way, 0.0, aside_m[0], first),
            standing("second car", site.way, after_m, aside_m[1], second),
        ]
