"""Situations that users write, from the key `situation` of a scenario file.

| key | value |
|---|---|
| `name` | a registered situation, whose fields are the further keys; without it the file has roles: |
| `ego` | the car that has to avoid the crash: `from` and `to`, points on lanes; `speed_m_s`; `model` |
| `vehicles` | list: `name`, `label` (a class; without: car), `model`, `manner` and `trigger_m` (see |
| | `coopsim.world.script`); parked ones have `at`, a point beside a lane; others `from`, `to` |
| | and `speed_m_s` |
| `people` | list: `name`, `label` (without: pedestrian), `path` (points), `speed_m_s`, `starts_s` |
| `meets_s` | of a vehicle or a person, in place of where or when it starts: time by which it reaches the ego's way |
| | after the ego's front is there, if neither reacts; such a role is one that the ego may crash into |
| `connected` | of a vehicle: `true` where it is an agent whatever `penetration` is |
| `over_s`, `penetration`, `rsus` | see `coopsim.world.situations.situation.Situation` |

A number may be a range instead, `[least, most]`: each seed draws it anew, with equal chances.
"""

from __future__ import annotations

import heapq
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, replace

import numpy as np

from coopsim.config.checked_entry import Entry
from coopsim.geometry import exact
from coopsim.geometry.se3 import Floats
from coopsim.support.checks import require_finite_number, require_flag
from coopsim.types.taxonomy import ObjectClass
from coopsim.world.models.catalogue import make_models
from coopsim.world.places.layout import Layout
from coopsim.world.places.road_network import LaneIndex, Road, RoadNetwork
from coopsim.world.script import MANNERS, VehicleRole, WalkRole
from coopsim.world.situations.casting import draw, draw_model
from coopsim.world.situations.sites import Way, with_limits
from coopsim.world.situations.situation import EGO, Range, Situation, Stage

ROLE_KEYS = ("ego", "vehicles", "people")

_ON_LANE_M, _BESIDE_M = 2.5, 8.0  # from a lane's middle: of starts and ends, and of parked vehicles
_STEP_M, _MEETS_M = 0.5, 2.0  # ways meet where points that are `_STEP_M` apart come closer than `_MEETS_M`
_CLASSES = {label.title: label for label in ObjectClass}


@dataclass(frozen=True, slots=True, eq=False)
class WrittenVehicle:
    """A vehicle that a user describes; `way` counts from its start, `meets_m` is where it meets the ego's."""

    role: VehicleRole
    way: Way | None = None
    speed_m_s: Range = (0.0, 0.0)
    meets_s: Range | None = None
    meets_m: tuple[float, float] = (0.0, 0.0)


@dataclass(frozen=True, slots=True, eq=False)
class WrittenWalk:
    """A person whom a user describes; `meets_m` is where the ego's way and the person's meet."""

    role: WalkRole
    speed_m_s: Range
    starts_s: Range
    meets_s: Range | None = None
    meets_m: tuple[float, float] = (0.0, 0.0)


@dataclass(frozen=True, slots=True, eq=False)
class Roles:
    """All roles of a file."""

    ego: WrittenVehicle
    vehicles: tuple[WrittenVehicle, ...]
    people: tuple[WrittenWalk, ...]


@dataclass(frozen=True, kw_only=True, eq=False)
class WrittenSituation(Situation):
    """A situation with the roles of a scenario file.

    Attributes:
        roles: the roles.
    """

    roles: Roles

    name = "written"

    def stage(self, layout: Layout, rng: np.random.Generator) -> Stage | None:
        """Draw the numbers of the roles; see `Situation.stage`."""
        ego, model = self.roles.ego, draw_model(rng, ObjectClass.CAR)
        assert ego.way is not None, "the ego is not parked"
        if ego.role.model is not None:
            model = next(each for each in make_models() if each.name == ego.role.model)
        speed, front_m = draw(rng, ego.speed_m_s), float(model.size_m[0]) / 2
        limits = dict[Road, float]()
        vehicles, people = [], []
        for each in self.roles.vehicles:
            own = draw(rng, each.speed_m_s)
            start_m = 0.0
            if each.meets_s is not None:
                at_s = (each.meets_m[0] - front_m) / speed + draw(rng, each.meets_s)
                start_m = max(each.meets_m[1] - own * at_s, 0.0)
            vehicles.append(each.role if each.way is None else _starting(each, start_m, own))
            limits |= {} if each.way is None else dict.fromkeys(each.way.roads, max(own, 1.0))
        for walk in self.roles.people:
            own, starts_s = draw(rng, walk.speed_m_s), draw(rng, walk.starts_s)
            if walk.meets_s is not None:
                at_s = (walk.meets_m[0] - front_m) / speed + draw(rng, walk.meets_s)
                starts_s = at_s - walk.meets_m[1] / own
            people.append(replace(walk.role, speed_m_s=own, starts_s=starts_s))
        limits |= dict.fromkeys(ego.way.roads, speed)
        cast = replace(_starting(ego, 0.0, speed), model=model.name)
        others: tuple[WrittenVehicle | WrittenWalk, ...] = (*self.roles.vehicles, *self.roles.people)
        meets_m = [each.meets_m[0] for each in others if each.meets_s is not None]
        at = ego.way.position(min(meets_m, default=0.0))
        return Stage(with_limits(layout, limits), cast, tuple(vehicles), tuple(people), at)


