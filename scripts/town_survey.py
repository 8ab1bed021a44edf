"""Survey of drawn places: faults beyond those that the reader of places refuses, and their traffic.

Traffic is driven for a while, without sensing, and what goes wrong is noted.

A vehicle stands while it is slower than `STANDING_M_S`. Left out are parked vehicles, wrecks, and vehicles held by a
wreck: those that stand within `HELD_BY_M` of one, or within `QUEUE_M` of a vehicle that is so held. A jam is a vehicle
that stands for longer than `JAM_S`, whatever it waits for. A deadlock is a jam in which, for as long, no vehicle within
`AROUND_M` moves either: nobody is let through. In other jams one waits one's turn, or for the others ahead.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from coopsim.geometry import exact
from coopsim.geometry.se3 import Floats
from coopsim.world.places.layout import Layout
from coopsim.world.scenario import Scenario
from coopsim.world.traffic.fleet import PARKED
from coopsim.world.world import World

DT_S = 0.1
STANDING_M_S = 0.5
JAM_S = 30.0
HELD_BY_M = 30.0
QUEUE_M = 15.0
AROUND_M = 40.0
SAME_CRASH_M = 15.0
"""Vehicles that crash in one step and are this close, center to center, are in the same crash."""

SHORTEST_WAIT_S = 1.0
"""A shorter standstill is not counted as a wait."""

Bools = NDArray[np.bool_]


@dataclass(frozen=True, slots=True)
class Standstill:
    """A vehicle that stands.

    Attributes:
        vehicle: its id.
        x_m: of its center, world frame.
        y_m: of its center, world frame.
        since_s: the episode's time at which it stopped.
        for_s: how long it stood, or has stood at the end.
        frozen_s: longest part of it in which no vehicle around moved.
    """

    vehicle: int
    x_m: float
    y_m: float
    since_s: float
    for_s: float
    frozen_s: float

    @property
    def is_deadlock(self) -> bool:
        """Whether nobody around moved for longer than `JAM_S`."""
        return self.frozen_s > JAM_S


@dataclass(frozen=True, slots=True)
class Crash:
    """Vehicles that touched something in one step, close to each other.

    Attributes:
        time_s: of the episode.
        vehicles: their ids.
        x_m: of the first of them.
        y_m: of the first of them.
        parked: whether none of them drives: a person has walked into a parked vehicle.
    """

    time_s: float
    vehicles: tuple[int, ...]
    x_m: float
    y_m: float
    parked: bool


@dataclass(frozen=True, slots=True)
class TrafficSurvey:
    """What was noted in one place.

    Attributes:
        seconds: driven.
        vehicles: number of them that are not parked.
        vehicle_hours: of vehicles neither parked nor wrecked.
        distance_km: driven by all of them.
        crashes: in order of time.
        waits_s: durations of all standstills of at least `SHORTEST_WAIT_S`.
        jams: standstills longer than `JAM_S`.
        first_m_s: mean speed in the first sixth of the time, as in the first ten minutes of an hour.
        last_m_s: mean speed in the last sixth.
        fewest: smallest number of actors, people included.
    """

    seconds: float
    vehicles: int
    vehicle_hours: float
    distance_km: float
    crashes: tuple[Crash, ...]
    waits_s: tuple[float, ...]
    jams: tuple[Standstill, ...]
    first_m_s: float = 0.0
    last_m_s: float = 0.0
    fewest: int = 0

    @property
    def speed_m_s(self) -> float:
        """The mean speed of vehicles neither parked nor wrecked, standing ones included."""
        return self.distance_km / self.vehicle_hours / 3.6 if self.vehicle_hours else 0.0


def survey_traffic(scenario: Scenario, seed: int, seconds: float) -> TrafficSurvey:
    """Drive a scenario's traffic, without sensing.

    Args:
        scenario: a place and its population.
        seed: the episode's.
        seconds: to drive.
    """
    world = World(scenario, seed)
    diary, steps, actors = Diary(world.fleet.rows), round(seconds / DT_S), []
    driven = np.zeros((steps + 1, 2))
    for step in range(steps):
        world.step(DT_S)
        diary.note(world.fleet.rows, (step + 1) * DT_S)
        driven[step + 1] = diary.km, diary.hours
        actors.append(len(world.actors()))
    part = max(1, steps // 6)
    (first_km, first_h), (last_km, last_h) = driven[part], driven[-1] - driven[-1 - part]
    return replace(
        diary.summary(world.fleet.rows),
        first_m_s=first_km / first_h / 3.6 if first_h else 0.0,
        last_m_s=last_km / last_h / 3.6 if last_h else 0.0,
        fewest=min(actors),
    )


@dataclass
class Diary:
    """Notes of one episode, step by step, of a fleet (N,) `VEHICLE`; one that leaves is replaced in its row.

    Args:
        rows: the fleet at the start.
    """

    rows: NDArray[Any]
    time_s: float = 0.0
    hours: float = 0.0
    km: float = 0.0
    crashes: list[Crash] = field(default_factory=list)
    ended: list[Standstill] = field(default_factory=list)

    def __post_init__(self) -> None:
        self._standing_s, self._still_s, self._frozen_s = np.zeros((3, len(self.rows)))
        self._wrecked = self.rows["crashed"].copy()

    def note(self, rows: NDArray[Any], time_s: float) -> None:
        """Add the state of the fleet at a later time."""
        past_s, self.time_s = time_s - self.time_s, time_s
        self._note_crashes(rows)
        drives = (rows["driver"] != PARKED) & ~rows["crashed"]
        self.hours += past_s / 3600 * int(drives.sum())
        self.km += past_s / 1000 * float(np.abs(rows["speed"][drives]).sum())
        stands = drives & (np.abs(rows["speed"]) < STANDING_M_S) & ~held_by_wrecks(rows)
        self.ended += self._standstills(rows, ~stands & (self._standing_s > 0))
        self._standing_s = np.where(stands, self._standing_s + past_s, 0.0)
        alone = stands & ~_moves_around(rows, drives)
        self._still_s = np.where(alone, self._still_s + past_s, 0.0)
        self._frozen_s = np.where(stands, np.maximum(self._frozen_s, self._still_s), 0.0)

    def summary(self, rows: NDArray[Any]) -> TrafficSurvey:
        """Return what was noted, with the standstills of the fleet that last until now."""
        stood = [*self.ended, *self._standstills(rows, self._standing_s > 0)]
        return TrafficSurvey(
            seconds=self.time_s,
            vehicles=int((rows["driver"] != PARKED).sum()),
            vehicle_hours=self.hours,
            distance_km=self.km,
            crashes=tuple(self.crashes),
            waits_s=tuple(each.for_s for each in stood if each.for_s >= SHORTEST_WAIT_S),
            jams=tuple(each for each in stood if each.for_s > JAM_S),
        )

    def _standstills(self, rows: NDArray[Any], which: Bools) -> list[Standstill]:
        return [
            Standstill(
                int(row["id"]), *_rounded(row), round(self.time_s - for_s, 1), round(for_s, 1), round(frozen_s, 1)
            )
            for row, for_s, frozen_s in zip(rows[which], self._standing_s[which], self._frozen_s[which], strict=True)
        ]

    def _note_crashes(self, rows: NDArray[Any]) -> None:
        left = np.flatnonzero(rows["crashed"] & ~self._wrecked)
        self._wrecked = rows["crashed"].copy()
        while len(left):
            near = spread(rows[left], np.arange(len(left)) == 0, SAME_CRASH_M)
            these = rows[left[near]]
            parked = bool((these["driver"] == PARKED).all())
            self.crashes.append(Crash(round(self.time_s, 1), tuple(these["id"].tolist()), *_rounded(these[0]), parked))
            left = left[~near]


def _moves_around(rows: NDArray[Any], drives: Bools) -> Bools:
    """Return whether some vehicle moves around each (N,)."""
    moves = drives & (np.abs(rows["speed"]) >= STANDING_M_S)
    around: Bools = np.any(_distances_m(rows, rows[moves]) < AROUND_M, axis=1)
    return around


def held_by_wrecks(rows: NDArray[Any]) -> Bools:
    """Return which vehicles (N,) stand near a wreck, or in a queue behind vehicles that do."""
    wrecked = rows["crashed"] & (rows["driver"] != PARKED)
    if not wrecked.any():
        return np.zeros(len(rows), np.bool_)
    stands = (rows["driver"] != PARKED) & ~wrecked & (np.abs(rows["speed"]) < STANDING_M_S)
    held: Bools = stands & (_distances_m(rows, rows[wrecked]).min(axis=1) < HELD_BY_M)
    queue = spread(rows[stands], held[stands], QUEUE_M)
    held[stands] = queue
    return held


def spread(rows: NDArray[Any], start: Bools, step_m: float) -> Bools:
    """Return which vehicles (N,) are reached from those of `start` (N,) over vehicles less than `step_m` apart."""
    near, reached = _distances_m(rows, rows) < step_m, start.copy()
    while True:
        further: Bools = reached | (near & reached).any(axis=1)
        if (further == reached).all():
            return reached
        reached = further


def _distances_m(rows: NDArray[Any], others: NDArray[Any]) -> Floats:
    away_x, away_y = (rows[axis][:, None] - others[axis] for axis in ("x", "y"))
    distances_m: Floats = exact.hypot(away_x, away_y)
    return distances_m


def _rounded(row: np.void) -> tuple[float, float]:
    return round(float(row["x"]), 1), round(float(row["y"]), 1)


AGENTS_APART_M = 80.0
AT_JUNCTION_M = 45.0
"""Distance from a mast to the nearest movement over a junction, at most."""


def fingerprint(description: Mapping[str, Any]) -> str:
    """Return a checksum of the description of a place; the order of its keys does not matter."""
    return hashlib.sha256(json.dumps(description, sort_keys=True).encode()).hexdigest()[:16]


def find_faults(scenario: Scenario, seed: int) -> list[str]:
    """Return what is wrong with a scenario, in words; nothing if all is well.

    Args:
        scenario: a place and its population.
        seed: of the episode whose start is looked at.
    """
    at = np.array([body.world_SE3_base.translation[:2] for body in World(scenario, seed).agents().values()])
    apart_m = float(exact.norm(at[:, None] - at, axis=2).max(initial=0.0))
    faults = [f"agents start {apart_m:.1f} m apart"] if apart_m > AGENTS_APART_M else []
    wanted = scenario.population.connected + scenario.population.rsus + scenario.population.drones
    if len(at) < wanted:
        faults.append(f"{wanted} agents are wanted, {len(at)} are there")
    if len(at) < 2:
        faults.append("there are fewer than two agents")
    return faults + _faults_of_masts(scenario.layout)


def _faults_of_masts(layout: Layout) -> list[str]:
    if not layout.rsus:
        return ["there is no mast"]
    lanes = [layout.network.get_lane((*road, 0)) for road in layout.movements]
    middles = np.array([lane.position(lane.length / 2, 0.0) for lane in lanes]).reshape(-1, 2)
    faults = []
    for number, pose in enumerate(layout.rsus):
        foot = pose.translation[:2]
        far_m = float(exact.norm(middles - foot, axis=1).min(initial=np.inf))
        if far_m > AT_JUNCTION_M:
            faults.append(f"mast {number} stands {far_m:.1f} m from the nearest junction")
        if any(_inside(foot, outline) for outline in layout.road_map.buildings):
            faults.append(f"mast {number} stands in a building")
    return faults


def _inside(point: Floats, outline: Floats) -> bool:
    """Return whether a point (2,) is in a convex outline (K, 2)."""
    sides, away = np.roll(outline, -1, axis=0) - outline, point - outline
    turns = sides[:, 0] * away[:, 1] - sides[:, 1] * away[:, 0]
    return bool((turns > 0).all() or (turns < 0).all())
