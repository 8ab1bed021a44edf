"""The planner of all reported results: the Intelligent Driver Model, yielding, and automatic emergency braking.

It is plain on purpose, so that differences between runs are differences of perception. It sees nothing but tracks:

1. Tracks are predicted for `horizon_s` with constant speed and turn rate.
2. The nearest track on the route is the leader of the Intelligent Driver Model (Treiber, Hennecke and Helbing,
   "Congested traffic states in empirical observations and microscopic simulations", Phys. Rev. E 62, 2000, eq. 2-3).
3. A track that is predicted to cross the route while the car would be there is a standing leader at the crossing: the
   car yields, unless it has the right of way over a vehicle that can still stop with ease.
4. Where the car's body would touch a predicted one within `braking_ttc_s`, it brakes as hard as it can, after
   `braking_delay_s`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np

from coopsim.geometry.se3 import Floats, wrap_angle
from coopsim.planning.planner import PLANNERS, PlannedCar, Planner
from coopsim.support.checks import require_positive
from coopsim.types import NS_PER_S, Mask, Tracks
from coopsim.types.driving import HAS_PRIORITY, LARGEST_BRAKING_M_S2
from coopsim.types.taxonomy import ObjectClass

_ON_FOOT = (ObjectClass.PEDESTRIAN, ObjectClass.CHILD)
"""They always have the right of way: a car does not count on it that they stop."""

_DELTA = 4
"""The exponent of the Intelligent Driver Model."""

_SLOWEST_M_S = 0.5
"""Slower tracks stand: the direction of their velocity is noise."""


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

    _headings: dict[int, tuple[int, float, float]] = field(default_factory=dict, init=False, repr=False)
    _alarm_ns: int | None = field(default=None, init=False, repr=False)

    def __post_init__(self) -> None:
        names = ("headway_s", "gap_m", "acceleration_m_s2", "braking_m_s2", "horizon_s", "margin_m", "margin_s")
        require_positive(**{name: getattr(self, name) for name in (*names, "braking_ttc_s", "braking_delay_s")})

    def plan(self, car: PlannedCar) -> float:
        way = _occupied(car, self._turn_rates(car), self.horizon_s, self.margin_m)
        if self._must_brake(car, way):
            return -LARGEST_BRAKING_M_S2
        wanted = self._free_road(car)
        leader = way.inside[0] & (way.rear[0] > 0)
        speed = np.maximum(way.speed_along, 0.0)
        gaps = np.concatenate([way.rear[0][leader], self._crossings(car, way)])
        speeds = np.concatenate([speed[leader], np.zeros(len(gaps) - int(leader.sum()))])
        if not len(gaps):
            return wanted
        return min(wanted, float(self._behind(car, gaps - car.length_m / 2, speeds).min()))

    def _free_road(self, car: PlannedCar) -> float:
        """Return the acceleration with nothing ahead, m/s²: the Improved IDM's, or what a lower limit ahead asks for.

        Treiber and Kesting (2013), eq. 11.21, which brakes with no more than comfort above the limit.
        """
        speed, limits = car.speed_m_s, car.route.speed_limit_m_s
        ahead_m = np.maximum(np.arange(len(limits)) * car.route.spacing_m, car.route.spacing_m)
        needed = float(((speed**2 - limits**2) / (2 * ahead_m))[1:].max())
        if needed > self.braking_m_s2:
            return -min(needed, LARGEST_BRAKING_M_S2)
        limit, most, least = max(float(limits[0]), 0.1), self.acceleration_m_s2, self.braking_m_s2
        if speed <= limit:
            return most * (1 - math.pow(speed / limit, _DELTA))
        return -least * (1 - math.pow(limit / speed, most * _DELTA / least))

    def _behind(self, car: PlannedCar, gap_m: Floats, speed_m_s: Floats) -> Floats:
        """Return IDM's accelerations (M,) behind leaders with bumper-to-bumper gaps (M,) m and speeds (M,) m/s."""
        closing = car.speed_m_s - speed_m_s
        dynamic = car.speed_m_s * closing / (2 * np.sqrt(self.acceleration_m_s2 * self.braking_m_s2))
        desired = self.gap_m + np.maximum(car.speed_m_s * self.headway_s + dynamic, 0.0)
        accelerations: Floats = self._free_road(car) - self.acceleration_m_s2 * (desired / np.maximum(gap_m, 0.1)) ** 2
        return accelerations

    def _crossings(self, car: PlannedCar, way: _Occupied) -> Floats:
        """Return where on the route (M,) m the car has to yield to tracks that are not on it yet."""
        later = ~way.inside[0] & way.inside.any(axis=0)
        inside = way.inside & later
        enters = np.where(later, way.times[np.argmax(inside, axis=0)], np.inf)
        leaves = np.where(later, way.times[len(way.times) - 1 - np.argmax(inside[::-1], axis=0)], -np.inf)
        rear = np.where(inside, way.rear, np.inf).min(axis=0)
        front = np.where(inside, way.front, -np.inf).max(axis=0)
        speed = max(car.speed_m_s, _SLOWEST_M_S)
        arrives, gone = (rear - car.length_m / 2) / speed, (front + car.length_m / 2) / speed
        meets = later & (arrives < leaves + self.margin_s) & (gone > enters - self.margin_s) & (rear > 0)
        # A vehicle without the right of way is left to brake, as long as it can do so with ease.
        needed = np.hypot(*car.tracks.velocity.T) / (2 * np.maximum(enters, 0.1))
        nearest = np.clip(rear / car.route.spacing_m, 0, len(car.route.points) - 1)
        priority = car.route.right_of_way[np.where(later, nearest, 0).astype(int)] == HAS_PRIORITY
        waits = priority & ~np.isin(car.tracks.label, _ON_FOOT) & (needed < self.braking_m_s2)
        places: Floats = rear[meets & ~waits]
        return places

    def _must_brake(self, car: PlannedCar, way: _Occupied) -> bool:
        """Return whether the brake is on: since the delay after the first alarm, until no collision is predicted."""
        moved = car.speed_m_s * way.times[:, None]
        touches = way.inside & (way.rear < moved + car.length_m / 2) & (way.front > moved - car.length_m / 2)
        touches &= way.front[0] > -car.length_m / 2  # nothing is gained by braking for what comes from behind
        soon = touches[way.times <= self.braking_ttc_s].any() and car.speed_m_s > 0.1
        if not soon:
            self._alarm_ns = None
        elif self._alarm_ns is None:
            self._alarm_ns = car.time_ns
        return self._alarm_ns is not None and car.time_ns + car.dt_s * NS_PER_S / 2 >= self._alarm_ns + (
            self.braking_delay_s * NS_PER_S
        )

    def _turn_rates(self, car: PlannedCar) -> Floats:
        """Return the turn rates (N,) rad/s of tracks, smoothed from the directions that they had before."""
        tracks, known = car.tracks, self._headings
        direction, speed = np.arctan2(*tracks.velocity.T[::-1]), np.hypot(*tracks.velocity.T)
        rates = np.zeros(len(tracks))
        self._headings = {}
        for k, identity in enumerate(tracks.id.tolist()):
            before = known.get(identity)
            if before is not None and speed[k] > 2 * _SLOWEST_M_S and car.time_ns > before[0]:
                measured = float(wrap_angle(direction[k] - before[1])) / ((car.time_ns - before[0]) / NS_PER_S)
                rates[k] = 0.7 * before[2] + 0.3 * float(np.clip(measured, -1.0, 1.0))
            self._headings[identity] = (car.time_ns, float(direction[k]), float(rates[k]))
        return rates


