"""Regulatory elements of Lanelet2: limits, lights, signs, and who yields."""

from __future__ import annotations

from collections.abc import Mapping

from coopsim.data.maps.lanelet2.lanelets import SPEEDS, Lanelet
from coopsim.data.maps.osm.content import Content, Item, Places, quantity
from coopsim.data.maps.street_map import SignalKind, StreetSignal, StreetWay
from coopsim.geometry import exact

_SIGNALS: dict[str, SignalKind] = {"traffic_light": "light", "all_way_stop": "stop", "traffic_sign": "sign"}


class Rules:
    """Regulatory elements of a file by subtype, and the lanelets that name each."""

    def __init__(self, content: Content, lanelets: Mapping[str, Lanelet]) -> None:
        self._content, self._lanelets = content, lanelets
        self._rules = [each for each in content.relations.values() if each.tags.get("type") == "regulatory_element"]
        self._holds: dict[str, list[str]] = {}
        for name, lanelet in lanelets.items():
            for rule in lanelet.item.of_role("regulatory_element"):
                self._holds.setdefault(rule, []).append(name)

    def set_limits(self) -> None:
        """Give lanelets the speed limits that they name; one that is only on a sign is left out."""
        for rule in self._of("speed_limit"):
            limit = quantity(rule.tags.get("sign_type", ""), SPEEDS)
            if limit is None:
                self._content.notes.left_out["speed limits that only a sign tells"] += 1
            for name in self._holds.get(rule.id, ()) if limit is not None else ():
                self._lanelets[name].speed_m_s = limit

    def signals(self, places: Places, lanes: Mapping[str, object]) -> tuple[StreetSignal, ...]:
        """Return lights and signs, with the lanes (those in `lanes`) that they hold for."""
        found = []
        for rule in (each for subtype in _SIGNALS for each in self._of(subtype)):
            subtype, held, ways = rule.tags["subtype"], self._holds.get(rule.id, []), self._content.ways
            lines = [ways[name] for name in rule.of_role("refers", "ref_line") if name in ways]
            points = [line for each in lines if len(line := places.line(each))]
            if not points or not held:
                self._content.notes.repair("rules without a line, or that no lanelet names, are passed over", rule.id)
                continue
            step = self._lanelets[held[0]].line[-1] - self._lanelets[held[0]].line[-2]
            found.append(
                StreetSignal(
                    rule.id,
                    _SIGNALS[subtype],
                    f"lanelet2:{subtype}:{lines[0].tags.get('subtype', '')}",
                    None,
                    points[0].mean(axis=0),
                    float(exact.arctan2(step[1], step[0])),
                    tuple(name for name in held if name in lanes),
                )
            )
        return tuple(found)

    def lights(self) -> dict[str, tuple[str, ...]]:
        """Return the lights that hold for lanelets, by id."""
        found: dict[str, tuple[str, ...]] = {}
        for rule in self._of("traffic_light"):
            for name in self._holds.get(rule.id, ()):
                found[name] = (*found.get(name, ()), rule.id)
        return found

    def yields(
        self, ways: Mapping[str, StreetWay], chains: Mapping[str, tuple[str, ...]]
    ) -> dict[str, set[tuple[str, str]]]:
        """Return pairs of ways of which the first yields, by junction."""
        over: dict[str, list[str]] = {}
        for name, chain in chains.items():
            for part in chain[:-1]:
                over.setdefault(part, []).append(name)
        found: dict[str, set[tuple[str, str]]] = {}
        for rule in self._of("right_of_way"):
            low, high = ({way for part in rule.of_role(role) for way in over.get(part, ())}
                         for role in ("yield", "right_of_way"))  # fmt: skip
            for one in low - high:
                found.setdefault(ways[one].junction, set()).update(
                    (one, two) for two in high if ways[two].junction == ways[one].junction
                )
        return found

    def _of(self, subtype: str) -> list[Item]:
        return [each for each in self._rules if each.tags.get("subtype") == subtype]
