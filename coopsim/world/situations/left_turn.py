"""Situation 5: a left turn across the path of an oncoming car, which a truck in the opposite bay hides.

NHTSA's pre-crash scenario "left turn across path, opposite direction" (Najm, Smith and Yanagisawa, DOT HS 810 767,
2007). Speeds are those of Euro NCAP's scenario CCFtap (2023 protocol): the car that turns at 10 to 20 km/h, the
oncoming one at 30 to 60 km/h.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from coopsim.geometry import exact
from coopsim.types.taxonomy import ObjectClass
from coopsim.world.places.avenue import BAY_M, make_avenue
from coopsim.world.places.layout import Layout
from coopsim.world.places.road_network import CircularLane
from coopsim.world.script import VehicleRole
from coopsim.world.situations.casting import CONFLICT_S, HEADWAY_S, draw, draw_model, passing
from coopsim.world.situations.sites import Way, way_through, with_limits
from coopsim.world.situations.situation import EGO, SITUATIONS, Range, Situation, Stage

_TURN = (("bay2", "wait2"), ("wait2", "exit1"), ("exit1", "bend1"))
_ONCOMING = (("far0", "near0"), ("near0", "stop0"), ("stop0", "exit2"), ("exit2", "bend2"))
_BAY = ("bay0", "wait0", 0)
_LINE_M = 16.0  # from the middle of the junction to the end of a bay
_GONE_S, _LATER_S = (-3.4, -2.6), (2.4, 3.4)  # oncoming cars, before and after the one that conflicts
_SPACING_M = (1.5, 3.0)  # to the car that waits behind the truck


@SITUATIONS.register("left_turn_across")
@dataclass(frozen=True, kw_only=True, eq=False)
class LeftTurnAcross(Situation):
    """The ego turns left at a crossing of avenues; a truck that waits to turn left hides an oncoming car.

    Attributes:
        speed_m_s: speed of the ego in the turn: 16 to 23 km/h.
        oncoming_m_s: speed of the oncoming car: 40 to 60 km/h.
        late_s: time by which the oncoming car's middle reaches the crossing of the two ways after the ego's, if
            neither reacts.
        truck_m: distance from the middle of the junction to the truck's front: it has moved up to turn soon.
    """

    speed_m_s: Range = (4.5, 6.4)
    oncoming_m_s: Range = (11.1, 16.7)
    late_s: Range = (-0.4, 0.4)
    truck_m: Range = (4.0, 10.0)

    over_s: float = 10.0

    name = "left_turn_across"
    named: ClassVar[str] = "crossing"
    elsewhere: ClassVar[bool] = False

    def stage(self, layout: Layout, rng: np.random.Generator) -> Stage | None:
        """Draw the situation; see `Situation.stage`."""
        ranges = (self.speed_m_s, self.oncoming_m_s, self.late_s, self.truck_m)
        speed, oncoming_m_s, late, truck_m = (draw(rng, ends) for ends in ranges)
        limits = dict.fromkeys(_TURN[:2], speed) | dict.fromkeys(_ONCOMING, oncoming_m_s)
        staged = with_limits(make_avenue(), limits)
        turn, oncoming = _ways(staged)
        ego = draw_model(rng, ObjectClass.CAR)
        conflict_s = CONFLICT_S + late
        cars = [passing("oncoming", oncoming, conflict_s, oncoming_m_s, manner="unyielding", conflicts=True)]
        cars.append(passing("gone", oncoming, conflict_s + draw(rng, _GONE_S), oncoming_m_s))
        cars.append(passing("later", oncoming, conflict_s + draw(rng, _LATER_S), oncoming_m_s))
        cars.append(passing("behind", turn, CONFLICT_S + draw(rng, HEADWAY_S), speed))
        return Stage(
            staged,
            passing(EGO, turn, CONFLICT_S, speed, connected=True, model=ego.name),
            (*cars, *_waiting(rng, truck_m)),
            (),
            turn.position(0.0),
        )


def _ways(layout: Layout) -> tuple[Way, Way]:
    """Return the ways of the ego and of oncoming cars, with their crossing as the place of interest."""
    bend = layout.network.get_lane((*_TURN[1], 0))
    straight = layout.network.get_lane((*_ONCOMING[2], 0))
    assert isinstance(bend, CircularLane)
    rise_m = float(bend.center[1] - straight.position(0.0, 0.0)[1])
    turned_rad = float(exact.arccos(rise_m / bend.radius))
    turn = way_through(layout.network, _TURN, 1, turned_rad * bend.radius)
    along_m = straight.local_coordinates(turn.position(0.0))[0]
    return turn, way_through(layout.network, _ONCOMING, 2, along_m)


def _waiting(rng: np.random.Generator, truck_m: float) -> Iterator[VehicleRole]:
    """Draw the truck in the opposite bay, the car behind it, and cars at the lines of the side streets."""
    truck, behind = draw_model(rng, ObjectClass.TRUCK), draw_model(rng, ObjectClass.CAR)
    along_m = BAY_M + _LINE_M - truck_m - float(truck.size_m[0]) / 2
    yield VehicleRole("truck", _BAY, along_m, 0.0, (), ObjectClass.TRUCK, "parked", model=truck.name)
    along_m -= float(truck.size_m[0] + behind.size_m[0]) / 2 + draw(rng, _SPACING_M)
    # These stand, but not parked: they may be connected.
    yield VehicleRole("behind the truck", _BAY, along_m, 0.0, (_BAY[:2],), manner="steady", model=behind.name)
    for arm in (1, 3):
        lane = (f"near{arm}", f"stop{arm}", 0)
        yield VehicleRole(f"waiting {arm}", lane, 24.0 - 2.5 - draw(rng, (0.0, 1.5)), 0.0, (lane[:2],), manner="steady")