@dataclass(frozen=True, slots=True, eq=False)
class _Occupied:
    """Parts of a car's route that N tracks are predicted to occupy, at T times.

    Attributes:
        times: (T,) s from now, the first is now.
        inside: (T, N) whether a track's body is within the width that the car needs.
        rear: (T, N) m along the route, of the body's rear.
        front: (T, N) m along the route, of the body's front.
        speed_along: (N,) m/s along the route now.
    """

    times: Floats
    inside: Mask
    rear: Floats
    front: Floats
    speed_along: Floats


def _occupied(car: PlannedCar, turn_rate: Floats, horizon_s: float, margin_m: float) -> _Occupied:
    """Predict tracks with constant speed and turn rate, and place them on the route."""
    tracks, times = car.tracks, np.linspace(0.0, horizon_s, round(horizon_s / 0.1) + 1)
    centers, yaw = _predicted(tracks, turn_rate, times)
    along, aside, nearest = car.route.place(centers.reshape(-1, 2))
    tangent = car.route.tangents[nearest]
    angle = yaw.reshape(-1) - np.arctan2(tangent[:, 1], tangent[:, 0])
    length, width = np.tile(tracks.boxes.size[:, :2], (len(times), 1)).T / 2
    half_along = length * np.abs(np.cos(angle)) + width * np.abs(np.sin(angle))
    half_aside = length * np.abs(np.sin(angle)) + width * np.abs(np.cos(angle))
    shape = (len(times), len(tracks))
    inside = np.abs(aside) < half_aside + car.width_m / 2 + margin_m
    first = tangent.reshape(*shape, 2)[0]
    speed_along: Floats = np.einsum("nd,nd->n", tracks.velocity, first)
    return _Occupied(
        times,
        inside.reshape(shape),
        (along - half_along).reshape(shape),
        (along + half_along).reshape(shape),
        speed_along,
    )


def _predicted(tracks: Tracks, turn_rate: Floats, times: Floats) -> tuple[Floats, Floats]:
    """Return centres (T, N, 2) m and headings (T, N) rad of tracks with constant speed and turn rate."""
    speed, direction = np.hypot(*tracks.velocity.T), np.arctan2(*tracks.velocity.T[::-1])
    turned = turn_rate * times[:, None]
    # The chord of an arc: its length is that of the arc times sinc of half the turn, its direction lies half-way.
    chord = speed * times[:, None] * np.sinc(turned / (2 * np.pi))
    towards = direction + turned / 2
    step = chord[..., None] * np.stack([np.cos(towards), np.sin(towards)], axis=-1)
    return tracks.boxes.center[:, :2] + step, tracks.boxes.yaw + turned
