"""The events of one drive: its crash, how near it came to one, when what was coming was seen, and its brakes.

Everything is found in the truth. A conflict is where the car would have met an object, as that truly moved later, had
the car gone on at its speed along its way. Nothing here looks at a planner.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from coopsim.geometry.se3 import Floats, wrap_angle
from coopsim.metrics.comfort import uncomfortable
from coopsim.metrics.drive_log import Drive
from coopsim.metrics.drive_rules import Rules, find_rules
from coopsim.metrics.encounters import clearances, is_on, least_delay, least_time
from coopsim.metrics.matching import NEAR_M
from coopsim.types import Ints
from coopsim.types.taxonomy import ObjectClass, Superclass

HARD_M_S2 = 3.0
"""Deceleration above which a brake is hard."""

NEEDLESS_M_S2 = 0.25 * 9.81
"""Deceleration above which a brake without a known reason is a phantom brake: 0.25 g, which US standard FMVSS 127
allows an emergency brake to add where nothing is in the way."""

BRAKE_LIGHT_M_S2 = 1.3
"""Deceleration above which a car brakes: its brake lights must be on (UN Regulation 13-H, 5.2.22)."""

ONE_BRAKE_S = 1.0
"""Brakes with a shorter pause are one."""

LONGEST_S = 5.0
"""Longest time to collision and post-encroachment time: longer ones say nothing of danger. It is the longest
post-encroachment time that SSAM looks at by default (FHWA-HRT-08-051)."""

FOLLOWING_RAD = math.radians(30.0)
"""Angle between headings below which one follows the other, so that no encroachment is left; SSAM's for rear ends."""

REASON_S, REASON_M = 1.0, 0.3
"""Time between two on the same ground, and distance from the car's body, below which a known object is a reason to
brake."""

EARLIEST_S = 3.0
"""Time before a conflict from which a known object is a reason to brake: the longest time to collision at which UN
Regulation 131, 6.4.4, lets emergency braking begin."""

UNBRAKED_S = 10.0
"""Time for which the car's motion without its first brake is followed."""

STANDS_M_S = 0.1
"""Slower bodies stand: CARLA's scenario runner gives a car that does no collision (`CollisionTest.EPSILON`)."""

TOUCHES_M = 1.0
"""Largest gap to the body that was hit in the first frame with a crash: crashed bodies are pushed apart."""

BEHIND_RAD = math.radians(150.0)
"""Angle from the car's heading beyond which an object is behind it; nuPlan's `is_agent_behind`."""

PERSON, RIDER, VEHICLE = "person", "rider", "vehicle"
_RIDERS = (ObjectClass.MOTORCYCLE, ObjectClass.BICYCLE, ObjectClass.SCOOTER)
_ON_WHEELS = np.array([each.superclass is not Superclass.PEDESTRIAN for each in ObjectClass]).astype(np.int64)
"""By label: 1 for vehicles of four wheels or more. A track confirms an object of its own kind."""


@dataclass(frozen=True, slots=True)
class Crash:
    """The first crash of a drive.

    Attributes:
        time_s: time of the first frame with it.
        label: class of the other, an `ObjectClass`; -1: no body was near.
        object_id: id of the other; -1: no body was near.
        speed_m_s: speed of the car relative to the other, in the frame before.
        moved: whether the car moved.
        at_fault: whether the car drove into the other: it moved, and the other stood or was touched by its front.
        by_log: whether the other follows a log, which cannot see the car, and drove into it.
    """

    time_s: float
    label: int
    object_id: int
    speed_m_s: float
    moved: bool
    at_fault: bool
    by_log: bool = False

    @property
    def party(self) -> str:
        """Kind of the other: "person", "rider" or "vehicle"; empty if not known."""
        if self.label < 0:
            return ""
        if self.label in (ObjectClass.PEDESTRIAN, ObjectClass.CHILD):
            return PERSON
        return RIDER if self.label in _RIDERS else VEHICLE


@dataclass(frozen=True, slots=True)
class Moments:
    """Times of perception and reaction, s from the episode's start; NaN for what never came.

    Attributes:
        object_id: id of the conflicting object; -1: there is none.
        seen: the car's own sensors first had returns from it.
        confirmed: a reported track was first on it.
        braked: the car first braked at that time or later: a brake before was for something else.
        conflict: the car would have been where the two meet, had it never braked.
    """

    object_id: int = -1
    seen: float = math.nan
    confirmed: float = math.nan
    braked: float = math.nan
    conflict: float = math.nan

    def lead_s(self, moment: float) -> float:
        """Return the time from a moment to the conflict: 0 if it came later or never, NaN without a conflict."""
        return self.conflict - (min(moment, self.conflict) if math.isfinite(moment) else self.conflict)


