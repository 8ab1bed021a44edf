"""Notes of a reader: repairs, elements left out, and the budget of points."""

from __future__ import annotations

from collections import Counter

from coopsim.data.maps.elements import Element

MOST_POINTS = 4_000_000
"""Points of lanes, and corners of objects, that a map may have: some 10,000 km of lanes."""


class Notes:
    """Notes that are taken while a file is read."""

    def __init__(self) -> None:
        self.left_out: Counter[str] = Counter()
        self._repairs: dict[str, list[str]] = {}
        self._points = 0

    @property
    def repaired(self) -> tuple[str, ...]:
        """Repairs of one kind in a line each: how many, and the first three."""
        lines = []
        for what, places in self._repairs.items():
            more = ", ..." if len(places) > 3 else ""
            lines.append(f"{what}: {len(places)} ({', '.join(places[:3])}{more})")
        return tuple(lines)

    def repair(self, what: str, where: str) -> None:
        """Note a repair: what was wrong and what is done, and where."""
        self._repairs.setdefault(what, []).append(where)

    def take_points(self, number: float, element: Element) -> None:
        """Raise an error if an element asks for more points than the map has left, before they are made."""
        self._points += int(min(number, 1e12))
        if self._points > MOST_POINTS:
            raise element.error(f"asks for more than the {MOST_POINTS:,} points that are accepted in a map")