def _starting(written: WrittenVehicle, start_m: float, speed_m_s: float) -> VehicleRole:
    assert written.way is not None
    lane, along_m = written.way.find(start_m)
    route = written.way.roads_from(start_m)
    return replace(written.role, lane=lane, along_m=along_m, route=route, speed_m_s=speed_m_s)


def read_roles(entry: Entry, layout: Layout) -> Roles:
    """Read the keys of `ROLE_KEYS`; errors say where the mistake is."""
    own = [field.name for field in fields(Situation) if field.name not in ("place", "place_seed", "detail")]
    found = entry.fields(("ego",), ("vehicles", "people", *own))
    ego = _read_driver(found["ego"], found["ego"].fields(("from", "to", "speed_m_s"), ("model",)), layout)
    role = replace(ego.role, name=EGO, connected=True)
    ego = replace(ego, role=role)
    vehicles = found["vehicles"].entries() if "vehicles" in found else ()
    people = found["people"].entries() if "people" in found else ()
    return Roles(
        ego,
        tuple(_read_vehicle(each, layout, ego) for each in vehicles),
        tuple(_read_walk(each, ego) for each in people),
    )


def _read_vehicle(entry: Entry, layout: Layout, ego: WrittenVehicle) -> WrittenVehicle:
    manner = "usual"
    if (named := entry.named()).get("manner") is not None:
        manner = named["manner"].choice(MANNERS)
    if manner == "parked":
        return _read_parked(entry, layout)
    optional = ("name", "label", "model", "manner", "trigger_m", "meets_s", "connected")
    keys = entry.fields(("from", "to", "speed_m_s"), optional)
    written = _read_driver(entry, keys, layout)
    trigger = float(keys["trigger_m"].checked(require_finite_number)) if "trigger_m" in keys else None
    connected = bool(keys["connected"].checked(require_flag)) if "connected" in keys else False
    role = replace(written.role, manner=manner, trigger_m=trigger, connected=connected, conflicts="meets_s" in keys)
    if "meets_s" not in keys:
        return replace(written, role=role)
    assert written.way is not None
    meets_m = _meeting(ego, _points(written.way), keys["meets_s"])
    return replace(written, role=role, meets_s=_read_range(keys["meets_s"]), meets_m=meets_m)


def _read_driver(entry: Entry, keys: Mapping[str, Entry], layout: Layout) -> WrittenVehicle:
    """Read a vehicle that drives from one point to another."""
    lanes, along_m = _find_route(layout.network, keys["from"], keys["to"])
    lengths = [layout.network.get_lane(lane).length for lane in lanes]
    way = Way(layout.network, lanes, np.append(0.0, np.cumsum(lengths)[:-1]) - along_m)
    role = VehicleRole(_name(keys, entry), lanes[0], along_m, label=_label(keys, "car"), model=_model(keys))
    return WrittenVehicle(role, way, _read_range(keys["speed_m_s"], least=0.0))


def _read_parked(entry: Entry, layout: Layout) -> WrittenVehicle:
    keys = entry.fields(("at", "manner"), ("name", "label", "model"))
    near = _lanes_near(layout.network, keys["at"], _BESIDE_M)
    aside, lane, along = min(near, key=lambda each: abs(each[0]))
    return WrittenVehicle(
        VehicleRole(
            _name(keys, entry),
            lane,
            along,
            label=_label(keys, "car"),
            manner="parked",
            aside_m=aside,
            model=_model(keys),
        )
    )


def _read_walk(entry: Entry, ego: WrittenVehicle) -> WrittenWalk:
    keys = entry.fields(("path", "speed_m_s"), ("name", "label", "starts_s", "meets_s"))
    path = keys["path"].points(2)
    label = _label(keys, "pedestrian")
    walk = WalkRole(_name(keys, entry), label, path, 1.0, conflicts="meets_s" in keys)
    speed = _read_range(keys["speed_m_s"], least=0.1)
    starts = _read_range(keys["starts_s"], least=0.0) if "starts_s" in keys else (0.0, 0.0)
    if "meets_s" not in keys:
        return WrittenWalk(walk, speed, starts)
    return WrittenWalk(walk, speed, starts, _read_range(keys["meets_s"]), _meeting(ego, path, keys["meets_s"]))


