"""Ways ahead of cars whose plans nobody knows: along the lanes of a map, straight on wherever there is a choice."""

from __future__ import annotations

import numpy as np

from coopsim.geometry.se3 import SE3, Floats, wrap_angle
from coopsim.types.driving import NOBODY_FIRST, Route
from coopsim.world.places.road_network import Lane, LaneIndex, RoadNetwork

_STEP_M, _REACH_M = 1.0, 60.0
"""Distance between the points of a way, and how far it reaches: braking with comfort from 13 m/s takes 56 m."""

_BESIDE_M, _TURNED_RAD = 3.0, 1.0
"""Distance from the middle of a lane, and angle to it, up to which a car may be on that lane."""


class MappedWays:
    """The lanes of a place, as a map has them.

    Args:
        network: the roads.
    """

    def __init__(self, network: RoadNetwork) -> None:
        self._network, self._lanes = network, list(network.lanes.items())
        self._points = np.zeros((0, 2))

    def _read(self) -> None:
        """Divide the lanes into points: only where somebody asks, as few do."""
        places = [np.arange(0.0, lane.length + _STEP_M, _STEP_M).clip(max=lane.length) for _, lane in self._lanes]
        self._along_m = np.concatenate(places)
        self._number = np.repeat(np.arange(len(places)), [len(each) for each in places])
        lanes = [lane for _, lane in self._lanes]
        self._points = np.concatenate([lane.positions(each, 0.0) for lane, each in zip(lanes, places, strict=True)])
        headings = [lane.heading_at(along) for lane, each in zip(lanes, places, strict=True) for along in each.tolist()]
        self._heading = np.array(headings)

    def ahead(self, world_SE3_base: SE3) -> Route | None:
        """Return the way ahead of a car at a place, in its base frame; None: it is on no lane.

        Rights of way are unknown, and lights as well.
        """
        if not len(self._points):
            self._read()
        apart_m = np.hypot(*(self._points - world_SE3_base.translation[:2]).T)
        turned = np.abs(wrap_angle(self._heading - world_SE3_base.yaw))
        cost = np.where((apart_m <= _BESIDE_M) & (turned <= _TURNED_RAD), apart_m + _BESIDE_M * turned, np.inf)
        nearest = int(np.argmin(cost))
        if not np.isfinite(cost[nearest]):
            return None
        points, limit_m_s = self._follow(int(self._number[nearest]), float(self._along_m[nearest]))
        lifted = np.column_stack([points, np.full(len(points), world_SE3_base.translation[2])])
        planar = world_SE3_base.inverse().apply(lifted)[:, :2]
        return Route(planar, _STEP_M, limit_m_s, np.full(len(planar), NOBODY_FIRST))

    def _follow(self, number: int, along_m: float) -> tuple[Floats, Floats]:
        """Return points (K, 2) m and speed limits (K,) m/s from a place on a lane on."""
        index, lane = self._lanes[number]
        points, limits, left_m = [], [], _REACH_M
        while left_m > 0:
            places = np.arange(along_m, min(lane.length, along_m + left_m), _STEP_M)
            points.append(lane.positions(places, 0.0))
            limits.append(np.full(len(places), lane.speed_limit))
            # The first place of the next lane is a step after the last one here.
            left_m, along_m = left_m - _STEP_M * len(places), along_m + _STEP_M * len(places) - lane.length
            onward = self._straight_on(index, lane)
            if left_m <= 0 or onward is None:
                break
            index, lane = onward
        joined = np.concatenate(points)
        if len(joined) < 2:  # at the very end of a road
            end = lane.positions(np.array([lane.length, lane.length + _STEP_M]), 0.0)
            return end, np.full(2, lane.speed_limit)
        return joined, np.concatenate(limits)

    def _straight_on(self, index: LaneIndex, lane: Lane) -> tuple[LaneIndex, Lane] | None:
        """Return the lane after another one that turns least; None: the road ends."""
        ends = self._network.graph.get(index[1], {})
        onward = [
            (index[1], to, number) for to, lanes in ends.items() for number in [min(index[2], len(lanes) - 1)] if lanes
        ]
        before = lane.heading_at(lane.length)

        def turn(each: LaneIndex) -> float:
            then = self._network.get_lane(each)
            return abs(float(wrap_angle(then.heading_at(then.length) - before)))

        best = min(onward, key=turn, default=None)
        return None if best is None else (best, self._network.get_lane(best))
