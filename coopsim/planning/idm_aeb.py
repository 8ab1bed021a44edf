"""The planner of all reported results: the Intelligent Driver Model, yielding, and automatic emergency braking.

It is plain on purpose, so that differences between runs are differences of perception. It sees nothing but tracks:

1. Tracks are predicted for `horizon_s` with constant speed and turn rate.
2. Behind the nearest track on the route the car drives by the Intelligent Driver Model (Treiber, Hennecke and Helbing,
   "Congested traffic states in empirical observations and microscopic simulations", Phys. Rev. E 62, 2000, eq. 2-3).
   Braking beyond need is cut by the constant-acceleration heuristic (Kesting, Treiber and Helbing, "Enhanced
   intelligent driver model to access the impact of driving strategies on traffic capacity", Phil. Trans. R. Soc. A 368,
   2010), as the model alone brakes hard wherever a gap is small, also behind a leader that is as fast.
3. A track that is predicted to come onto the route when the car would be there is a leader, too, as fast as it moves
   along the route: the car yields, unless the right of way or a clear lead is its own and the other can stop with ease.
4. Where a road user has told its way (`uplink="intents"`), that takes the place of the prediction. Who has warned of a
   hard brake needs no second alarm.
5. Where the car's body would touch a predicted one within `braking_ttc_s`, it brakes as hard as it can, after
   `braking_delay_s`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from coopsim.geometry.se3 import Floats, wrap_angle
from coopsim.interfaces.planner import PLANNERS, PlannedCar, Planner
from coopsim.planning.told_ways import Known, ToldWays, with_intents
from coopsim.support.checks import require_positive
from coopsim.types import NS_PER_S, Ints, Mask, Tracks
from coopsim.types.driving import HAS_PRIORITY, LARGEST_BRAKING_M_S2, NOBODY_FIRST, OUTER_SIDES
from coopsim.types.taxonomy import ObjectClass

ON_FOOT = (ObjectClass.PEDESTRIAN, ObjectClass.CHILD)
"""They always have the right of way: a car does not count on it that they stop."""

_WITH_EASE_M_S2 = 2.0
"""Deceleration with which another driver is expected to stop; ours, between the comfort of 1.5 m/s² and the 3 m/s² by
which traffic signals are timed."""

_DELTA = 4
"""The exponent of the Intelligent Driver Model."""

_COOLNESS = 0.99
"""Weight of the constant-acceleration heuristic; Kesting, Treiber and Helbing (2010), table 1."""

_SETTLING_S = 0.5
"""Time in which the car comes down to a limit that it has missed; ours."""

STANDS_M_S = 0.5
"""Slower tracks stand: the direction of their velocity is noise."""

_BELIEF_S = 0.5
"""Time for which a track must be known until the part of its velocity that leads onto the route counts in full: the
velocity of a constant-velocity filter over n places with an error of s every dt errs by s sqrt(12 / n^3) / dt, so by
0.9 m/s after five at 0.3 m and 0.1 s (Bar-Shalom, Li and Kirubarajan, "Estimation with Applications to Tracking and
Navigation", 2001)."""

_TURNING_S, _LATERAL_M_S2, _RADIUS_M = 0.3, 4.0, 5.5
"""Time over which turn rates are smoothed, and what they keep to: the lateral acceleration that few drivers exceed, and
the radius of a passenger car's smallest turn."""

_AEB_FROM_M_S = 10 / 3.6
"""Speed from which emergency braking begins: UN Regulation 152, 5.2.1.3, requires it from 10 km/h on."""

_STEP_S = 0.1
"""Time between predicted places: a crossing car moves by less than half its length."""


@PLANNERS.register("idm_aeb")
@dataclass(kw_only=True, eq=False)
class IdmAeb(Planner):
    """Drive by the Intelligent Driver Model behind tracks, yield where paths cross, brake in an emergency.

    Attributes:
        headway_s: time gap to the leader. Treiber and Kesting, Traffic Flow Dynamics (2013), table 11.2: 1 s in town.
        gap_m: distance to a standing leader; the same table: 2 m.
        acceleration_m_s2: on a free road; the same table: 1 m/s² in town.
        braking_m_s2: comfortable braking; the same table: 1.5 m/s².
        horizon_s: time for which tracks are predicted.
        margin_m: free distance to each side of the body, beyond which a track is not in the way.
        margin_s: free time before and after a crossing object.
        braking_ttc_s: time to collision from which the car brakes as hard as it can. Systems of passenger cars begin
            between 0.8 and 1.6 s; UN Regulation 131, 6.4.4, allows no more than 3 s.
        braking_delay_s: time between that decision and the brake, beside the build-up that every car has.
    """

    headway_s: float = 1.0
    gap_m: float = 2.0
    acceleration_m_s2: float = 1.0
    braking_m_s2: float = 1.5
    horizon_s: float = 3.0
    margin_m: float = 0.3
    margin_s: float = 0.5
    braking_ttc_s: float = 1.4
    braking_delay_s: float = 0.2

    _known: dict[int, _Known] = field(default_factory=dict, init=False, repr=False)
    _alarm_ns: int | None = field(default=None, init=False, repr=False)

    def __post_init__(self) -> None:
        names = ("headway_s", "gap_m", "acceleration_m_s2", "braking_m_s2", "horizon_s", "margin_m", "margin_s")
        require_positive(**{name: getattr(self, name) for name in (*names, "braking_ttc_s", "braking_delay_s")})

    def plan(self, car: PlannedCar) -> float:
        car, known = self._perceive(car)
        way = self._way(car, known)
        return -LARGEST_BRAKING_M_S2 if self._must_brake(car, way) else self._along(car, way)

    def _perceive(self, car: PlannedCar) -> tuple[PlannedCar, Known]:
        """Return a car whose tracks have those that told their ways, and what is known of them."""
        times, told = np.linspace(0.0, self.horizon_s, round(self.horizon_s / _STEP_S) + 1), None
        if len(car.intents):
            car, told = with_intents(car, times)
        turn_rates, belief = self._learn(car)
        return car, Known(times, turn_rates, belief if told is None else np.where(told.known, 1.0, belief), told)

    def _way(self, car: PlannedCar, known: Known) -> Occupied:
        """Return what tracks will occupy of the route, from what `_perceive` returned."""
        near, told = _near(car, self.horizon_s, self.margin_m), known.told
        if told is not None:
            near = near | told.known
        only = None if told is None else told.only(near)
        turn_rates, belief = known.turn_rates[near], known.belief[near]
        return _occupied(car, car.tracks[near], turn_rates, belief, known.times, self.margin_m, only)

    def _along(self, car: PlannedCar, way: Occupied) -> float:
        """Return the acceleration along the route without an emergency, m/s²."""
        free = self._free_road(car)
        behind = self._behind(car, free, *self._leaders(car, way)).min(initial=free)
        return float(self._yielding(car, free, *self._crossing(car, free, way)).min(initial=behind))

    def _free_road(self, car: PlannedCar) -> float:
        """Return the acceleration with nothing ahead, m/s²: IDM's, or what a lower limit ahead asks for.

        A limit is reached by comfortable braking. Above that the car brakes as its distance needs; above the present
        limit by the Improved IDM (Treiber and Kesting, 2013, eq. 11.21), with no more than comfort.
        """
        speed, limits = car.speed_m_s, np.maximum(car.route.speed_limit_m_s, 0.1)
        most, least = self.acceleration_m_s2, self.braking_m_s2
        if car.route.speed_limit_m_s[0] <= 0:  # at a red light
            return -least
        ahead_m = np.arange(len(limits)) * car.route.spacing_m
        allowed = float(np.sqrt(limits**2 + 2 * least * ahead_m).min())
        if speed <= allowed:
            return most * (1 - math.pow(speed / allowed, _DELTA))
        present = min(speed, float(limits[0]))
        over = least * (1 - math.pow(present / speed, most * _DELTA / least))
        needed = float(((speed**2 - limits**2) / (2 * np.maximum(ahead_m, speed * _SETTLING_S)))[1:].max())
        return -max(over, needed)

    def _behind(self, car: PlannedCar, free: float, gap_m: Floats, speed_m_s: Floats) -> Floats:
        """Return accelerations (M,) m/s² behind leaders with bumper-to-bumper gaps (M,) m and speeds (M,) m/s.

        Leaders are taken to keep their speed, so that the heuristic's acceleration is what just avoids a collision.
        """
        most, least = self.acceleration_m_s2, self.braking_m_s2
        closing, gap_m = car.speed_m_s - speed_m_s, np.maximum(gap_m, 0.1)
        dynamic = car.speed_m_s * closing / (2 * math.sqrt(most * least))
        desired = self.gap_m + np.maximum(car.speed_m_s * self.headway_s + dynamic, 0.0)
        idm: Floats = free - most * (desired / gap_m) ** 2
        heuristic = -(np.maximum(closing, 0.0) ** 2) / (2 * gap_m)
        calm = (1 - _COOLNESS) * idm + _COOLNESS * (heuristic + least * np.tanh((idm - heuristic) / least))
        return np.where(idm >= heuristic, idm, calm)

    def _yielding(self, car: PlannedCar, free: float, gap_m: Floats, speed_m_s: Floats) -> Floats:
        """Return accelerations (M,) m/s² to yield to tracks that will be gaps (M,) m ahead with speeds (M,) m/s.

        The car stops `gap_m` before, if comfortable braking is enough for that, else as near as it must. It brakes as
        soon as comfortable braking is needed, and gets ready for it from half of that on: most conflicts of predicted
        paths dissolve before.
        """
        least = self.braking_m_s2
        twice = np.maximum(car.speed_m_s - speed_m_s, 0.0) ** 2 / 2
        with_gap = np.where(twice > 0, twice / np.maximum(gap_m - self.gap_m, 1e-9), 0.0)
        needed = np.minimum(with_gap, np.maximum(twice / np.maximum(gap_m, 0.1), least))
        share = np.clip(2 * needed / least - 1, 0.0, 1.0)
        accelerations: Floats = free - share * (free + needed)
        return accelerations

    def follows(self, car: PlannedCar, gap_m: Floats, speed_m_s: Floats) -> float:
        """Return the acceleration, m/s², behind leaders with gaps (M,) m and speeds (M,) m/s, or on a free road."""
        free = self._free_road(car)
        return float(self._behind(car, free, gap_m, speed_m_s).min(initial=free))

    def behind_leaders(self, car: PlannedCar, way: Occupied) -> float:
        """Return the acceleration, m/s², behind what stands or drives along the route."""
        return self.follows(car, *self._leaders(car, way))

    def _leaders(self, car: PlannedCar, way: Occupied) -> tuple[Floats, Floats]:
        """Return gaps (M,) m and speeds (M,) m/s of tracks on the route that stand or drive along it."""
        ahead = way.inside[0] & way.goes_along & (way.rear[0] > 0)
        return way.rear[0][ahead] - car.length_m / 2, np.maximum(way.speed_along[ahead], 0.0)

    def _crossing(self, car: PlannedCar, free: float, way: Occupied) -> tuple[Floats, Floats]:
        """Return gaps (M,) m and speeds (M,) m/s of tracks that come onto the route, or go across or against it.

        The car yields to those that it would meet if it went on as if they were not there. A gap is that to a leader
        now, which keeps its speed, or the car's if that is less, until the track is on the route.
        """
        inside = way.inside & ~(way.inside[0] & way.goes_along)
        before, after = (moved_m(car, free, way.times + late) for late in (-self.margin_s, self.margin_s))
        half_m = car.length_m / 2
        meets = inside & (after[:, None] + half_m > way.rear) & (before[:, None] - half_m < way.front)
        first = np.argmax(inside, axis=0)
        enters, tracks = way.times[first], np.arange(inside.shape[1])
        last = len(way.times) - 1 - np.argmax(inside[::-1], axis=0)
        lasts_s = np.maximum(way.times[last] - enters, _STEP_S)
        speed = np.maximum((way.rear[last, tracks] - way.rear[first, tracks]) / lasts_s, 0.0)
        leads_m = np.minimum(speed, car.speed_m_s) * way.times[:, None]
        # A track that goes across or against the route comes nearer until it has left.
        until = (way.times[:, None] <= way.times[np.argmax(meets, axis=0)]) | (speed <= 0)
        gap = np.where(inside & until, way.rear - leads_m, np.inf).min(axis=0, initial=np.inf) - half_m
        # The car lets a track pass that will be beside it, before the place where that comes onto the route.
        beside, begins_m = (gap <= 0) & (speed > 0), way.rear[first, tracks] - half_m
        gap, speed = np.where(beside, begins_m, np.maximum(gap, 0.0)), np.where(beside, 0.0, speed)
        met = meets.any(axis=0) & (begins_m > 0)
        yields = met & ~self._is_first(car, way, first, gap)
        return gap[yields], speed[yields]

    def _is_first(self, car: PlannedCar, way: Occupied, first: Ints, gap: Floats) -> Mask:
        """Return the mask (N,) of vehicles that are left to brake, as they can with ease before they come.

        The car goes first where it has the right of way. Where nobody has, it goes first if it is there clearly before,
        and else before vehicles from its left (Vienna Convention on Road Traffic, 1968, article 18.4); with traffic on
        the left before those from its right (Road Traffic Act of Japan, 1960, article 36).
        """
        place = np.clip(gap / car.route.spacing_m, 0, len(car.route.points) - 1).astype(int)
        right, enters, tracks = car.route.right_of_way[place], way.times[first], np.arange(len(gap))
        lead_s = enters - gap / max(car.speed_m_s, STANDS_M_S)
        waits = OUTER_SIDES[car.traffic_side] * way.aside[np.maximum(first - 1, 0), tracks] < 0
        earlier = (lead_s > self.margin_s) | ((lead_s > -self.margin_s) & waits)
        needed = way.speed / (2 * np.maximum(enters, _STEP_S))
        goes = (right == HAS_PRIORITY) | ((right == NOBODY_FIRST) & earlier)
        left_to_brake: Mask = goes & ~way.on_foot & (needed < _WITH_EASE_M_S2)
        return left_to_brake

    def _must_brake(self, car: PlannedCar, way: Occupied) -> bool:
        """Return whether the brake is on: since the delay after the first alarm, until no collision is predicted."""
        quiet = self._alarm_ns is None
        # A brake that is on already and suffices is no emergency; in one, it stays on until the danger is over.
        moved = moved_m(car, min(car.acceleration_m_s2, 0.0) if quiet else 0.0, way.times)[:, None]
        touches = way.touched & (way.rear < moved + car.length_m / 2) & (way.front > moved - car.length_m / 2)
        touches &= way.rear[0] > car.length_m / 2  # nothing is gained by braking for what comes from the side or behind
        soon = touches[way.times <= self.braking_ttc_s].any() and car.speed_m_s > (_AEB_FROM_M_S if quiet else 0.1)
        if not soon:
            self._alarm_ns = None
        elif quiet:
            warned = (touches[way.times <= self.braking_ttc_s] & way.warned).any()
            self._alarm_ns = car.time_ns - round(self.braking_delay_s * NS_PER_S) * int(warned)
        return self._alarm_ns is not None and car.time_ns + car.dt_s * NS_PER_S / 2 >= self._alarm_ns + (
            self.braking_delay_s * NS_PER_S
        )

    def _learn(self, car: PlannedCar) -> tuple[Floats, Floats]:
        """Return the turn rates (N,) rad/s of tracks, and the share (N,) of their velocities that is believed."""
        tracks, before = car.tracks, self._known
        direction, speed = np.arctan2(*tracks.velocity.T[::-1]), np.hypot(*tracks.velocity.T)
        turns = speed > 2 * STANDS_M_S
        self._known = {}
        for k, identity in enumerate(tracks.id.tolist()):
            known, rate = before.get(identity), 0.0
            since_ns = car.time_ns if known is None else known.since_ns
            if known is not None and turns[k] and car.time_ns > known.seen_ns:
                turned = float(wrap_angle(direction[k] - known.direction)) + car.turned_rad
                rate = _smoothed(known.turn_rate, turned, (car.time_ns - known.seen_ns) / NS_PER_S, float(speed[k]))
            self._known[identity] = _Known(since_ns, car.time_ns, float(direction[k]), rate)
        rates = np.array([each.turn_rate for each in self._known.values()])
        age_s = (car.time_ns - np.array([each.since_ns for each in self._known.values()])) / NS_PER_S
        return rates, np.minimum((age_s + car.dt_s) / _BELIEF_S, 1.0)


class _Known(NamedTuple):
    """Memory of a track: when it was seen first and last, its direction then, rad, and its turn rate, rad/s."""

    since_ns: int
    seen_ns: int
    direction: float
    turn_rate: float


def _smoothed(rate: float, turned: float, passed_s: float, speed: float) -> float:
    """Return the turn rate, rad/s, of a track that had one before and has turned by an angle, rad, since."""
    most, weight = min(_LATERAL_M_S2 / speed, speed / _RADIUS_M), math.exp(-passed_s / _TURNING_S)
    return weight * rate + (1 - weight) * min(max(turned / passed_s, -most), most)


def moved_m(car: PlannedCar, acceleration: float, times: Floats) -> Floats:
    """Return how far (T,) m the car comes, until it stands or is as fast as the limit; 0 before now."""
    times = np.maximum(times, 0.0)
    final = max(car.speed_m_s, float(car.route.speed_limit_m_s[0])) if acceleration > 0 else 0.0
    changing = times if acceleration == 0 else np.minimum(times, (final - car.speed_m_s) / acceleration)
    moved: Floats = (car.speed_m_s + acceleration / 2 * changing) * changing + final * (times - changing)
    return moved


@dataclass(frozen=True, slots=True, eq=False)
class Occupied:
    """Parts of a car's route that N tracks are predicted to occupy, at T times.

    Attributes:
        times: (T,) s from now, the first is now.
        inside: (T, N) whether a track's body is within the width that the car needs, with its margin.
        touched: (T, N) whether it is within the width of the car itself.
        aside: (T, N) m to the left of the route, of the body's middle.
        rear: (T, N) m along the route, of the body's rear.
        front: (T, N) m along the route, of the body's front.
        speed: (N,) m/s.
        speed_along: (N,) m/s along the route now.
        goes_along: (N,) whether it stands, or moves more along the route than across it now.
        on_foot: (N,) whether it is a person.
        warned: (N,) whether it has warned of a hard brake.
    """

    times: Floats
    inside: Mask
    touched: Mask
    aside: Floats
    rear: Floats
    front: Floats
    speed: Floats
    speed_along: Floats
    goes_along: Mask
    on_foot: Mask
    warned: Mask


def _near(car: PlannedCar, horizon_s: float, margin_m: float) -> Mask:
    """Return the mask (N,) of tracks that can come onto the route within the horizon: it saves most of the work."""
    tracks = car.tracks
    _, _, nearest = car.route.place(tracks.boxes.center[:, :2])
    apart = np.hypot(*(tracks.boxes.center[:, :2] - car.route.points[nearest]).T)
    reach = np.hypot(*tracks.velocity.T) * horizon_s + np.hypot(*tracks.boxes.size[:, :2].T) / 2
    near: Mask = apart < reach + car.width_m / 2 + margin_m + car.route.spacing_m
    return near


def _occupied(
    car: PlannedCar,
    tracks: Tracks,
    turn_rate: Floats,
    belief: Floats,
    times: Floats,
    margin_m: float,
    told: ToldWays | None,
) -> Occupied:
    """Predict tracks with constant speed and turn rate, or as they have told, and place them on the route."""
    velocity, forward = _weighted_velocity(car, tracks, belief)
    centers, yaw = _predicted(tracks, velocity, turn_rate, times)
    if told is not None:
        centers = np.where(told.known[:, None], told.places[..., :2], centers)
        yaw = np.where(told.known, told.places[..., 2], yaw)
    along, aside, nearest = car.route.place(centers.reshape(-1, 2))
    tangent, shape = car.route.tangents[nearest], yaw.shape
    cos, sin = np.cos(yaw), np.sin(yaw)
    east, north = tangent[:, 0].reshape(shape), tangent[:, 1].reshape(shape)
    parallel, across = np.abs(cos * east + sin * north), np.abs(sin * east - cos * north)
    length, width = tracks.boxes.size[:, :2].T / 2
    half_along, half_aside = length * parallel + width * across, length * across + width * parallel
    along, aside = along.reshape(shape), aside.reshape(shape)
    free_m = np.abs(aside) - half_aside - car.width_m / 2
    speed = np.hypot(*velocity.T)
    follows = forward > np.sqrt(np.maximum(speed**2 - forward**2, 0.0))
    return Occupied(
        times,
        free_m < margin_m,
        free_m < 0,
        aside,
        along - half_along,
        along + half_along,
        speed,
        forward,
        (speed < STANDS_M_S) | follows,
        np.isin(tracks.label, ON_FOOT),
        np.zeros(len(tracks), np.bool_) if told is None else told.warned,
    )


def _weighted_velocity(car: PlannedCar, tracks: Tracks, belief: Floats) -> tuple[Floats, Floats]:
    """Return velocities (N, 2) m/s of tracks, of which the part (N,) along the route counts in full, and that part."""
    _, _, nearest = car.route.place(tracks.boxes.center[:, :2])
    tangent = car.route.tangents[nearest]
    forward: Floats = np.einsum("nd,nd->n", tracks.velocity, tangent)
    onto = tracks.velocity - forward[:, None] * tangent
    return forward[:, None] * tangent + belief[:, None] * onto, forward


def _predicted(tracks: Tracks, velocity: Floats, turn_rate: Floats, times: Floats) -> tuple[Floats, Floats]:
    """Return centres (T, N, 2) m and headings (T, N) rad of tracks with constant speed and turn rate."""
    speed, direction = np.hypot(*velocity.T), np.arctan2(*velocity.T[::-1])
    speed = np.where(speed < STANDS_M_S, 0.0, speed)
    turned = turn_rate * times[:, None]
    # The chord of an arc: its length is that of the arc times sinc of half the turn, its direction lies half-way.
    chord = speed * times[:, None] * np.sinc(turned / (2 * np.pi))
    towards = direction + turned / 2
    step = chord[..., None] * np.stack([np.cos(towards), np.sin(towards)], axis=-1)
    return tracks.boxes.center[:, :2] + step, tracks.boxes.yaw + turned
