"""Ways over junctions: chains of lanes within junctions, from a lane outside to a lane outside."""

from __future__ import annotations

from collections.abc import Hashable, Iterator, Mapping, Reversible
from typing import Protocol, TypeVar

from coopsim.data.maps.notes import Notes
from coopsim.data.maps.street_map import StreetWay
from coopsim.data.maps.turns import joined, turn_of
from coopsim.geometry.se3 import Floats

K = TypeVar("K", bound=Hashable)

_LONGEST, _MOST, _MOST_STEPS = 32, 256, 4096
"""Most lanes in a row within junctions, most ways from one lane, and most steps to find them."""


class Part(Protocol):
    """A lane as a part of a way: its name, middle (K, 3) m, width (K,) m and limit."""

    @property
    def name(self) -> str: ...
    @property
    def line(self) -> Floats: ...
    @property
    def width_m(self) -> Floats: ...
    @property
    def speed_m_s(self) -> float | None: ...


def find_ways(
    lanes: Mapping[K, Part],
    after: Mapping[K, Reversible[K]],
    junctions: Mapping[K, str],
    lights: Mapping[K, tuple[str, ...]],
    notes: Notes,
) -> tuple[dict[str, StreetWay], dict[str, tuple[K, ...]]]:
    """Return the ways over junctions by id, and the lanes of each, with those at its ends.

    Args:
        lanes: lanes by key.
        after: lanes that lanes lead on to.
        junctions: the junction of each lane that is within one.
        lights: signals that hold for a lane, by id.
        notes: record of repairs and omissions.
    """
    ways, chains, used = dict[str, StreetWay](), dict[str, tuple[K, ...]](), set[K]()
    for start in [key for key in lanes if key not in junctions]:
        for number, chain in enumerate(_chains(start, after, junctions)):
            if number >= _MOST:
                notes.repair(f"ways beyond {_MOST} from one lane are left out", lanes[start].name)
                break
            name = f"{lanes[start].name}>{lanes[chain[-1]].name}"
            while name in ways:  # by other lanes
                name += "'"
            signals = dict.fromkeys(light for key in chain[:-1] for light in lights.get(key, ()))
            ways[name] = _way(name, [lanes[key] for key in chain], junctions[chain[1]], tuple(signals))
            chains[name] = chain
            used.update(chain[1:-1])
    notes.left_out["lanes in junctions that lead from no lane to another"] += len(set(junctions) - used)
    return ways, chains


def _chains(start: K, after: Mapping[K, Reversible[K]], junctions: Mapping[K, str]) -> Iterator[tuple[K, ...]]:
    """Yield chains from a lane through lanes within junctions to a lane outside."""
    open_chains: list[tuple[K, ...]] = [
        (start, each) for each in reversed(after.get(start, ())) if each in junctions
    ]  # fmt: skip
    for _ in range(_MOST_STEPS):
        if not open_chains:
            return
        chain = open_chains.pop()
        for each in reversed(after.get(chain[-1], ())):
            if each not in junctions:
                yield (*chain, each)
            elif each not in chain and len(chain) < _LONGEST:
                open_chains.append((*chain, each))


def _way(name: str, chain: list[Part], junction: str, signals: tuple[str, ...]) -> StreetWay:
    parts = chain[1:-1]
    line, width = joined([(part.line, part.width_m) for part in parts])
    speed = min((part.speed_m_s for part in parts if part.speed_m_s is not None), default=None)
    return StreetWay(name, chain[0].name, chain[-1].name, junction, line, width, speed, turn_of(line), signals)
