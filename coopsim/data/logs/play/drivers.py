"""Road users that have left their log: they go along their logged ways at speeds of their own.

Commanded cars obey accelerations. Others drive by the intelligent driver model of `coopsim.world.traffic.drivers`: it
sees whoever is on their way, and they let others go first where ways cross (`crossings.py`). All others follow the log.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from coopsim.data.logs.play.crossings import Crossings, crossings_of
from coopsim.data.logs.play.lanes import halts_of, lanes_along, limits_m_s
from coopsim.data.logs.play.paths import paths_of
from coopsim.data.logs.track_log import Moment, TrackLog, most_at_once
from coopsim.geometry import exact
from coopsim.geometry.se3 import Floats
from coopsim.metrics.drive_events import STANDS_M_S, touches_front
from coopsim.metrics.encounters import clearances
from coopsim.support.kernels import njit
from coopsim.types import Ints, Mask
from coopsim.types.driving import CarState, approached
from coopsim.types.taxonomy import ObjectClass
from coopsim.world.traffic.drivers import ACC_MAX, COMFORT_ACC_MIN, DISTANCE_WANTED, drive, nearest_on_route, stop_at
from coopsim.world.traffic.fleet import BODY, PARKED, PEDALLED, TOWN, VEHICLE, bodies_of
from coopsim.world.traffic.lanes import LaneArrays
from coopsim.world.traffic.motion import SPEED_MAX_M_S, collide
from coopsim.world.traffic.movements import movements_of
from coopsim.world.traffic.neighbours import Scene, list_along_lanes
from coopsim.world.traffic.rules import VEHICLE_LENGTH_M, extra_gap
from coopsim.world.traffic.way_ahead import way_ahead
from coopsim.world.world import LONGEST_STEP_S

DRIVERS = (ObjectClass.CAR, ObjectClass.TRUCK, ObjectClass.VAN, ObjectClass.BUS, ObjectClass.MOTORCYCLE)
"""Classes that react as drivers; all others follow the log."""

_STAYS_M = 2.0  # vehicles that go less far in their log stand
_CLOSER_M = (
    3.0  # by which real queues stand closer than highway-env's: 2 m bumper to bumper (Treiber and Kesting, 2013)
)
_HELD_M = 3.0  # beyond the place where it stood in its log a driver that came too far still stands
_HEADWAY_S = 1.0  # in town, by the same authors
_FREE_M = 0.5  # who comes into the place waits until nobody is so near, and it has not to brake hard
_BODY = ("x", "y", "length", "width", "heading")


class Drivers:
    """The road users of an episode that have left their log.

    Args:
        log: the part that is played.
        start_s: time in the log at which the episode begins.
        size: (T, 3) m, of the log's tracks.
        commanded: (C,) tracks of cars that obey accelerations.
        left_s: (C,) time in the log at which each leaves the place, or is lost: there its way ends.
        followers: tracks that follow the log although others react.
        idm: whether all other vehicles react as drivers.

    Attributes:
        now: everybody at the present time.
        track: (R,) tracks that have ways here, rising.
        commanded: numbers of the tracks that obey.
        hit_by_log: (R,) see `CarState`.
    """

    def __init__(
        self,
        log: TrackLog,
        start_s: float,
        size: Floats,
        commanded: Ints,
        left_s: Floats,
        followers: Ints,
        *,
        idm: bool,
    ) -> None:
        self._log, self._start_s, self._size, self._time_s = log, start_s, size, 0.0
        drives = np.isin(log.label, DRIVERS) if idm else np.zeros(len(log.ids), np.bool_)
        drives[commanded] = True
        track = np.flatnonzero(drives)
        until_s = np.full(len(log.ids), np.inf)
        until_s[commanded] = left_s
        stays = paths_of(log, track, start_s, until_s[track]).length < _STAYS_M
        self.track = track = track[~stays | np.isin(track, commanded)]
        self._paths = paths = paths_of(log, track, start_s, until_s[track])
        self.commanded = frozenset(commanded.tolist())
        self._obeys = np.isin(track, commanded)
        self._reacts = ~self._obeys & ~np.isin(track, followers)
        self._rails = self._obeys | self._reacts
        self._begin_s = paths.time_s[paths.first[:-1]]
        self._along = np.maximum(paths.along_at(np.arange(len(track)), 0.0), 0.0)
        self._there, self._gone = self._begin_s <= 0.0, paths.last_s < 0.0
        self._most = most_at_once(self._begin_s[self._rails], paths.last_s[self._rails])
        self.hit_by_log = np.zeros(len(track), np.bool_)
        self._rows = self._new_rows(limits_m_s(log, np.flatnonzero(np.isin(log.label, DRIVERS)), paths))
        self._network = lanes_along(paths, self._rows["target_speed"])
        self._movements = movements_of(self._network, (), (), 0.0)
        self._crossings: Crossings | None = crossings_of(paths, size[track, 1]) if idm else None
        self._halts = halts_of(paths, np.flatnonzero(self._reacts))
        way, at, until_s = self._halts
        self._stays_s = np.full(len(track), -np.inf)  # who stood at the end of its way stays there as long
        np.maximum.at(self._stays_s, way, np.where(at >= paths.length[way], until_s, -np.inf))
        self._look()

    def _new_rows(self, limit_m_s: Floats) -> NDArray[Any]:
        """Return the rows (R,) `VEHICLE` as they begin: at the log's speeds."""
        log, track = self._log, self.track
        rows = _vehicles(self._size[track])
        speed = exact.norm(log.velocity)
        begins = log.at(self._start_s)
        at = log.first[track]
        rows["speed"] = speed[at]
        known = np.isin(track, begins.track)
        rows["speed"][known] = exact.norm(begins.velocity[np.searchsorted(begins.track, track[known])])
        rows["target_speed"] = np.where(self._paths.length < _STAYS_M, 0.0, limit_m_s)
        rows["driver"] = np.where(self._obeys, PEDALLED, np.where(self._reacts, TOWN, PARKED))
        rows["lane"] = rows["target_lane"] = np.arange(len(track))
        rows["route_length"] = 1
        return rows

    def step(self, dt_s: float, commands: Mapping[int, float]) -> None:
        """Go on by `dt_s`; commands are accelerations in m/s² by track."""
        parts = max(1, math.ceil(dt_s / LONGEST_STEP_S - 1e-9))
        end_s = round(self._time_s + dt_s, 9)
        for part in range(parts):
            for track, wanted in commands.items():
                row = self._rows[int(np.searchsorted(self.track, track))]
                row["acceleration"] = approached(float(row["acceleration"]), wanted, dt_s / parts)
            self._decide()
            self._move(dt_s / parts)
            self._time_s = end_s if part == parts - 1 else self._time_s + dt_s / parts
            self._come_and_go()
            self._look()
            self._crash(dt_s / parts)

    def car(self, track: int, traffic_side: str) -> CarState:
        """Return the motion of a commanded car and its way ahead, as its driver knows them."""
        k = int(np.searchsorted(self.track, track))
        row, route = self._rows[k], np.array([[k, 0]])
        speed, acceleration, length, width = (float(row[key]) for key in ("speed", "acceleration", "length", "width"))
        way = way_ahead(self._network.arrays, self._movements, self._rows, k, route)
        hit = bool(self.hit_by_log[k])
        return CarState(speed, acceleration, length, width, bool(row["crashed"]), way, traffic_side, hit)

    @property
    def crashed(self) -> Ints:
        """Tracks that have touched somebody; they stay where they are."""
        tracks: Ints = self.track[self._rows["crashed"]]
        return tracks

    @property
    def arrived(self) -> bool:
        """True if a commanded car is at the end of its way."""
        return bool((self._along >= self._paths.length - 1e-3)[self._obeys & (self._paths.length >= _STAYS_M)].any())

    def _decide(self) -> None:
        """Let all who react choose an acceleration."""
        here = np.flatnonzero(self._on_rails & self._reacts)
        if len(here):
            self._rows["acceleration"][here] = self._wanted()[here]

    def _wanted(self) -> Floats:
        """Return the accelerations (R,) m/s² that drivers want now; 0 for all others."""
        here = np.flatnonzero(self._on_rails)
        rows = np.concatenate([self._rows[here], self._others])
        routes = np.zeros((len(rows), 1, 2), np.int64)
        routes[: len(here), 0, 0] = here
        room = np.full(len(rows), np.inf)
        room[: len(here)] = self._room_m()[here]
        wanted = np.zeros(len(self.track))
        found = _accelerations(self._network.arrays, rows, routes, bodies_of(rows, self._people), room)
        wanted[here] = found[: len(here)]
        return wanted

    def _room_m(self) -> Floats:
        """Return how far (R,) m each may go before it must stand: for others at a crossing, or as in its log."""
        assert self._crossings is not None
        every = np.arange(len(self.track))
        logged, soon = (self._paths.along_at(every, self._time_s + late) for late in (0.0, self._log.step_s))
        along = np.where(self._rails, self._along, logged)
        speed = np.where(self._rails, self._rows["speed"], (soon - logged) / self._log.step_s)
        there = self._there & ~self._gone
        room = self._crossings.room_m(along, speed, self._rows["length"], there, self._reacts)
        way, at, until_s = self._halts
        holds = (until_s > self._time_s) & (along[way] < at + _HELD_M)
        np.minimum.at(room, way[holds], (at - along[way])[holds])
        return room

    def _move(self, dt_s: float) -> None:
        """Go on along the ways; wrecks brake to a stop."""
        rows, here = self._rows, self._on_rails
        speed = rows["speed"]
        asked = np.where(rows["crashed"], -speed, rows["acceleration"])
        rows["acceleration"] = np.where(here, np.maximum(asked, -np.maximum(speed, 0.0) / dt_s), 0.0)
        along = self._along + np.where(here, speed * dt_s, 0.0)
        self._along = np.where(self._obeys, np.minimum(along, self._paths.length), along)
        rows["speed"] = np.clip(speed + rows["acceleration"] * dt_s, 0.0, SPEED_MAX_M_S)

    @property
    def _on_rails(self) -> Mask:
        """Flags (R,) of those who are there and have left their log."""
        there: Mask = self._there & ~self._gone & self._rails
        return there

    def _come_and_go(self) -> None:
        """Let those come whose time in the log it is, where there is room, and those go who are at their ways' ends."""
        late = self._paths.last_s < self._time_s
        ended = (self._along >= self._paths.length) & (self._time_s >= self._stays_s)
        self._gone |= ~self._obeys & np.where(self._reacts & self._there, ended, late)
        waits = np.flatnonzero(~self._there & ~self._gone & (self._begin_s <= self._time_s))
        self._there[waits[~self._reacts[waits]]] = True
        waits = waits[self._reacts[waits]]
        for k in waits[np.argsort(self._begin_s[waits], kind="stable")].tolist():
            self._look()
            if int(self._on_rails.sum()) < self._most and self._gaps(k)[0] > _FREE_M:
                self._there[k] = True
                self._there[k] = self._wanted()[k] > COMFORT_ACC_MIN

    def _look(self) -> None:
        """Find where everybody is now."""
        place, heading, ahead = self._paths.at(np.arange(len(self.track)), self._along)
        self._rows["x"], self._rows["y"], self._rows["heading"] = *place.T, heading
        moment = self._log.at(self._start_s + self._time_s)
        rest = moment[~np.isin(moment.track, self.track[self._rails])]
        here = self._on_rails
        flat = np.column_stack([place[here], np.zeros(int(here.sum()))])
        velocity = ahead[here] * self._rows["speed"][here][:, None]
        self.now = rest.joined(Moment(self.track[here], flat, heading[here], velocity))
        self._see(rest)

    def _see(self, rest: Moment) -> None:
        """Keep those who follow the log as drivers see them: vehicles and people."""
        size, speed = self._size[rest.track], exact.norm(rest.velocity)
        drives = np.isin(self._log.label[rest.track], DRIVERS)
        self._others = _vehicles(size[drives])
        self._others["driver"] = np.where(speed[drives] >= STANDS_M_S, PEDALLED, PARKED)
        self._people = np.zeros(int((~drives).sum()), BODY)
        course = exact.arctan2(rest.velocity[:, 1], rest.velocity[:, 0])
        for rows, of, turned in ((self._others, drives, rest.heading), (self._people, ~drives, course)):
            rows["x"], rows["y"], rows["speed"] = *rest.place[of, :2].T, speed[of]
            rows["heading"] = turned[of]
        people = self._people
        people["length"], people["width"] = size[~drives, 0], size[~drives, 1]
        people["dir_x"], people["dir_y"] = exact.cos(people["heading"]), exact.sin(people["heading"])

    def _gaps(self, k: int) -> tuple[float, int]:
        """Return the gap (m) of a way's road user to the nearest other body, and its number: rails, others, people."""
        here = np.flatnonzero(self._on_rails & (np.arange(len(self.track)) != k))
        parts = (self._rows[here], self._others, self._people)
        bodies = np.concatenate([np.column_stack([part[name] for name in _BODY]) for part in parts])
        gaps = clearances(_body(self._rows[k]), bodies)
        nearest = int(np.argmin(gaps)) if len(gaps) else -1
        return (float(gaps[nearest]), nearest - len(here)) if len(gaps) else (math.inf, -1)

    def _crash(self, dt_s: float) -> None:
        """Let those crash who touch somebody, and find out who hit commanded cars."""
        here = np.flatnonzero(self._on_rails)
        rows = np.concatenate([self._rows[here], self._others])
        before = rows["crashed"][: len(here)].copy()
        collide(rows, bodies_of(rows, self._people), dt_s)
        crashed = rows["crashed"][: len(here)]
        self._rows["crashed"][here] = crashed
        for k in here[crashed & ~before & self._obeys[here]].tolist():
            self.hit_by_log[k] = self._is_hit_by_log(k)

    def _is_hit_by_log(self, k: int) -> bool:
        """Return whether what touches a car follows the log, and drove into it: the car stood, or not by its front."""
        _, other = self._gaps(k)
        if other < 0:
            return False
        drives = other < len(self._others)
        row = self._others[other] if drives else self._people[other - len(self._others)]
        moves = abs(self._rows["speed"][k]) >= STANDS_M_S
        return not (moves and (row["speed"] < STANDS_M_S or touches_front(_body(self._rows[k]), _body(row))))