def _read_range(entry: Entry, least: float | None = None) -> Range:
    """Return a number, or [least, most], as a range."""
    numbers = [float(entry.checked(require_finite_number))] * 2 if entry.items() is None else entry.numbers(2)
    if numbers[0] > numbers[1]:
        raise entry.error(f"{entry.name} must be a number or [least, most], got {numbers}")
    if least is not None and numbers[0] < least:
        raise entry.error(f"{entry.name} must be at least {least:g}, got {numbers[0]:g}")
    return numbers[0], numbers[1]


def _name(keys: Mapping[str, Entry], entry: Entry) -> str:
    return keys["name"].text() if "name" in keys else entry.name


def _label(keys: Mapping[str, Entry], usual: str) -> ObjectClass:
    return _CLASSES[keys["label"].choice(_CLASSES, "class") if "label" in keys else usual]


def _model(keys: Mapping[str, Entry]) -> str | None:
    if "model" not in keys:
        return None
    label = _label(keys, "car")
    return keys["model"].choice([each.name for each in make_models() if each.label == label])


def _points(way: Way) -> Floats:
    """Return points (N, 2) m of a way, `_STEP_M` apart, from its place of interest on."""
    lane = way.network.get_lane(way.lanes[-1])
    return np.array([way.position(along) for along in np.arange(0.0, way.starts_m[-1] + lane.length, _STEP_M)])


def _meeting(ego: WrittenVehicle, path: Floats, entry: Entry) -> tuple[float, float]:
    """Return how far along the ego's way and along a path (K, 2) the two meet first, m."""
    assert ego.way is not None
    own, steps = _points(ego.way), np.diff(path, axis=0)
    lengths = exact.norm(steps, axis=1)
    reached = np.append(0.0, np.cumsum(lengths))
    along = np.arange(0.0, reached[-1], _STEP_M / 5)
    other = np.column_stack([np.interp(along, reached, path[:, k]) for k in range(2)])
    apart = exact.norm(own[:, None] - other, axis=2)
    if apart.min() > _MEETS_M:
        raise entry.error(
            f"{entry.name} needs a way that meets the ego's; the two come no closer than {apart.min():.1f} m"
        )
    first = int(np.flatnonzero(apart.min(axis=1) <= _MEETS_M)[0])
    last = min(first + int(2 * _MEETS_M / _STEP_M), len(own))
    k, n = np.unravel_index(int(apart[first:last].argmin()), apart[first:last].shape)
    return float((first + k) * _STEP_M), float(along[n])


def _lanes_near(network: RoadNetwork, entry: Entry, within_m: float) -> list[tuple[float, LaneIndex, float]]:
    """Return lanes near a point: its distance to the left, the lane, and the distance along it."""
    point, near = entry.point(), []
    for index, lane in network.lanes.items():
        along, aside = lane.local_coordinates(point)
        if 0 <= along <= lane.length and abs(aside) <= within_m:
            near.append((float(aside), index, float(along)))
    if not near:
        raise entry.error(f"{entry.name} must be within {within_m:g} m of the middle of a lane, got {point.tolist()}")
    return near


def _find_route(network: RoadNetwork, start: Entry, end: Entry) -> tuple[tuple[LaneIndex, ...], float]:
    """Return the lanes of the shortest way from one point to another, and how far along the first it begins, m."""
    ends = {lane: along for _, lane, along in _lanes_near(network, end, _ON_LANE_M)}
    queue: list[tuple[float, Sequence[LaneIndex], float]] = []
    for _, lane, along in _lanes_near(network, start, _ON_LANE_M):
        heapq.heappush(queue, (0.0, (lane,), along))
    seen = set()
    while queue:
        driven_m, lanes, along_m = heapq.heappop(queue)
        lane = lanes[-1]
        if lane in ends and (len(lanes) > 1 or ends[lane] > along_m):
            return tuple(lanes), along_m
        if lane in seen:
            continue
        seen.add(lane)
        further_m = driven_m + network.get_lane(lane).length - (along_m if len(lanes) == 1 else 0.0)
        for node, side_by_side in network.graph.get(lane[1], {}).items():
            following = (lane[1], node, min(lane[2], len(side_by_side) - 1))
            heapq.heappush(queue, (further_m, (*lanes, following), along_m))
    raise end.error(f"{end.name} must be where roads lead from {start.spot}; no way leads there")
