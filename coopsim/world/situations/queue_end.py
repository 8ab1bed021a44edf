"""Situation 6: the end of a standing queue, which a vehicle ahead hides until it changes lane.

NHTSA's pre-crash scenario "lead vehicle stopped", the most frequent of all (Najm, Smith and Yanagisawa, DOT HS 810 767,
2007), in the form of the cut-out of UN Regulation 157 (2021), annex 4, appendix 3.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from coopsim.types.taxonomy import ObjectClass
from coopsim.world.places.layout import Layout
from coopsim.world.places.road_network import StraightLane
from coopsim.world.script import VehicleRole
from coopsim.world.situations.casting import HEADWAY_S, draw, draw_model, passing, standing
from coopsim.world.situations.sites import Reach, Way, find_way, with_limits
from coopsim.world.situations.situation import EGO, SITUATIONS, Range, Situation, Stage

_HIDING = (ObjectClass.VAN, ObjectClass.TRUCK, ObjectClass.BUS)
_ENDS = (ObjectClass.CAR, ObjectClass.VAN, ObjectClass.TRUCK)
_QUEUED = 3  # cars before the last vehicle of the queue
_SPACING_M = (1.5, 4.0)  # between the bumpers in a queue
_BEGIN_S = 6.0  # from the start until the ego would reach the queue
_PASSED_S, _PASSING_S = (-3.5, -2.0), (0.9, 2.0)  # cars of the next lane, before and after the ego
_NEAR_MAST_M = 60.0
_AFTER_M = 150.0


@SITUATIONS.register("queue_end")
@dataclass(frozen=True, kw_only=True, eq=False)
class QueueEnd(Situation):
    """A queue stands in the ego's lane; the vehicle ahead leaves the lane so late that the ego has little time.

    Attributes:
        speed_m_s: speed of the traffic, the ego's too: 65 to 90 km/h.
        headway_s: time gap between the ego and the vehicle ahead.
        leaves_s: time to the queue at which the vehicle ahead begins to change lane.
    """

    speed_m_s: Range = (18.0, 25.0)
    headway_s: Range = (0.8, 1.6)
    leaves_s: Range = (1.6, 2.2)

    name = "queue_end"
    named: ClassVar[str] = "highway"
    elsewhere: ClassVar[bool] = False
    over_s: float = 12.0

    def stage(self, layout: Layout, rng: np.random.Generator) -> Stage | None:
        """Draw the situation; see `Situation.stage`."""
        speed, headway_s, leaves_s = (draw(rng, ends) for ends in (self.speed_m_s, self.headway_s, self.leaves_s))
        reach = Reach(speed * (_BEGIN_S + HEADWAY_S[1] + 1.0), _AFTER_M, speed)
        sites = [*_sites(layout, reach, draw(rng, (-_NEAR_MAST_M, _NEAR_MAST_M)))]
        if not sites:
            return None
        way, beside = sites[int(rng.integers(len(sites)))]
        ego, tall = draw_model(rng, ObjectClass.CAR), draw_model(rng, *_HIDING)
        before_s = headway_s + float(ego.size_m[0] + tall.size_m[0]) / 2 / speed
        leader = passing("leader", way, _BEGIN_S - before_s, speed, label=ObjectClass(tall.label), model=tall.name)
        cars = [passing("behind", way, _BEGIN_S + draw(rng, HEADWAY_S), speed)]
        cars.append(passing("passed", beside, _BEGIN_S - before_s + draw(rng, _PASSED_S), speed))
        cars.append(passing("passing", beside, _BEGIN_S + draw(rng, _PASSING_S), speed))
        return Stage(
            with_limits(layout, dict.fromkeys(way.roads, speed)),
            passing(EGO, way, _BEGIN_S, speed, connected=True, model=ego.name),
            (*_queue(rng, way), replace(leader, manner="leaves lane", trigger_m=speed * leaves_s), *cars),
            (),
            way.position(0.0),
        )


def _queue(rng: np.random.Generator, way: Way) -> Iterator[VehicleRole]:
    """Draw a queue, from its end on."""
    model = draw_model(rng, *_ENDS)
    yield replace(standing("end of the queue", way, 0.0, draw(rng, (-0.3, 0.3)), model), conflicts=True)
    front_m = float(model.size_m[0]) / 2
    for k in range(_QUEUED):
        model = draw_model(rng, ObjectClass.CAR)
        front_m += draw(rng, _SPACING_M) + float(model.size_m[0])
        place = way.find(front_m - float(model.size_m[0]) / 2)
        # A moving vehicle that stands, and not a parked one: it may be connected.
        yield VehicleRole(f"queued {k + 1}", *place, 0.0, way.roads, manner="steady", model=model.name)


def _sites(layout: Layout, reach: Reach, beyond_m: float) -> Iterator[tuple[Way, Way]]:
    """Yield ways near a mast that have a lane to their left, and the ways on those."""
    masts = layout.rsus[len(layout.rsus) // 2 :][:1]
    for index, lane in layout.network.lanes.items():
        if index[2] == 0 or not isinstance(lane, StraightLane):
            continue
        mast_m = lane.local_coordinates(masts[0].translation[:2])[0] if masts else lane.length / 2
        left = (*index[:2], index[2] - 1)
        ways = [find_way(layout.network, each, mast_m + beyond_m, reach) for each in (index, left)]
        if ways[0] is not None and ways[1] is not None:
            yield ways[0], ways[1]