@dataclass(frozen=True, slots=True)
class DriveEvents:
    """The events of one drive, up to its crash or its end.

    Attributes:
        crash: its crash; None without.
        min_ttc_s: least time to collision, at most `LONGEST_S`; 0 with a crash.
        pet_s: least post-encroachment time, at most `LONGEST_S`; 0 with a crash.
        moments: times of perception and reaction.
        hard_s: times at which hard brakes began.
        phantom_s: times at which phantom brakes began: the car knew of no object in its way, and of no lower limit.
        way_m: distance driven.
        legal_m: distance at the legal speed in the same time.
        lost_s: time lost by driving below the legal speed.
        discomfort: share of frames that are not comfortable, see `comfort.py`.
        ttc_ahead_s: least time to collision, of a car that moves and with what is not behind it; at most `LONGEST_S`.
        rules: rules of the road that it kept and broke.
    """

    crash: Crash | None
    min_ttc_s: float
    pet_s: float
    moments: Moments
    hard_s: tuple[float, ...]
    phantom_s: tuple[float, ...]
    way_m: float
    legal_m: float
    lost_s: float
    discomfort: float
    ttc_ahead_s: float
    rules: Rules


def find_events(drive: Drive) -> DriveEvents:
    """Find the events of a drive."""
    course = _Course(drive)
    crash = course.crash()
    needless = [k for k in course.brakes(NEEDLESS_M_S2) if not course.has_reason(max(k - 1, 0))]
    return DriveEvents(
        crash,
        0.0 if crash else course.min_ttc_s(),
        0.0 if crash else course.pet_s(),
        course.moments(crash),
        tuple(drive.time_s[course.brakes(HARD_M_S2)].tolist()),
        tuple(drive.time_s[needless].tolist()),
        *course.progress(),
        course.discomfort(),
        course.min_ttc_s(ahead=True),
        find_rules(drive, course.end),
    )


def has_track(drive: Drive, frame: int, column: int) -> bool:
    """Return whether a track that was reported for a frame is on the object of a column, and on no other one."""
    tracks, kinds = drive.tracks[frame], _ON_WHEELS[drive.label]
    return is_on(tracks.boxes, _ON_WHEELS[tracks.label], drive.boxes[frame], kinds, column, NEAR_M)


