"""Demand of SUMO: when that of a file begins, and traffic without a file, which goes to and fro for ever."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from coopsim.data.maps.elements import read_starts
from coopsim.data.maps.export.xml_parts import document, put
from coopsim.data.maps.street_map import DRIVEN, StreetMap
from coopsim.errors import InvalidValueError, MapFileError
from coopsim.support.rng import stream
from coopsim.types.taxonomy import ObjectClass
from coopsim.world.population import Population

_DEPARTING = ("vehicle", "trip", "flow", "person", "personFlow")
_ROUNDS = 20
"""Times that a vehicle drives to its farther end and back: hours, in a town."""

_KINDS: Mapping[ObjectClass, str] = {
    ObjectClass.CAR: "passenger",
    ObjectClass.TRUCK: "truck",
    ObjectClass.VAN: "delivery",
    ObjectClass.BUS: "bus",
    ObjectClass.MOTORCYCLE: "motorcycle",
}


def begin_of(path: Path) -> float:
    """Return the time at which the first road user of a demand departs, s; a demand is in order of departure.

    Raises:
        MapFileError: the file is missing, broken or no demand.
    """
    elements = read_starts(path)
    if next(elements, ("", {}))[0] not in ("routes", "additional"):
        raise MapFileError(f"{path} is no demand of SUMO; accepted: a file of <routes> (.rou.xml)")
    for tag, attributes in elements:
        given = attributes.get("begin" if tag.lower().endswith("flow") else "depart", "0")
        if tag in _DEPARTING and given[0].isdigit():
            try:
                return float(sum(60**k * float(part) for k, part in enumerate(reversed(given.split(":")))))
            except ValueError:
                raise MapFileError(f"{path}: <{tag}>: a time must be a number, or h:m:s, got {given!r}") from None
    raise MapFileError(f"{path} has no road user that departs at a time")


def circuits(streets: StreetMap, population: Population, seed: int) -> str:
    """Return a demand: vehicles and people of these numbers, who go to and fro between two drawn roads each.

    Raises:
        InvalidValueError: there are no two roads from which one comes back, or no pavements for people.
    """
    driven, walked = _circular(streets), _walked(streets)
    people = population.pedestrians + population.children
    if len(driven) < 2 or (people and len(walked) < 2):
        what = "roads that lead to each other" if len(driven) < 2 else "pavements, as pedestrians need"
        raise InvalidValueError(f"{streets.source} has less than two {what}; accepted: a demand (.rou.xml)")
    root, rng = ElementTree.Element("routes"), stream(seed, "circuits")
    for kind, count in population.on_roads.items():
        put(root, "vType", id=_KINDS[kind], vClass=_KINDS[kind])
        for number, (start, end) in enumerate(_pairs(rng, driven, count)):
            via = " ".join([end, *[start, end] * _ROUNDS])
            how = {"departPos": "random_free", "departLane": "free", "departSpeed": "0"}
            ends = {"from": start, "to": start, "via": via}
            put(root, "trip", ends | how, id=f"{_KINDS[kind]}{number}", type=_KINDS[kind], depart=0)
    for number, (start, end) in enumerate(_pairs(rng, walked, people)):
        person = put(root, "person", id=f"person{number}", depart=0, departPos="random")
        put(person, "walk", {"from": start, "to": end})
        for each in [start, end] * _ROUNDS:
            put(person, "walk", to=each)
    return document(root)


def _pairs(rng: np.random.Generator, roads: Mapping[str, float], count: int) -> Iterator[tuple[str, str]]:
    """Yield pairs of different roads, drawn by their lengths, m."""
    names, length_m = list(roads), np.array(list(roads.values()))
    for _ in range(count):
        first, second = rng.choice(len(names), 2, replace=False, p=length_m / length_m.sum()).tolist()
        yield names[first], names[second]


def _circular(streets: StreetMap) -> dict[str, float]:
    """Return the lengths of the roads, by id, of the largest group in which each leads to all others."""
    road = {name: lane.road for name, lane in streets.lanes.items()}
    length_m = {lane.road: lane.length_m for lane in streets.lanes.values() if lane.kind == DRIVEN[0]}
    number = {name: k for k, name in enumerate(length_m)}
    pairs = [(road[way.start], road[way.end]) for way in streets.ways.values()]
    pairs += [(road[start], road[end]) for start, after in streets.links.items() for end in after]
    rows = np.array([(number[a], number[b]) for a, b in pairs if a in number and b in number], np.int64).reshape(-1, 2)
    graph = coo_matrix((np.ones(len(rows)), tuple(rows.T)), shape=(len(number), len(number)))
    _, part = connected_components(graph, connection="strong")
    largest = np.bincount(part, minlength=1).argmax()
    return {name: length_m[name] for name, k in number.items() if part[k] == largest}


def _walked(streets: StreetMap) -> dict[str, float]:
    """Return the lengths of the roads beside which people walk, by id."""
    return {lane.road: lane.length_m for lane in streets.lanes.values() if lane.kind == "walk"}
