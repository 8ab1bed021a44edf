"""Ways over junctions: chains of lanes of connecting roads, from a lane outside to a lane outside."""

from __future__ import annotations

from collections.abc import Mapping

from coopsim.data.maps.notes import Notes
from coopsim.data.maps.opendrive.lanes import Key, Piece
from coopsim.data.maps.opendrive.links import Links
from coopsim.data.maps.opendrive.roads import Road
from coopsim.data.maps.street_map import Pairs, StreetWay
from coopsim.data.maps.turns import chains_from, joined, turn_of

_MOST = 256
"""Most ways from one lane."""


def find_ways(
    roads: Mapping[str, Road], links: Links, lights: Mapping[Key, tuple[str, ...]], notes: Notes
) -> tuple[dict[str, StreetWay], dict[str, tuple[Key, ...]]]:
    """Return the ways over junctions by id, and the lanes that each is made of.

    Args:
        roads: roads by id.
        links: links of their lanes.
        lights: signals that hold for a lane, by id.
        notes: record of repairs and omissions.
    """
    ways, chains, used = dict[str, StreetWay](), dict[str, tuple[Key, ...]](), set[Key]()
    inside = {key for key in links.pieces if roads[key[0]].junction is not None}
    for start in [key for key in links.pieces if key not in inside]:
        for number, chain in enumerate(chains_from(start, links.after, inside)):
            if number >= _MOST:
                notes.repair(f"ways beyond {_MOST} from one lane are left out", links.pieces[start].name)
                break
            way = _way(chain, links.pieces, roads, lights, ways)
            ways[way.id], chains[way.id] = way, chain[1:-1]
            used.update(chain[1:-1])
    notes.left_out["lanes in junctions that lead from no lane to another"] += len(inside - used)
    return ways, chains


def _way(
    chain: tuple[Key, ...],
    pieces: Mapping[Key, Piece],
    roads: Mapping[str, Road],
    lights: Mapping[Key, tuple[str, ...]],
    ways: Mapping[str, StreetWay],
) -> StreetWay:
    parts = [pieces[key] for key in chain[1:-1]]
    line, width = joined([(part.line, part.width_m) for part in parts])
    start, end = pieces[chain[0]].name, pieces[chain[-1]].name
    name = f"{start}>{end}"
    while name in ways:  # by another road
        name += "'"
    limits = [part.speed_m_s for part in parts if part.speed_m_s is not None]
    junction = roads[chain[1][0]].junction
    assert junction is not None, "the chain is within junctions"
    signals = dict.fromkeys(light for key in chain[:-1] for light in lights.get(key, ()))
    return StreetWay(name, start, end, junction, line, width, min(limits, default=None), turn_of(line), tuple(signals))


def yields_of(pairs: list[tuple[str, str]], chains: Mapping[str, tuple[Key, ...]]) -> Pairs | None:
    """Return pairs of ways of which the first yields, from pairs of roads `(low, high)`; None where there are none."""
    if not pairs:
        return None
    over: dict[str, list[str]] = {}
    for way, chain in chains.items():
        for road in dict.fromkeys(key[0] for key in chain):
            over.setdefault(road, []).append(way)
    return frozenset((one, two) for low, high in pairs for one in over.get(low, ()) for two in over.get(high, ()))
