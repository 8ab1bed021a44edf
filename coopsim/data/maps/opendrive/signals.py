"""Signals of OpenDRIVE: lights and signs, the lanes that they hold for, and what controls them."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Mapping

import numpy as np

from coopsim.data.maps.elements import Element
from coopsim.data.maps.notes import Notes
from coopsim.data.maps.opendrive.lanes import Key, Section
from coopsim.data.maps.opendrive.roads import Road
from coopsim.data.maps.street_map import SignalKind, StreetSignal

_LIGHTS = {str(1_000_000 + number) for number in (1, 2, 7, 8, 9, 10, 11, 12, 13, 14, 15, 16, 17, 18, 20)}
"""Types of the standard's own signals that are lights."""
_SIGNS: dict[str, SignalKind] = {
    "206": "stop",
    "205": "yield",
    "R1-1": "stop",
    "R1-2": "yield",
    "601": "stop",
    "602": "yield",
}
"""Types of signs that give right of way: of Germany (which CARLA takes, too), the United States, Britain."""


class Signals:
    """Signals of all roads, and the lanes that they hold for."""

    def __init__(self, notes: Notes) -> None:
        self._notes = notes
        self._signals: dict[str, StreetSignal] = {}
        self._held: dict[Key, dict[str, None]] = {}
        self._referred: list[tuple[str, list[Key], Element]] = []

    def read(self, element: Element, road: Road) -> None:
        """Read the `<signals>` of a road."""
        for each in element.at_path("signals", "signal"):
            name = each.need("id")
            if name in self._signals:
                self._notes.repair("signals with the id of another one get a new one", f"signal {name}")
                name = f"{name}.{road.id}.{each.line}"
            self._signals[name] = _signal(each, name, road)
            self._hold(name, _held(each, road))
        for each in element.at_path("signals", "signalReference"):
            self._referred.append((each.need("id"), _held(each, road), each))

    def lights(self) -> Mapping[Key, tuple[str, ...]]:
        """Return the lights that hold for each lane, once all roads are read."""
        for name, keys, element in self._referred:
            if name not in self._signals:
                where = f"signal {name}, line {element.line}"
                self._notes.repair("references to signals that do not exist are passed over", where)
            else:
                self._hold(name, keys)
        self._referred = []
        kinds = {name: each.kind for name, each in self._signals.items()}
        return {key: tuple(name for name in names if kinds[name] == "light") for key, names in self._held.items()}

    def all(self, controllers: Iterable[Element], names: Mapping[Key, str]) -> tuple[StreetSignal, ...]:
        """Return the signals, with their controllers and the lanes (those in `names`) that they hold for."""
        controlled = {}
        for controller in controllers:
            for control in controller.all("control"):
                signal = control.get("signalId")
                if signal not in self._signals:
                    where = f"controller {controller.get('id')}"
                    self._notes.repair("controls of signals that do not exist are passed over", where)
                controlled[signal] = controller.get("id")
        lanes: dict[str, list[str]] = {}
        for key, held in self._held.items():
            for name in held if key in names else ():
                lanes.setdefault(name, []).append(names[key])
        return tuple(
            dataclasses.replace(each, lanes=tuple(lanes.get(name, ())), controller=controlled.get(name))
            for name, each in self._signals.items()
        )

    def _hold(self, name: str, keys: list[Key]) -> None:
        for key in keys:
            self._held.setdefault(key, {})[name] = None


def _signal(element: Element, name: str, road: Road) -> StreetSignal:
    s, t = element.number("s"), element.number("t")
    at = road.surface.at(np.array([s]), np.array([t]))[0]
    at[2] += element.number("zOffset", 0.0)
    heading = road.surface.heading_at(s) + element.number("hOffset", 0.0)
    if element.get("orientation") == "-":
        heading += np.pi
    kind, code = element.get("type"), ":".join(element.get(name) for name in ("country", "type", "subtype"))
    light = element.get("dynamic") == "yes" or kind in _LIGHTS
    value = element.number("value", np.inf) if element.get("value") not in ("", "-1") else np.inf
    written = None if value in (np.inf, -1.0) else value
    for inertial in element.all("positionInertial"):
        at = np.array([inertial.number(axis, 0.0) for axis in "xyz"])
        heading = inertial.number("hdg", 0.0)
    what: SignalKind = "light" if light else _SIGNS.get(kind, "sign")
    return StreetSignal(name, what, code, written, at, float(heading))


def _held(element: Element, road: Road) -> list[Key]:
    """Return the driven lanes for which a signal, or a reference to one, holds.

    Lanes that it names count where its orientation is against all of them, as in CARLA's maps.
    """
    s, orientation = element.number("s"), element.get("orientation", "none")
    sections = [each for each in road.lanes.sections if each.pieces]
    if not sections:
        return []
    section: Section = ([each for each in sections if each.start <= s] or sections[:1])[-1]
    ranges = [(each.lane_number("fromLane"), each.lane_number("toLane")) for each in element.all("validity")]
    named = [
        piece
        for number, piece in section.pieces.items()
        if piece.is_driven and (not ranges or any(min(pair) <= number <= max(pair) for pair in ranges))
    ]
    ahead = [piece for piece in named if orientation not in ("+", "-") or piece.along == (orientation == "+")]
    return [piece.key for piece in (ahead if ahead or not ranges else named)]
