"""Situations 3 and 4: straight crossing paths at a corner where something hides the streets from each other.

NHTSA's pre-crash scenarios "straight crossing paths at non-signalized junctions" and "running red light" or "running
stop sign" (Najm, Smith and Yanagisawa, DOT HS 810 767, 2007). Speeds are those of Euro NCAP's car-to-car crossing
scenario CCCscp (2023 protocol: 20 to 60 km/h for both).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from coopsim.types.taxonomy import ObjectClass
from coopsim.world.places.layout import Layout
from coopsim.world.script import VehicleRole
from coopsim.world.situations.casting import CONFLICT_S, HEADWAY_S, draw, draw_model, passing, standing
from coopsim.world.situations.sites import CornerSite, Reach, Way, corner_sites, is_hidden, oncoming_way, with_limits
from coopsim.world.situations.situation import EGO, SITUATIONS, Range, Situation, Stage

_OCCLUDERS = (ObjectClass.VAN, ObjectClass.TRUCK)
_HIDDEN_S = 3.0  # before the conflict, while a building must hide the two from each other
_LATER_S = (2.5, 3.5)
_GONE_S = (-1.6, -1.0)  # relative to the start: cars that have just left the junction
_AFTER_M = 30.0
_GAP_M = (0.8, 1.5)  # between vehicles that are parked in a row


@dataclass(frozen=True, kw_only=True, eq=False)
class _AtTheCorner(Situation):
    """A car comes from the side and does not stop.

    Attributes:
        speed_m_s: speed on the ego's street, the ego's too.
        other_speed_m_s: speed of the other car.
        late_s: time by which the other's middle reaches the crossing of the two ways after the ego's, if neither
            reacts.
        occluder_m: distance from the crossing of the ways to the front of the vehicles that stand at the corner.
        aside_m: distance from the middle of the lane to the near sides of those vehicles.
    """

    speed_m_s: Range = (8.3, 13.9)
    other_speed_m_s: Range = (8.3, 13.9)
    late_s: Range = (-0.4, 0.4)
    occluder_m: Range = (4.5, 7.5)
    aside_m: Range = (2.0, 2.5)

    named: ClassVar[str] = "crossing"
    has_priority: ClassVar[bool] = False
    """Whether the ego has the right of way."""

    def stage(self, layout: Layout, rng: np.random.Generator) -> Stage | None:
        """Draw the situation; see `Situation.stage`."""
        speed, other, late = (draw(rng, ends) for ends in (self.speed_m_s, self.other_speed_m_s, self.late_s))
        reach = [
            Reach(v * (CONFLICT_S + self.late_s[1]), _AFTER_M, v, v * (CONFLICT_S + _LATER_S[1] + 0.4))
            for v in (speed, other)
        ]
        towards = [replace(each, before_m=_AFTER_M) for each in reach]
        for site in corner_sites(layout, rng, *reach):
            ends = zip((site.way, site.across), towards, strict=True)
            against = [oncoming_way(way, each, layout.outer_side) for way, each in ends]
            hidden = is_hidden(layout, site.way.position(-speed * _HIDDEN_S), site.across.position(-other * _HIDDEN_S))
            if hidden and against[0] is not None and against[1] is not None:
                break
        else:
            return None
        ways = (site.way, site.across, against[0], against[1])
        limits = dict.fromkeys((*site.across.roads, *ways[3].roads), other)
        limits |= dict.fromkeys((*site.way.roads, *ways[2].roads), speed)
        staged = with_limits(layout, limits)
        if self.has_priority:
            staged = replace(staged, priority=(site.movements[0],))
        ego = draw_model(rng, ObjectClass.CAR)
        runner = passing("runner", site.across, CONFLICT_S + late, other, manner="unyielding", conflicts=True)
        return Stage(
            staged,
            passing(EGO, site.way, CONFLICT_S, speed, connected=True, model=ego.name),
            (runner, *_traffic(rng, ways, (speed, other), late), *self._occluders(rng, site, layout.outer_side)),
            (),
            site.way.position(0.0),
        )

    def _occluders(self, rng: np.random.Generator, site: CornerSite, outer: int) -> list[VehicleRole]:
        """Draw two vehicles at the corner: at the kerb of whichever of the two has the other on that side."""
        way = site.way if site.side == outer else site.across
        front_m, aside_m, roles = -draw(rng, self.occluder_m), draw(rng, self.aside_m), list[VehicleRole]()
        for name in ("first occluder", "second occluder"):
            model = draw_model(rng, *_OCCLUDERS)
            length_m, width_m = (float(size) for size in model.size_m[:2])
            roles.append(standing(name, way, front_m - length_m / 2, outer * (aside_m + width_m / 2), model))
            front_m -= length_m + draw(rng, _GAP_M)
        return roles


def _traffic(
    rng: np.random.Generator, ways: tuple[Way, ...], speeds: tuple[float, float], late_s: float
) -> list[VehicleRole]:
    """Draw the other traffic: a car behind the ego, one behind the runner, two that come towards each of them."""
    own, other = speeds
    _, across, oncoming, facing = ways
    cars = [passing("behind", ways[0], CONFLICT_S + draw(rng, HEADWAY_S), own)]
    cars.append(passing("behind the runner", across, CONFLICT_S + late_s + draw(rng, HEADWAY_S), other))
    for name, way, speed in (("oncoming", oncoming, own), ("facing the runner", facing, other)):
        cars.append(passing(f"{name}, gone", way, draw(rng, _GONE_S), speed))
        cars.append(passing(f"{name}, to come", way, CONFLICT_S + draw(rng, _LATER_S), speed))
    return cars


@SITUATIONS.register("crossing_path")
@dataclass(frozen=True, kw_only=True, eq=False)
class CrossingPath(_AtTheCorner):
    """A car crosses the ego's way behind the corner of a building, where nobody has the right of way."""

    name = "crossing_path"


@SITUATIONS.register("red_light_runner")
@dataclass(frozen=True, kw_only=True, eq=False)
class RedLightRunner(_AtTheCorner):
    """A car runs a red light or a stop line; the ego, like all on its street, has the right of way."""

    other_speed_m_s: Range = (11.1, 15.3)

    name = "red_light_runner"
    has_priority: ClassVar[bool] = True
