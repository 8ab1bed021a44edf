"""Interactions as traffic has them, each a row of a table: nothing is arranged to hide anybody.

Twelve rows are pre-crash scenarios of NHTSA's list (Najm, Smith and Yanagisawa, DOT HS 810 767, 2007), ten the kinds of
interaction of InterDrive (CoLMDriver, 2503.08683) and MDrive (2605.10904): merges, roundabouts, unprotected turns,
crowded junctions and an emergency vehicle. Narrow passages are the situation `overtaking`.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from coopsim.support.checks import require_choice
from coopsim.types.taxonomy import ObjectClass
from coopsim.world.places.layout import Layout
from coopsim.world.script import VehicleRole, WalkRole
from coopsim.world.situations.casting import CONFLICT_S, HEADWAY_S, draw, draw_model, passing
from coopsim.world.situations.junction_sites import Met, junction_sites, lane_sites
from coopsim.world.situations.sites import Reach, Way, comfortable_m_s, with_limits
from coopsim.world.situations.situation import EGO, SITUATIONS, Range, Situation, Stage

_CAR, _BICYCLE, _PEDESTRIAN, _VAN = ObjectClass.CAR, ObjectClass.BICYCLE, ObjectClass.PEDESTRIAN, ObjectClass.VAN
_TURN_M_S, _STREET_M_S, _ROAD_M_S = (4.5, 5.6), (8.3, 13.9), (9.7, 15.3)
_AFTER_M = 20.0
_WIDE_M = 7.0  # from the middle of the ego's lane to where a walk begins and ends
_FREE_M = 9.0  # around the place of the conflict, without drawn parked vehicles
_OCCUPIED = (0.3, 0.9)  # share of the bays with a vehicle


@dataclass(frozen=True, slots=True)
class Crosses:
    """A vehicle on another way over the junction.

    Attributes:
        met: relation of its way to the ego's.
        late_s: time by which its middle reaches the place where the ways meet after the ego's, if neither reacts.
        speed_m_s: its speed.
        manner: see `coopsim.world.script.VehicleRole`.
        label: its class.
    """

    met: Met
    late_s: Range = (-0.8, 0.8)
    speed_m_s: Range = _STREET_M_S
    manner: str = "unyielding"
    label: ObjectClass = _CAR


@dataclass(frozen=True, slots=True)
class Leads:
    """A vehicle in the ego's lane, or in the lane to its right.

    Attributes:
        ahead_s: time by which its middle passes the place before the ego's; of one that stands, it is there.
        speed: share of the ego's speed.
        manner: see `coopsim.world.script.VehicleRole`.
        beside: it is in the lane to the right.
        leaves_s: time to the vehicle that stands in its lane at which it changes lane.
        conflicts: the ego may crash into it.
        on_m: distance of the place where it stands behind the ego's place of interest, in the direction of travel.
    """

    ahead_s: Range = (0.0, 0.0)
    speed: Range = (0.0, 0.0)
    manner: str = "steady"
    beside: bool = False
    leaves_s: Range | None = None
    conflicts: bool = True
    on_m: float = 0.0


@dataclass(frozen=True, slots=True)
class Walks:
    """A person who crosses the ego's lane.

    Attributes:
        label: class of the person.
        speed_m_s: walking or riding speed.
        late_s: time by which the middle of the lane is reached after the ego's middle is there, if neither reacts.
    """

    label: ObjectClass = _PEDESTRIAN
    speed_m_s: Range = (1.1, 1.9)
    late_s: Range = (-0.6, 0.6)


@dataclass(frozen=True, slots=True)
class Row:
    """An interaction.

    Attributes:
        others: vehicles and people, of which the first is that of the conflict.
        turn: turn of the ego over a junction, "left", "straight" or "right"; empty: it stays in its lane.
        speed_m_s: the ego's speed.
        first: who has the right of way: "ego", "other", or "" for whom the place gives it to.
        named: the built-in place.
        elsewhere: whether other places may have sites.
    """

    others: tuple[Crosses | Leads | Walks, ...]
    turn: str = ""
    speed_m_s: Range = _STREET_M_S
    first: str = ""
    named: str = "crossing"
    elsewhere: bool = True


_LEFT, _RIGHT, _AHEAD = (Met(comes, "straight") for comes in ("left", "right", "ahead"))
_ONCOMING = Crosses(_AHEAD, manner="unyielding")
_USUAL = (-0.8, 0.8)

PRE_CRASH: Mapping[str, Row] = {
    "lead_stopped": Row((Leads(),), speed_m_s=_ROAD_M_S),
    "lead_brakes": Row((Leads((1.0, 1.6), (1.0, 1.0), "usual"), Leads(conflicts=False, on_m=8.0)), speed_m_s=_ROAD_M_S),
    "lead_slower": Row((Leads((0.0, 0.0), (0.25, 0.5)),), speed_m_s=_ROAD_M_S),
    "cut_in": Row(
        (
            Leads((0.3, 0.7), (0.6, 0.8), "leaves lane", beside=True, leaves_s=(1.6, 2.4)),
            Leads(beside=True, conflicts=False),
        ),
        speed_m_s=(15.0, 22.0),
        named="highway",
        elsewhere=False,
    ),
    "straight_crossing": Row((Crosses(_RIGHT),), "straight"),
    "stop_sign_runner": Row((Crosses(_LEFT, speed_m_s=(9.7, 15.3)),), "straight", first="ego"),
    "left_turn_opposite": Row((_ONCOMING,), "left", _TURN_M_S, first="other"),
    "crossing_left_turn": Row((Crosses(Met("right", "left"), speed_m_s=_TURN_M_S),), "straight", first="ego"),
    "right_turn_into_path": Row((Crosses(Met("right", "right"), speed_m_s=_TURN_M_S),), "straight", first="ego"),
    "walker_crosses": Row((Walks(),)),
    "walker_at_turn": Row((Walks(),), "right", _TURN_M_S),
    "cyclist_crosses": Row((Walks(_BICYCLE, (3.0, 5.5)),)),
}
"""Rows of NHTSA's list."""

