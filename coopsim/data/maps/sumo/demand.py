"""Demand of SUMO (`.rou.xml`): vehicles, trips and flows, as vehicles in an hour on the lanes and ways of a map."""

from __future__ import annotations

import dataclasses
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from itertools import pairwise
from pathlib import Path

import numpy as np
from scipy.sparse import csr_matrix
from scipy.sparse.csgraph import dijkstra

from coopsim.data.maps.check import driven_lanes
from coopsim.data.maps.elements import Element, read_elements
from coopsim.data.maps.notes import Notes
from coopsim.data.maps.street_map import StreetMap

_SPEED_M_S, _FOREVER_S, _HOUR_S = 13.9, 86_400.0, 3600.0
_NO_CARS = ("pedestrian", "bicycle", "tram", "rail", "rail_urban", "rail_electric", "rail_fast", "subway", "ship")
_LOST = "vehicles of the demand without a way on the map are left out"
Turns = Mapping[tuple[str, str], Sequence[str]]


@dataclasses.dataclass(frozen=True, slots=True)
class _Journey:
    """Vehicles that go over roads in order, by the quickest way between them; how many, and from when to when, s."""

    element: Element
    roads: tuple[str, ...]
    vehicles: float
    begin_s: float
    end_s: float


def with_demand(
    streets: StreetMap, path: str | Path, begin_s: float | None = None, end_s: float | None = None
) -> StreetMap:
    """Return a map with the traffic on its lanes and ways, from a demand of SUMO for the same network.

    Args:
        streets: the map.
        path: the demand, plain or in gzip. Trips take the quickest way without other traffic.
        begin_s: start of the time that counts, s as in the file; None: the first departure.
        end_s: its end; None: the last departure.

    Raises:
        MapFileError: the file is missing, broken or no demand, or no vehicle departs in this time on the map.
    """
    elements, notes = read_elements(Path(path)), Notes()
    root = next(elements)
    if root.tag not in ("routes", "additional"):
        raise root.error("is no demand of SUMO; accepted: a file of <routes> (.rou.xml)")
    journeys = list(_journeys(elements, notes))
    begin_s = min((each.begin_s for each in journeys), default=0.0) if begin_s is None else begin_s
    end_s = max((each.end_s for each in journeys), default=0.0) if end_s is None else end_s
    counts, turns = dict[tuple[str, ...], float](), _turns(streets)
    routes = _Routes(streets, turns)
    for each in journeys:
        within_s = min(end_s, each.end_s) - max(begin_s, each.begin_s)
        lasts_s = each.end_s - each.begin_s
        vehicles = each.vehicles * (within_s / lasts_s if lasts_s else 1.0) if within_s >= 0.0 else 0.0
        route = routes.over(each.roads) if vehicles else ()
        if route is None:
            notes.repair(_LOST, f"line {each.element.line}")
        elif route:
            for part in {*((road,) for road in route), *pairwise(route)}:
                counts[part] = counts.get(part, 0.0) + vehicles
    if not counts:
        raise root.error(f"has no vehicle that departs from {begin_s:g} to {end_s:g} s and has a way on the map")
    hours = max(end_s - begin_s, 1.0) / _HOUR_S
    return _told(streets, {roads: count / hours for roads, count in counts.items()}, turns, notes)


def _journeys(elements: Iterator[Element], notes: Notes) -> Iterator[_Journey]:
    """Yield the vehicles, trips and flows of a file."""
    routes, types = dict[str, tuple[str, ...]](), dict[str, str]()
    for element in elements:
        if element.tag == "route":
            routes[element.need("id")] = tuple(element.need("edges").split())
        elif element.tag == "vType":
            types[element.need("id")] = element.get("vClass")
        elif element.tag not in ("vehicle", "trip", "flow"):
            notes.left_out[f"elements {element.tag} of the demand"] += 1
        elif types.get(element.get("type")) in _NO_CARS:
            notes.left_out["vehicles of the demand that are no motor vehicles"] += 1
        else:
            inner = element.all("route")
            roads = tuple(inner[0].need("edges").split()) if inner else routes.get(element.get("route"), ())
            ends = (element.get("from"), *element.get("via").split(), element.get("to"))
            roads = roads or (ends if ends[0] and ends[-1] else ())
            begin_s, end_s, vehicles = _times(element)
            yield _Journey(element, roads, vehicles, begin_s, end_s)