def _vehicles(size: Floats) -> NDArray[Any]:
    """Return rows (M,) `VEHICLE` of vehicles of sizes (M, 3) m, which stand."""
    rows = np.zeros(len(size), VEHICLE)
    rows["length"], rows["width"] = size[:, 0], size[:, 1]
    rows["axle_m"], rows["time_wanted"] = size[:, 0] / 2, _HEADWAY_S
    rows["movement"] = rows["ticket"] = -1
    return rows


def _body(row: Any) -> Floats:
    return np.array([row[name] for name in _BODY], np.float64)


@njit(cache=True, nogil=True)
def _accelerations(
    network: LaneArrays, rows: NDArray[Any], routes: Ints, bodies: NDArray[Any], room_m: Floats
) -> Floats:
    """Return the accelerations (N,) m/s² of those who react, and how far (N,) m they may go."""
    scene = Scene(network, rows, routes, bodies, list_along_lanes(network, bodies))
    found = np.zeros(len(rows))
    for me in range(len(rows)):
        if rows[me].driver != TOWN or rows[me].crashed:
            continue
        leader, leader_m = nearest_on_route(scene, me)
        wanted = drive(scene, me, leader, leader_m + _CLOSER_M)
        if room_m[me] < np.inf:
            line_m = room_m[me] + DISTANCE_WANTED + extra_gap(rows[me].length, VEHICLE_LENGTH_M)
            wanted = min(wanted, stop_at(scene, me, line_m))
        found[me] = min(max(wanted, -ACC_MAX), ACC_MAX)
    return found