INTERACTIVE: Mapping[str, Row] = {
    "joins_traffic": Row((Crosses(_LEFT), Crosses(_LEFT, (2.4, 3.2))), "right", _TURN_M_S, first="other"),
    "roundabout_entry": Row(
        (Crosses(Met("any", "left"), speed_m_s=_TURN_M_S),), "right", _TURN_M_S, "other", "roundabout", False
    ),
    "roundabout_circulating": Row(
        (Crosses(Met("any", "right"), speed_m_s=_TURN_M_S),), "left", _TURN_M_S, "ego", "roundabout", False
    ),
    "unprotected_left": Row((_ONCOMING, replace(_ONCOMING, late_s=(2.0, 3.0))), "left", _TURN_M_S, first="other"),
    "oncoming_turns_left": Row((Crosses(Met("ahead", "left"), speed_m_s=_TURN_M_S),), "straight", first="ego"),
    "opposing_right_and_left": Row((Crosses(Met("ahead", "left"), _USUAL, _TURN_M_S, "usual"),), "right", _TURN_M_S),
    "four_way": Row(
        tuple(Crosses(each, _USUAL, manner="usual") for each in (_RIGHT, _LEFT, _AHEAD)), "left", _TURN_M_S
    ),
    "stream_crossing": Row(
        tuple(Crosses(way, late) for way, late in ((_LEFT, _USUAL), (_RIGHT, _USUAL), (_LEFT, (2.6, 3.4)))),
        "straight",
        first="other",
    ),
    "blocked_exit": Row((Leads(),), "straight"),
    "emergency_vehicle": Row((Crosses(_LEFT, speed_m_s=(13.9, 18.0), label=_VAN),), "straight", first="ego"),
}
"""Rows of interactions."""

ROWS: Mapping[str, Row] = {**PRE_CRASH, **INTERACTIVE}
"""All rows by name."""


