"""Lights with their controllers, and signs that say who gives way: on the ways for which they hold."""

from __future__ import annotations

from collections.abc import Mapping

from coopsim.data.maps.export.town_network import TownNetwork, Way
from coopsim.data.maps.export.xml_parts import Element, put
from coopsim.world.places.road_network import Road
from coopsim.world.towns.plan import LANE_M

_LIGHT = {"dynamic": True, "country": "OpenDRIVE", "type": "1000001", "zOffset": 2.4, "height": 0.9, "width": 0.3}
_YIELD = {"dynamic": False, "country": "DE", "type": "205", "zOffset": 2.0, "height": 0.9, "width": 0.9}
_FROM_KERB_M = 0.7


def put_signals(elements: Mapping[Road, Element], town: TownNetwork) -> dict[str, list[int]]:
    """Add lights and signs to the roads of ways; return the numbers of lights that change together, by group.

    The name of a group begins with that of its junction.
    """
    groups: dict[str, list[int]] = {}
    for number, ((junction, lights, *_), ways) in enumerate(_posts(town).items()):
        for k, way in enumerate(ways):
            signals = put(elements[way.road], "signals")
            at = {"s": 0.0, "t": -town.inner_left * (LANE_M / 2 + _FROM_KERB_M), "id": number, "orientation": "+"}
            if k:
                put(signals, "signalReference", at)
            else:
                put(signals, "signal", at | _named(_LIGHT if lights else _YIELD) | {"subtype": "-1", "value": -1})
        if lights:
            groups.setdefault(f"{junction} {lights}", []).append(number)
    return groups


def put_controllers(root: Element, groups: Mapping[str, list[int]]) -> dict[str, int]:
    """Add a controller for each group of lights; return their numbers."""
    for number, (name, lights) in enumerate(groups.items()):
        controller = put(root, "controller", id=number, name=name.partition(" ")[0], sequence=0)
        for each in lights:
            put(controller, "control", signalId=each, type="0")
    return {name: number for number, name in enumerate(groups)}


def _named(given: Mapping[str, object]) -> dict[str, object]:
    return {**given, "dynamic": "yes" if given["dynamic"] else "no"}


def _posts(town: TownNetwork) -> dict[tuple[str, str, str, bool], list[Way]]:
    """Return the ways by what stands at their beginnings: junction, states of their light or "", and arm."""
    states = {
        tuple(road): "".join(phase.state[k] for phase in signal.phases)
        for signal in town.description.signals
        for k, road in enumerate(signal.roads)
    }
    yielding = {other.road for junction in town.junctions for _, other in town.first_ways(junction)}
    found: dict[tuple[str, str, str, bool], list[Way]] = {}
    for way in town.ways:
        if way.road in states or way.road in yielding:
            key = way.junction, states.get(way.road, ""), way.start.road, way.start.forwards
            found.setdefault(key, []).append(way)
    return found