def _times(element: Element) -> tuple[float, float, float]:
    """Return the first and last departure, s, and how many vehicles there are."""
    if element.tag != "flow":
        depart_s = _seconds(element, "depart")
        return depart_s, depart_s, 1.0
    begin_s = _seconds(element, "begin", 0.0)
    end_s = max(_seconds(element, "end", begin_s + _FOREVER_S), begin_s)
    lasts_s = end_s - begin_s
    if element.get("number"):
        return begin_s, end_s, max(element.number("number"), 0.0)
    if element.get("period") and not element.get("period").startswith("exp"):
        return begin_s, end_s, lasts_s / max(element.number("period"), 1e-3)
    rates = [("vehsPerHour", 1 / _HOUR_S), ("perHour", 1 / _HOUR_S), ("probability", 1.0)]
    name, factor = next(((name, factor) for name, factor in rates if element.get(name)), ("", 0.0))
    if not name:
        raise element.error("must have one of number, period in seconds, vehsPerHour and probability")
    return begin_s, end_s, max(element.number(name), 0.0) * factor * lasts_s


def _seconds(element: Element, name: str, default: float | None = None) -> float:
    """Return a time in s, which may be written as hours:minutes:seconds."""
    parts = element.get(name).split(":")
    if len(parts) != 3:
        return element.number(name, default)
    clock = Element(element.tag, dict(zip("hms", parts, strict=True)), element.file, element.line)
    return clock.number("h") * _HOUR_S + clock.number("m") * 60.0 + clock.number("s")


def _turns(streets: StreetMap) -> Turns:
    """Return the ways from one road to another, by their ids; of lanes that lead on without a way, none."""
    found: dict[tuple[str, str], list[str]] = {}
    road = {name: lane.road for name, lane in streets.lanes.items()}
    for start, after in streets.links.items():
        for end in after:
            found.setdefault((road[start], road[end]), [])
    for way in streets.ways.values():
        found.setdefault((road[way.start], road[way.end]), []).append(way.id)
    return found


class _Routes:
    """The quickest ways over the roads of a map."""

    def __init__(self, streets: StreetMap, turns: Turns) -> None:
        lanes = {lane.road: lane for lane in driven_lanes(streets)}
        self._names = list(lanes)
        self._number = {name: k for k, name in enumerate(self._names)}
        seconds = [lane.length_m / (lane.speed_m_s or _SPEED_M_S) for lane in lanes.values()]
        pairs = np.array([(self._number[one], self._number[two]) for one, two in turns]).reshape(-1, 2).astype(np.int64)
        weights = np.maximum(np.array(seconds)[pairs[:, 1]], 1e-3)
        self._graph = csr_matrix((weights, (pairs[:, 0], pairs[:, 1])), shape=(len(lanes), len(lanes)))
        self._before: dict[int, list[int]] = {}

    def over(self, roads: Sequence[str]) -> list[str] | None:
        """Return the roads from the first over the others to the last; None where there is no way."""
        if not roads or any(road not in self._number for road in roads):
            return None
        route = [self._number[roads[0]]]
        for start, end in pairwise(self._number[road] for road in roads):
            if start not in self._before:
                _, before = dijkstra(self._graph, indices=np.array([start]), return_predecessors=True)
                self._before[start] = np.asarray(before)[0].tolist()
            back = [end]
            while back[-1] != start:
                back.append(self._before[start][back[-1]])
                if back[-1] < 0:
                    return None
            route += back[-2::-1]
        return [self._names[k] for k in route]


def _told(streets: StreetMap, rates: Mapping[tuple[str, ...], float], turns: Turns, notes: Notes) -> StreetMap:
    """Return a map with rates of roads, and of turns from road to road, told to its lanes and ways."""
    on_way = {name: rates.get(pair, 0.0) / len(names) for pair, names in turns.items() for name in names}
    onward, by_road = dict.fromkeys(streets.lanes, 0.0), dict[str, list[str]]()
    for way in streets.ways.values():
        onward[way.start] += on_way[way.id]
    for lane in driven_lanes(streets):
        by_road.setdefault(lane.road, []).append(lane.id)
    on_lane = {}
    for road, names in by_road.items():
        total = sum(onward[name] for name in names)
        for name in names:  # by the turns that lead on from each
            share = onward[name] / total if total else 1 / len(names)
            on_lane[name] = rates.get((road,), 0.0) * share
    told = dataclasses.replace
    return told(
        streets,
        lanes={name: told(lane, traffic_per_h=on_lane.get(name)) for name, lane in streets.lanes.items()},
        ways={name: told(way, traffic_per_h=on_way[name]) for name, way in streets.ways.items()},
        repaired=(*streets.repaired, *notes.repaired),
        left_out=dict(sorted((Counter(streets.left_out) + notes.left_out).items())),
    )
