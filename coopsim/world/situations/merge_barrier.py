"""Situation 8: a merge behind a noise barrier, which hides the main road from the slip road.

NHTSA's pre-crash scenario "vehicles changing lanes or merging, same direction" (Najm, Smith and Yanagisawa, DOT HS
810 767, 2007).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from coopsim.types.taxonomy import ObjectClass
from coopsim.world.places.layout import Layout
from coopsim.world.places.merge import make_merge
from coopsim.world.situations.casting import CONFLICT_S, HEADWAY_S, draw, draw_model, passing
from coopsim.world.situations.sites import way_through, with_limits
from coopsim.world.situations.situation import EGO, SITUATIONS, Range, Situation, Stage

_SLIP = (("ramp", "bend"), ("bend", "give_way"), ("give_way", "join"), ("join", "east"))
_MAIN = (("west", "line"), ("line", "join"), ("join", "east"))
_TOUCH_M = 17.0  # before the roads' middle lines meet, where a car on the slip road begins to reach into the main road
_GONE_S, _LATER_S = (-4.5, -3.0), (2.6, 3.6)  # cars of the main road, before and after the one that conflicts


@SITUATIONS.register("merge_barrier")
@dataclass(frozen=True, kw_only=True, eq=False)
class MergeBarrier(Situation):
    """The ego merges from a slip road; a car that it cannot see in time has the right of way on the main road.

    Attributes:
        speed_m_s: speed on the slip road, the ego's too: 25 to 40 km/h.
        main_speed_m_s: speed on the main road: 45 to 60 km/h.
        late_s: time by which the other car reaches the place of the conflict after the ego, if neither reacts.
        barrier_end_m: place along the main road where the barrier between the two roads ends, before the place where
            they meet.
    """

    speed_m_s: Range = (7.0, 11.0)
    main_speed_m_s: Range = (12.5, 16.7)
    late_s: Range = (-0.4, 0.4)
    barrier_end_m: Range = (28.0, 40.0)

    over_s: float = 10.0

    name = "merge_barrier"
    named: ClassVar[str] = "merge"
    elsewhere: ClassVar[bool] = False

    def stage(self, layout: Layout, rng: np.random.Generator) -> Stage | None:
        """Draw the situation; see `Situation.stage`."""
        ranges = (self.speed_m_s, self.main_speed_m_s, self.late_s, self.barrier_end_m)
        speed, main, late, end = (draw(rng, ends) for ends in ranges)
        # The masts of the named place; the barrier stands at the main road's edge, as far as it hides the slip road.
        staged = replace(make_merge(end), priority=(("line", "join"),))
        slip = way_through(staged.network, _SLIP, 2, -_TOUCH_M)
        straight = way_through(staged.network, _MAIN, 1, -_TOUCH_M)
        limits = dict.fromkeys(_MAIN, main) | dict.fromkeys(_SLIP[:3], speed)
        ego = draw_model(rng, ObjectClass.CAR)
        conflict_s = CONFLICT_S + late
        cars = [passing("hidden", straight, conflict_s, main, manner="unyielding", conflicts=True)]
        cars += [passing("gone", straight, conflict_s + draw(rng, _GONE_S), main)]
        cars += [passing("to come", straight, conflict_s + draw(rng, _LATER_S), main)]
        cars += [passing("behind", slip, CONFLICT_S + draw(rng, HEADWAY_S), speed)]
        return Stage(
            with_limits(staged, limits),
            passing(EGO, slip, CONFLICT_S, speed, connected=True, model=ego.name),
            tuple(cars),
            (),
            slip.position(0.0),
        )
