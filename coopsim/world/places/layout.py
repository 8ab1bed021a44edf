"""The description of a place before anything moves: roads, scenery, ways, starts, and shapes to build scenery from."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from coopsim.geometry import exact
from coopsim.geometry.se3 import SE3, Floats, SE3Batch
from coopsim.support.arrays import numbered
from coopsim.types import Ints, Mask
from coopsim.types.driving import OUTER_SIDES
from coopsim.types.taxonomy import ObjectClass
from coopsim.world.models.model import Model
from coopsim.world.places.polyline import PolylineLane
from coopsim.world.places.relief import Relief
from coopsim.world.places.road_network import CircularLane, Lane, LaneIndex, Road, RoadNetwork
from coopsim.world.places.shapes import box, cylinder
from coopsim.world.places.signals import Signal
from coopsim.world.snapshot import AgentBody, RoadMap, StaticPart

LANE_M = 4.0
"""Usual width of a lane."""

ROADS_AHEAD = 5
"""Usual number of roads that drivers plan ahead, their present one included."""

CLEARANCE_M = 4.2
"""Movements over a junction whose middle lines come closer than this conflict."""

GROUND = (96, 110, 84)
ASPHALT = (70, 71, 74)
PAVEMENT = (150, 147, 140)
MARKING = (225, 225, 220)
STEEL = (160, 163, 168)


class Cars(NamedTuple):
    """Connected cars, in order.

    Attributes:
        id: (N,) of their actors.
        place: (N, 2) m.
        heading_rad: (N,).
        height_m: (N,) of the bodies.
    """

    id: Ints
    place: Floats
    heading_rad: Floats
    height_m: Floats


@dataclass(frozen=True, slots=True)
class StartSlot:
    """A place where a vehicle may start.

    Attributes:
        lane: the lane.
        along_m: distance from the lane's start.
        route: roads that the vehicle takes first, the lane's own before all others; then turns are drawn.
    """

    lane: LaneIndex
    along_m: float
    route: tuple[Road, ...] = ()


@dataclass(frozen=True, slots=True)
class Bay:
    """A place where a vehicle may stand parked.

    Attributes:
        x_m: middle, along x.
        y_m: middle, along y.
        heading_rad: direction of the vehicle.
        label: class of the vehicle; None: a car or, now and then, a van.
    """

    x_m: float
    y_m: float
    heading_rad: float
    label: ObjectClass | None = None


@dataclass(frozen=True, slots=True)
class Bystander:
    """Person or vehicle at rest, an actor that never moves, where nobody drives or walks.

    Attributes:
        model: name of its model.
        x_m: middle, along x.
        y_m: middle, along y.
        heading_rad: direction of its front.
        length_m: extent ahead.
        width_m: extent across.
    """

    model: str
    x_m: float
    y_m: float
    heading_rad: float
    length_m: float
    width_m: float

    @classmethod
    def of(cls, model: Model, x_m: float, y_m: float, heading_rad: float) -> Bystander:
        """Return a bystander of a model."""
        length_m, width_m, _ = model.size_m.tolist()
        return cls(model.name, x_m, y_m, heading_rad, length_m, width_m)


@dataclass(frozen=True, slots=True)
class Flight:
    """A drone's way: a circle, facing its center, which may itself move.

    Attributes:
        centre_m: center at the start, x and y.
        radius_m: radius.
        phase_rad: the drone's first place on it.
        speed_m_s: along the circle, counter-clockwise.
        drift_m_s: velocity of the circle's center, x and y.
        height_m: over the ground.
    """

    centre_m: tuple[float, float]
    radius_m: float = 25.0
    phase_rad: float = 0.0
    speed_m_s: float = 2.0
    drift_m_s: tuple[float, float] = (0.0, 0.0)
    height_m: float = 40.0

    def world_SE3_base(self, time_s: float) -> SE3:
        """Return the drone's pose: the origin on the ground under it, x towards the circle's center."""
        angle = self.phase_rad + self.speed_m_s / self.radius_m * time_s
        x, y = (start + drift * time_s for start, drift in zip(self.centre_m, self.drift_m_s, strict=True))
        spot = [x + self.radius_m * exact.cos(angle), y + self.radius_m * exact.sin(angle), 0.0]
        return SE3.from_xyz_yaw(spot, float(angle + np.pi))


def flights_around(centre_m: Floats, drift_m_s: tuple[float, float] = (0.0, 0.0)) -> tuple[Flight, ...]:
    """Return four flights on one circle, each on the far side of the one before, or between."""
    x, y = centre_m.tolist()
    return tuple(Flight((x, y), phase_rad=phase, drift_m_s=drift_m_s) for phase in np.pi * np.array([-0.5, 0.5, 0, 1]))


@dataclass(frozen=True, slots=True, eq=False)
class Footways:
    """A graph of straight ways on which people walk or ride, each from a node to its neighbour.

    Attributes:
        nodes: (K, 2) m.
        neighbours: (K, D) nodes that a node leads to, -1 where there are fewer than D.
        crossing: (K, K) whether the way between two nodes crosses a road.
    """

    nodes: Floats
    neighbours: Ints
    crossing: Mask

    @classmethod
    def linking(cls, nodes: Sequence[Floats], linked: Mask, crossing: Mask) -> Footways:
        """Make ways between the nodes that a matrix (K, K) links."""
        neighbours = np.full((len(nodes), linked.sum(axis=1).max()), -1, dtype=np.int64)
        for row, links in zip(neighbours, linked, strict=True):
            to = np.flatnonzero(links)
            row[: len(to)] = to
        return cls(np.array(nodes), neighbours, crossing)

    @property
    def capacity(self) -> int:
        """The number of people that fit: one on every two metres of pavement."""
        start, place = np.nonzero(self.neighbours >= 0)
        end = self.neighbours[start, place]
        length_m = exact.norm(self.nodes[end] - self.nodes[start], axis=1)
        back = (self.neighbours[end] == start[:, None]).any(axis=1)
        once = ((start < end) | ~back) & ~self.crossing[start, end]
        return int(length_m[once].sum() / 2.0)


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Layout:
    """A place.

    Attributes:
        network: its roads.
        slots: starts for vehicles, far enough apart for any two of them.
        connected_order: slots in the order in which their cars become connected.
        footways: None where people cannot walk.
        rsus: `world_SE3_base` of possible roadside units, in order; origin on the ground, x towards the road.
        rsu_height_m: height of their masts.
        speeds_m_s: target speeds that a policy can choose from, evenly spaced.
        static: meshes.
        road_map: outlines.
        movements: roads over a junction, from stop line to exit; none where roads do not meet.
        priority: movements to which others give way.
        yields: movements to which one gives way, by that one, in place of the rule by `priority`.
        signals: traffic lights.
        cut: lanes end at the place's edge, where vehicles leave and come in again.
        window_m: vehicles farther than this along x from all cars that keep together are replaced; None: never.
        cars_first: number of the first slots in `connected_order` that have cars, whatever else is drawn.
        convoy_gap_s: time gap at which those cars follow each other in their lane; None: they change lanes as others.
        cycleways: where people ride, as along the right edge of lanes; None: on the footways.
        bays: places for parked vehicles; those with a given class are taken first.
        flights: ways of possible drones, in order.
        cruise_m_s: speed at which possibly connected cars keep together; None: each drives for itself.
        roads_ahead: number of roads that a driver plans ahead, its present one included, to brake in time.
        clearance_m: straight or hardly bent movements closer than this conflict; other bent ones at `CLEARANCE_M`,
            because long vehicles swing out.
        furnishing: meshes of street furniture and plants, which stand there in full detail only.
        bystanders: people and vehicles at rest, who are there in the detail "street" only.
        relief: height of the ground, on which all of the above stand; None: flat, at 0.
    """

    network: RoadNetwork
    slots: tuple[StartSlot, ...]
    connected_order: tuple[int, ...]
    footways: Footways | None = None
    rsus: tuple[SE3, ...]
    rsu_height_m: float
    speeds_m_s: tuple[float, ...]
    static: tuple[StaticPart, ...]
    road_map: RoadMap
    movements: tuple[Road, ...] = ()
    priority: tuple[Road, ...] = ()
    yields: Mapping[Road, tuple[Road, ...]] = field(default_factory=dict)
    signals: tuple[Signal, ...] = ()
    cut: bool = False
    window_m: float | None = None
    cruise_m_s: float | None = None
    cars_first: int = 0
    convoy_gap_s: float | None = None
    cycleways: Footways | None = None
    bays: tuple[Bay, ...] = ()
    flights: tuple[Flight, ...] = ()
    roads_ahead: int = ROADS_AHEAD
    clearance_m: float = CLEARANCE_M
    furnishing: tuple[StaticPart, ...] = ()
    relief: Relief | None = None
    bystanders: tuple[Bystander, ...] = ()

    def heights(self, points: Floats) -> Floats:
        """Return the heights (N,) m of the ground at points (N, 2) m."""
        return np.zeros(len(points)) if self.relief is None else self.relief.heights(points)

    def on_ground(self, points: Floats) -> Floats:
        """Return points (N, 3) m of the ground, at points (N, 2) m."""
        there = np.empty((len(points), 3))
        there[:, :2], there[:, 2] = points, self.heights(points)
        return there

    def agents(self, cars: Cars, posts: tuple[int, int], time_s: float) -> dict[str, AgentBody]:
        """Return connected cars, then the first roadside units, then the first drones at a time (s).

        `posts` has the numbers of units and drones.
        """
        at = np.column_stack([self.on_ground(cars.place), cars.heading_rad])
        poses, bodies = SE3Batch.from_xyz_yaw(at), {}
        for k, (identity, height_m) in enumerate(zip(cars.id.tolist(), cars.height_m.tolist(), strict=True)):
            bodies[f"cav_{k}"] = AgentBody(f"cav_{k}", "cav", identity, poses[k], height_m)
        return bodies | self._posts(*posts, time_s)

    def _posts(self, rsus: int, drones: int, time_s: float) -> dict[str, AgentBody]:
        """Return the bodies of the first roadside units, then those of the first drones at a time (s)."""
        bodies = {
            f"rsu_{k}": AgentBody(f"rsu_{k}", "rsu", None, unit, self.rsu_height_m)
            for k, unit in enumerate(self.rsus[:rsus])
        }
        for k, flight in enumerate(self.flights[:drones]):
            pose = flight.world_SE3_base(time_s)
            pose = pose if self.relief is None else self.relief.raised(pose)
            bodies[f"drone_{k}"] = AgentBody(f"drone_{k}", "drone", None, pose, flight.height_m)
        return bodies

    @property
    def outer_side(self) -> int:
        """The side of lanes on which kerbs are: 1 is the left, -1 the right."""
        return OUTER_SIDES[self.road_map.traffic_side]


def box_part(
    name: str, low: tuple[float, float, float], high: tuple[float, float, float], color: tuple[int, int, int]
) -> StaticPart:
    """Build an upright block between two corners, m."""
    return StaticPart(name, *box(low, high), color, 0.4, closed=True)


def flat_part(
    name: str, polygons: list[Floats], z_m: float, color: tuple[int, int, int], reflectivity: float
) -> StaticPart:
    """Build a surface of convex polygons (K, 2), counter-clockwise, at a height."""
    counts = np.array([len(polygon) for polygon in polygons])
    corners = np.concatenate(polygons)
    vertices = np.column_stack([corners, np.full(len(corners), z_m)])
    polygon, number = numbered(counts - 2)  # of each triangle of their fans
    first = (np.cumsum(counts) - counts)[polygon]
    faces = np.column_stack([first, first + number + 1, first + number + 2])
    return StaticPart(name, vertices, faces, color, reflectivity, closed=False)


def post_part(name: str, foot: Floats, height_m: float) -> StaticPart:
    """Build a round post at `foot` (2,) m."""
    vertices, faces = _post(height_m)
    return StaticPart(name, vertices + np.array([*foot, 0.0]), faces, STEEL, 0.5, closed=True)


@lru_cache(maxsize=16)
def _post(height_m: float) -> tuple[Floats, Ints]:
    return cylinder(0.1, height_m, sections=8)


def rectangle(x: tuple[float, float], y: tuple[float, float]) -> Floats:
    """Return the corners (4, 2), counter-clockwise."""
    return np.array([[x[0], y[0]], [x[1], y[0]], [x[1], y[1]], [x[0], y[1]]])


_STRAIGHT_RAD = 1e-3  # at smaller kinks the slit outside is at most 2 mm wide


def lane_outline(lane: Lane, step_m: float = 2.0) -> list[Floats]:
    """Return a lane's surface as convex outlines (4, 2) m, counter-clockwise, in bends at most `step_m` long.

    They cover all of a bend: chords of its outer edge would leave slits to the next lane. Among those of a polyline are
    triangles (3, 2) that fill the outsides of its corners.
    """
    if isinstance(lane, PolylineLane):
        return _polyline_outline(lane)
    left_m, right_m, along = lane.width / 2, lane.width / 2, lane.stations(step_m)
    if isinstance(lane, CircularLane):
        outer_m = (lane.radius + lane.width / 2) / exact.cos(along[1] / lane.radius / 2) - lane.radius
        left_m, right_m = (left_m, outer_m) if lane.turn > 0 else (outer_m, right_m)
    left, right = lane.positions(along, left_m), lane.positions(along, -right_m)
    return list(np.stack([right[:-1], right[1:], left[1:], left[:-1]], axis=1))


def _polyline_outline(lane: PolylineLane) -> list[Floats]:
    """Return a piece (4, 2) m between two points each, and triangles (3, 2) m outside the corners between them."""
    corners, points = lane.corners, lane.points
    aside = np.column_stack([-corners["dir_y"], corners["dir_x"]])[:-1]
    half_m = corners["width"][:, None] / 2
    ends = [points[:-1] - half_m[:-1] * aside, points[1:] - half_m[1:] * aside]
    ends += [points[1:] + half_m[1:] * aside, points[:-1] + half_m[:-1] * aside]
    turned = np.diff(corners["heading"][:-1])
    wedges = []
    for k in np.flatnonzero(np.abs(turned) > _STRAIGHT_RAD).tolist():
        outside = -np.sign(turned[k]) * half_m[k + 1]
        edge = points[k + 1] + outside * aside[k], points[k + 1] + outside * aside[k + 1]
        wedges.append(np.array([points[k + 1], *(edge if turned[k] > 0 else edge[::-1])]))
    return [*np.stack(ends, axis=1), *wedges]