@SITUATIONS.register("interaction")
@dataclass(frozen=True, kw_only=True, eq=False)
class Interaction(Situation):
    """The interaction of a row.

    Attributes:
        kind: name of the row.
    """

    kind: str = "straight_crossing"

    name = "interaction"
    over_s: float = 10.0
    calibrated: ClassVar[bool] = False

    def __post_init__(self) -> None:
        require_choice("kind", self.kind, ROWS)
        super().__post_init__()

    @property
    def row(self) -> Row:
        """The row."""
        return ROWS[self.kind]

    @property
    def built_in(self) -> str:
        """Name of the row's built-in place."""
        return self.row.named

    @property
    def movable(self) -> bool:
        """Whether other places may have sites for the row."""
        return self.row.elsewhere

    def stage(self, layout: Layout, rng: np.random.Generator) -> Stage | None:
        """Draw the interaction; see `Situation.stage`."""
        row, speed = self.row, draw(rng, self.row.speed_m_s)
        crosses = [each for each in row.others if isinstance(each, Crosses)]
        speeds = [draw(rng, each.speed_m_s) for each in crosses]
        reach = Reach(speed * CONFLICT_S, _AFTER_M, speed, speed * (CONFLICT_S + HEADWAY_S[1]))
        if row.turn:
            reaches = [Reach(v * (CONFLICT_S + 0.8), _AFTER_M, v, v * (CONFLICT_S + 3.5)) for v in speeds]
            met = list(zip([each.met for each in crosses], reaches, strict=True))
            sites = junction_sites(layout, rng, row.turn, reach, met)
        else:
            sites = lane_sites(
                layout, rng, reach, beside=any(each.beside for each in row.others if isinstance(each, Leads))
            )
        site = next(sites, None)
        if site is None:
            return None
        speed = min(speed, slowest_m_s(site.way, -reach.before_m, reach.after_m))
        limits, ego = dict.fromkeys(site.way.roads, speed), draw_model(rng, _CAR)
        vehicles = [passing("behind", site.way, CONFLICT_S + draw(rng, HEADWAY_S), speed)]
        for k, (each, way, along_m, v) in enumerate(zip(crosses, site.ways, site.along_m, speeds, strict=True)):
            v = min(v, slowest_m_s(way, -v * CONFLICT_S, _AFTER_M))
            limits |= dict.fromkeys([road for road in way.roads if road not in site.way.roads], v)
            at_s = CONFLICT_S + along_m / speed + draw(rng, each.late_s)
            vehicles.append(
                passing(f"other {k + 1}", way, at_s, v, manner=each.manner, label=each.label, conflicts=True)
            )
            vehicles.append(passing(f"behind other {k + 1}", way, at_s + draw(rng, HEADWAY_S), v))
        leads = [each for each in row.others if isinstance(each, Leads)]
        vehicles += [
            self._leader(rng, k, each, site.beside if each.beside else site.way, speed) for k, each in enumerate(leads)
        ]
        walkers = [each for each in row.others if isinstance(each, Walks)]
        at = site.way.position(0.0)
        bays = tuple(bay for bay in layout.bays if np.hypot(bay.x_m - at[0], bay.y_m - at[1]) > _FREE_M)
        priority = {"ego": site.movement, "other": site.others}.get(row.first, layout.priority)
        return Stage(
            replace(with_limits(layout, limits), bays=bays, priority=priority),
            passing(EGO, site.way, CONFLICT_S, speed, connected=True, model=ego.name),
            tuple(vehicles),
            tuple(_walk(rng, each, site.way, layout.outer_side) for each in walkers),
            at,
            int(draw(rng, _OCCUPIED) * len(bays)),
        )

    def _leader(self, rng: np.random.Generator, number: int, each: Leads, way: Way, speed: float) -> VehicleRole:
        """Return a vehicle ahead in a lane."""
        own, name = speed * draw(rng, each.speed), f"leader {number + 1}"
        if not own:
            lane, along_m = way.find(each.on_m)
            return VehicleRole(
                name, lane, along_m, 0.0, way.roads_from(each.on_m), manner="steady", conflicts=each.conflicts
            )
        trigger_m = None if each.leaves_s is None else own * draw(rng, each.leaves_s)
        at_s = CONFLICT_S - draw(rng, each.ahead_s)
        return passing(name, way, at_s, own, manner=each.manner, conflicts=each.conflicts, trigger_m=trigger_m)


def slowest_m_s(way: Way, start_m: float, end_m: float) -> float:
    """Return the least comfortable speed on a part of a way, m/s; infinite where it is straight."""
    ends = [*way.starts_m[1:].tolist(), np.inf]
    inside = [
        lane
        for lane, start, end in zip(way.lanes, way.starts_m.tolist(), ends, strict=True)
        if start < end_m and end > start_m
    ]
    return min((comfortable_m_s(way.network.get_lane(lane)) for lane in inside), default=np.inf)


def _walk(rng: np.random.Generator, each: Walks, way: Way, outer: int) -> WalkRole:
    """Return a walk over the ego's lane at its place of interest, from either side."""
    speed, late_s, side = draw(rng, each.speed_m_s), draw(rng, each.late_s), 1 if rng.random() < 0.5 else -1
    path = [way.position(0.0, side * outer * aside_m) for aside_m in (_WIDE_M, 0.0, -_WIDE_M)]
    starts_s = CONFLICT_S + late_s - _WIDE_M / speed
    return WalkRole("person", each.label, np.array(path), speed, starts_s, conflicts=True)