class _Course:
    """A drive up to its crash, and the objects as they moved, straight on after its last frame."""

    def __init__(self, drive: Drive) -> None:
        self.drive = drive
        self.dt_s = float(np.median(np.diff(drive.time_s))) if len(drive) > 1 else 0.1
        crashed = np.flatnonzero(drive.crashed)
        self.crashed = int(crashed[0]) if len(crashed) else None
        self.end = len(drive) if self.crashed is None else self.crashed
        later_s = np.arange(1, self._steps(UNBRAKED_S + LONGEST_S) + 1)[:, None, None] * self.dt_s
        later = np.repeat(drive.boxes[-1:], len(later_s), axis=0)
        later[:, :, :2] += later_s * drive.velocity[-1]
        self.boxes = np.concatenate([drive.boxes, later])
        self._confirmed: dict[int, int] = {}

    def _steps(self, seconds: float) -> int:
        return math.ceil(seconds / self.dt_s - 1e-9)

    def _bodies(self, columns: list[int], first: int = 0) -> Floats:
        """Return bodies of some objects from a frame on, in the one layout for which kernels are compiled."""
        return np.ascontiguousarray(self.boxes[first:, columns])

    def ahead(self, frame: int, steps: int) -> Floats:
        """Return the bodies (H + 1, 5) of the car after 0 to H steps along its way at its present speed."""
        way, car = self.drive.ways[frame], self.drive.car[frame]
        along = np.maximum(self.drive.speed_m_s[frame], 0.0) * self.dt_s * np.arange(steps + 1)
        # The way begins at its point nearest to the car's middle, and goes straight on from its last.
        tangent = np.diff(way.points, axis=0, append=2 * way.points[-1:] - way.points[-2:-1]) / way.spacing_m
        place = np.minimum((along / way.spacing_m).astype(np.int64), len(way.points) - 1)
        bodies = np.empty((steps + 1, 5))
        bodies[:, :2] = way.points[place] + tangent[place] * (along - place * way.spacing_m)[:, None]
        bodies[:, 2:4], bodies[:, 4] = car[2:4], np.arctan2(tangent[place, 1], tangent[place, 0])
        return bodies

    def crash(self) -> Crash | None:
        """Return the first crash."""
        if self.crashed is None:
            return None
        drive, frame, before = self.drive, self.crashed, max(self.crashed - 1, 0)
        own, moved = drive.velocity_m_s[before], abs(drive.speed_m_s[before]) >= STANDS_M_S
        gaps = clearances(drive.car[frame], drive.boxes[frame])
        other = int(np.argmin(gaps)) if len(gaps) else -1
        if other < 0 or gaps[other] > TOUCHES_M:
            return Crash(float(drive.time_s[frame]), -1, -1, float(np.hypot(*own)), bool(moved), bool(moved))
        velocity = drive.velocity[before if np.isfinite(drive.velocity[before, other, 0]) else frame, other]
        in_front = touches_front(drive.car[frame], drive.boxes[frame, other])
        at_fault = moved and (np.hypot(*velocity) < STANDS_M_S or in_front)
        speed = float(np.hypot(*(own - velocity)))
        label, identity = int(drive.label[other]), int(drive.ids[other])
        by_log = drive.hit_by_log and not at_fault
        return Crash(float(drive.time_s[frame]), label, identity, speed, bool(moved), bool(at_fault), by_log)

    def min_ttc_s(self, *, ahead: bool = False) -> float:
        """Return the least time to collision; `ahead`: while the car moves, and with what is not behind it."""
        if not self.end or not len(self.drive.ids):
            return LONGEST_S
        drive, end = self.drive, self.end
        paths = np.stack([self.ahead(frame, self._steps(LONGEST_S)) for frame in range(end)])
        speed = np.hypot(drive.velocity[:end, :, 0], drive.velocity[:end, :, 1])
        if ahead:
            apart = drive.boxes[:end, :, :2] - drive.car[:end, None, :2]
            turned = wrap_angle(np.arctan2(apart[..., 1], apart[..., 0]) - drive.car[:end, None, 4])
            stands = drive.speed_m_s[:end, None] < STANDS_M_S
            speed = np.where(stands | (np.abs(turned) > BEHIND_RAD), np.nan, speed)
        return float(least_time(paths, self.boxes, speed, self.dt_s, LONGEST_S))

    def pet_s(self) -> float:
        """Return the least post-encroachment time, within a step: it begins and ends between frames."""
        longest = self._steps(LONGEST_S) + 1
        steps, _ = least_delay(self.drive.car[: self.end], self.drive.boxes, longest, FOLLOWING_RAD)
        return LONGEST_S if steps < 0 else max(steps - 1, 0) * self.dt_s

    def brakes(self, deceleration_m_s2: float) -> Ints:
        """Return the first frames of brakes above a deceleration."""
        on = np.flatnonzero(self.drive.acceleration_m_s2[: self.end] < -deceleration_m_s2)
        times = self.drive.time_s[on]
        return on[np.diff(times, prepend=-np.inf) > max(ONE_BRAKE_S, 1.5 * self.dt_s)]

    def has_reason(self, frame: int) -> bool:
        """Return whether the car has to brake in a frame: for a known object in its way, or for a lower limit ahead."""
        speed, limits = self.drive.speed_m_s[frame], self.drive.ways[frame].speed_limit_m_s
        distance = np.maximum(np.arange(len(limits)), 1.0) * self.drive.ways[frame].spacing_m
        if ((speed**2 - limits**2) / (2 * distance))[1:].max() >= BRAKE_LIGHT_M_S2:
            return True
        car = self.ahead(frame, self._steps(max(EARLIEST_S, speed / NEEDLESS_M_S2)))
        car[:, 2:4] += 2 * REASON_M
        others = [k for k in range(len(self.drive.ids)) if self._knows(frame, k) and not self._follows(frame, k)]
        return least_delay(car, self._bodies(others, frame), self._steps(REASON_S), 0.0)[0] >= 0

    def _knows(self, frame: int, column: int) -> bool:
        """Return whether the car has seen an object, or reported a track on it, in a frame or before."""
        return bool((self.drive.seen_by[: frame + 1, column] == 0).any()) or self.confirmed_from(column) <= frame

    def confirmed_from(self, column: int) -> int:
        """Return the first frame with a track on an object; the number of frames if there is none."""
        if column not in self._confirmed:
            frames = range(len(self.drive))
            self._confirmed[column] = next((k for k in frames if has_track(self.drive, k, column)), len(self.drive))
        return self._confirmed[column]

    def _follows(self, frame: int, column: int) -> bool:
        """Return whether an object comes over the ground on which the car now is, and in the car's direction only."""
        now, later = self.drive.car[frame : frame + 1], self._bodies([column], frame)
        comes, across = (least_delay(now, later, self._steps(LONGEST_S), angle)[0] for angle in (0.0, FOLLOWING_RAD))
        return comes >= 0 > across

    def moments(self, crash: Crash | None) -> Moments:
        """Return the times of the conflict that the script names, else of the crash."""
        drive = self.drive
        brakes = np.flatnonzero(drive.acceleration_m_s2[: self.end] < -BRAKE_LIGHT_M_S2)
        named = drive.in_conflict if drive.in_conflict.any() or crash is None else drive.ids == crash.object_id
        conflict = self._meeting(np.flatnonzero(named), brakes)
        if conflict is None and crash is not None and crash.object_id in drive.ids[named]:
            conflict = crash.time_s, int(np.searchsorted(drive.ids, crash.object_id))
        if conflict is None:
            return Moments()
        conflict_s, column = conflict
        first = self.confirmed_from(column)
        seen = np.flatnonzero(drive.seen_by[:, column] == 0)
        confirmed, braked = np.arange(first, len(drive)), brakes[brakes >= first]
        return Moments(
            int(drive.ids[column]), self._first(seen), self._first(confirmed), self._first(braked), conflict_s
        )

    def _meeting(self, columns: Ints, brakes: Ints) -> tuple[float, int] | None:
        """Return the time at which the car would have met one of some objects, had it never braked, and its column."""
        car = self.drive.car[: self.end + 1]
        if len(brakes):
            last = max(int(brakes[0]) - 1, 0)
            car = np.concatenate([car[:last], self.ahead(last, self._steps(UNBRAKED_S))])
        longest = self._steps(LONGEST_S)
        found = [(*least_delay(car, self._bodies([k]), longest, 0.0), k) for k in columns.tolist()]
        met = [each for each in found if each[0] >= 0]
        if not met:
            return None
        _, frame, column = min(met)
        return float(self.drive.time_s[0] + frame * self.dt_s), column

    def _first(self, frames: Ints) -> float:
        return float(self.drive.time_s[frames[0]]) if len(frames) else math.nan

    def progress(self) -> tuple[float, float, float]:
        """Return the distance driven, that at the legal speed (m), and the time lost (s)."""
        drive, step_s = self.drive, np.diff(self.drive.time_s[: self.end + 1])
        count = len(step_s)
        legal = np.array([way.speed_limit_m_s[0] for way in drive.ways])[:count]
        moved = np.hypot(*np.diff(drive.car[: self.end + 1, :2], axis=0).T)
        lost = np.clip(1 - drive.speed_m_s[:count] / np.maximum(legal, STANDS_M_S), 0.0, 1.0)
        return float(moved.sum()), float(legal @ step_s), float(lost @ step_s)

    def discomfort(self) -> float:
        """Return the share of uncomfortable frames; NaN without frames."""
        if not self.end:
            return math.nan
        part, drive = slice(self.end), self.drive
        beyond = uncomfortable(drive.acceleration_m_s2[part], drive.speed_m_s[part], drive.car[part, 4], self.dt_s)
        return float(beyond.mean())


def touches_front(car: Floats, other: Floats) -> bool:
    """Return whether the front of a car's body is at least as near to another body as its other sides are."""
    x, y, length, width, yaw = car
    ahead, left = np.array([np.cos(yaw), np.sin(yaw)]), np.array([-np.sin(yaw), np.cos(yaw)])
    sides = [(length / 2 * ahead, 0.0, width), (-length / 2 * ahead, 0.0, width)]
    sides += [(sign * width / 2 * left, length, 0.0) for sign in (1, -1)]
    edges = np.array([[x + at[0], y + at[1], long, wide, yaw] for at, long, wide in sides])
    front, *rest = clearances(other, edges).tolist()
    return bool(front <= max(min(rest), 0.0))
