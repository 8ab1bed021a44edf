"""Plausibility: what physics forbids, a message cannot say. The checks of F2MD, of poses and of objects."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass

import numpy as np

from coopsim.defenses.belief import SenderBeliefs
from coopsim.geometry.se3 import Floats, wrap_angle
from coopsim.interfaces.defense import DEFENSES, Claim, Defense, Reception, Trust
from coopsim.interfaces.guard import MOST_SENDERS
from coopsim.support.checks import require_positive
from coopsim.types import NS_PER_S, Mask

VIOLATED, KEPT = 20.0, 0.8
"""Likelihood ratio, lying to honest, of a message that breaks a check, and of one that breaks none; ours: one broken
check makes a sender suspect, two in a row condemn it, and a second of good messages clears it."""

_SHORT_S, _WINDOW_S = 0.45, 1.05
"""Shortest time over which a speed is taken, and the longest; F2MD takes headings over up to 1.1 s."""

_MOVED_M = 4.0
"""Shortest way of which the direction counts: errors of poses of 0.5 m turn it by 10 degrees."""

_NOISE_M = 2.0
"""Error of a sender's place that no check counts: four times the 0.5 m of the largest noise in CoBEVT's tests."""


@DEFENSES.register("plausibility")
@dataclass(kw_only=True, eq=False)
class Plausibility(Defense):
    """Checks of senders' poses and objects by the limits of physics (Kamel et al., "Simulation Framework for
    Misbehavior Detection in Vehicular Networks", IEEE TVT 2020: F2MD).

    A message breaks a check if its sender is farther away than radios reach, moves too fast or speeds up too hard, goes
    where it does not head, appears from nowhere nearby, sends too often, or states a time in the future or long past;
    or if an object in it is too large, too fast or too far from its sender. Broken checks are evidence in a hidden
    Markov model of each sender; objects that break one are left out at once.

    F2MD's senders state their speeds, and ours do not, so checks compare places over half a second to one. Its
    checks of maps and of senders' bodies are left out: receivers have no map, and drones fly over cars.

    Attributes:
        range_m: longest distance of a sender that is heard; F2MD's largest, 420 m, and as much again for drones.
        speed_m_s: highest speed, F2MD's 47 m/s and a tenth.
        acceleration_m_s2: largest change of speed; cars brake with 8 to 10 m/s², the rest is for errors of poses.
        heading_rad: largest angle between a sender's heading and its way, F2MD's 90 degrees.
        near_m: distance within which no new sender appears; it would have been heard before.
        oldest_s: largest age of a message.
        most_per_s: most messages of a sender in a second.
        reach_m: largest distance of an object from its sender.
    """

    range_m: float = 840.0
    speed_m_s: float = 52.0
    acceleration_m_s2: float = 15.0
    heading_rad: float = 1.571
    near_m: float = 30.0
    oldest_s: float = 2.5
    most_per_s: float = 25.0
    reach_m: float = 250.0

    def __post_init__(self) -> None:
        require_positive(**{name: getattr(self, name) for name in self.__dataclass_fields__})
        self._beliefs, self._paths = SenderBeliefs(), dict[str, deque[_Place]]()
        self._began_ns: int | None = None

    def judge(self, reception: Reception) -> Trust:
        now_ns = reception.observation.time_ns
        if self._began_ns is None:
            self._began_ns = now_ns
        objects = []
        for claim in reception.claims:
            possible = self._possible(claim)
            if claim.is_new:
                good = bool(possible.all()) and self._sender_is_possible(claim, reception)
                self._beliefs.update(claim.sender, KEPT if good else VIOLATED)
            objects.append(possible.astype(np.float64))
        while len(self._paths) > MOST_SENDERS:
            self._paths.pop(next(iter(self._paths)))
        return Trust({name: self._beliefs.trust(name) for name in reception.senders}, objects)

    def _possible(self, claim: Claim) -> Mask:
        """Return the mask (N,) of objects that break no check."""
        found = claim.detections
        away_m = found.boxes.center[:, :2] - claim.base_SE3_sender.translation[:2]
        possible: Mask = np.hypot(*away_m.T) <= self.reach_m
        possible &= (found.boxes.size <= _LARGEST_M).all(axis=1) & (found.boxes.size >= _SMALLEST_M).all(axis=1)
        if found.velocity is not None:
            fast = np.hypot(*found.velocity.T) > self.speed_m_s  # False for an unknown speed
            possible &= ~fast
        return possible

    def _sender_is_possible(self, claim: Claim, reception: Reception) -> bool:
        """Return whether a new message breaks no check of its sender, and remember its place."""
        at = reception.odom_SE3_base.compose(claim.base_SE3_sender)
        place = _Place(claim.message.captured_ns, at.translation[:2], at.yaw)
        known = claim.sender in self._paths
        path = self._paths.setdefault(claim.sender, deque(maxlen=256))
        now_ns, away_m = reception.observation.time_ns, float(np.hypot(*claim.base_SE3_sender.translation[:2]))
        good = away_m <= self.range_m and -_AHEAD_S <= claim.age_s <= self.oldest_s
        assert self._began_ns is not None
        if not known and now_ns - self._began_ns > 2 * NS_PER_S:
            good &= away_m >= self.near_m
        while path and place.time_ns - path[0].time_ns > _WINDOW_S * NS_PER_S:
            path.popleft()
        path.append(place)
        return good and len(path) <= self.most_per_s * _WINDOW_S + 1 and self._moves_as_cars_do(path)

    def _moves_as_cars_do(self, path: deque[_Place]) -> bool:
        """Return whether a sender's way in the last second keeps to the limits."""
        first, last = path[0], path[-1]
        apart_s = (last.time_ns - first.time_ns) / NS_PER_S
        if apart_s < _SHORT_S:
            return True
        way = last.place_m - first.place_m
        far_m = float(np.hypot(*way))
        if far_m - _NOISE_M > self.speed_m_s * apart_s:
            return False
        turned = abs(float(wrap_angle(np.arctan2(way[1], way[0]) - last.yaw_rad)))
        if far_m > _MOVED_M and turned > self.heading_rad:
            return False
        middle = min(path, key=lambda each: abs(2 * each.time_ns - first.time_ns - last.time_ns))
        before_s, after_s = (middle.time_ns - first.time_ns) / NS_PER_S, (last.time_ns - middle.time_ns) / NS_PER_S
        if apart_s < 2 * _SHORT_S or min(before_s, after_s) < _SHORT_S / 2:
            return True
        before, after = (middle.place_m - first.place_m) / before_s, (last.place_m - middle.place_m) / after_s
        # Both speeds err by the noise of two places over their times.
        error_m_s = _NOISE_M / before_s + _NOISE_M / after_s
        return float(np.hypot(*(after - before))) - error_m_s <= self.acceleration_m_s2 * apart_s / 2


@dataclass(frozen=True, slots=True, eq=False)
class _Place:
    """Place (2,) m and heading of a sender at capture, in the receiver's odometry frame."""

    time_ns: int
    place_m: Floats
    yaw_rad: float


_AHEAD_S = 0.1
"""Largest time by which a stamp may be in the future: agents' clocks differ."""

_LARGEST_M, _SMALLEST_M = np.array([38.0, 6.0, 8.0]), np.array([0.1, 0.1, 0.1])
"""Bounds of length, width and height: long trucks have 25.25 x 2.55 x 4 m (Council Directive 96/53/EC), and detectors
err by half, in height by more."""
