"""Junctions of lanelets: files have none. Lanelets are within one by their tags, or where they part, join or cross."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from coopsim.data.maps.lanelet2.borders import divided
from coopsim.data.maps.lanelet2.lanelets import Lanelet, Neighbours
from coopsim.data.maps.notes import Notes
from coopsim.data.maps.street_map import StreetWay, length_of
from coopsim.data.maps.turns import chains_from, joined, turn_of

_LONGEST_M = 100.0
"""Longest lanelet without a tag that is taken as within a junction."""
_CELL_M, _LEVEL_M, _STEP_M, _CROWDED = 1.5, 3.0, 0.5, 8
_MOST = 256
"""Most ways from one lanelet."""


def junctions_of(lanelets: Mapping[str, Lanelet], beside: Neighbours) -> dict[str, str]:
    """Return the junction of each lanelet that is within one, named after one of its lanelets."""
    driven = [each for each in lanelets.values() if each.is_driven]
    if not driven:
        return {}
    cells = _Cells(driven)
    crossed = cells.crossed(beside)
    inside = [k for k, each in enumerate(driven) if _is_inside(each, beside, crossed)]
    index = {driven[k].id: k for k in inside}
    pairs = [(k, index[other]) for name, k in index.items() for other in beside.after[name] if other in index]
    group = cells.grouped(inside, pairs)
    return {driven[k].id: driven[inside[int(np.argmax(group == group[n]))]].id for n, k in enumerate(inside)}


def _is_inside(lanelet: Lanelet, beside: Neighbours, crossed: set[str]) -> bool:
    name, tags = lanelet.id, lanelet.item.tags
    before, after = beside.before.get(name, ()), beside.after[name]
    if not before or not after or tags.get("is_intersection") == "no":
        return False
    if "turn_direction" in tags or tags.get("is_intersection") == "yes":
        return True
    parts = any(len(beside.after[each]) > 1 for each in before) or any(len(beside.before[each]) > 1 for each in after)
    return (parts or name in crossed) and length_of(lanelet.line) <= _LONGEST_M


class _Cells:
    """Cells of space that middle lines go through, in eight grids: lines that cross are in a cell of one of them."""

    def __init__(self, driven: list[Lanelet]) -> None:
        self._driven = driven
        points = [divided(each.line, _STEP_M) for each in driven]
        owner = np.repeat(np.arange(len(driven)), list(map(len, points)))
        scaled = np.concatenate(points) / [_CELL_M, _CELL_M, _LEVEL_M]
        grids = [
            np.column_stack([np.full(len(owner), k), np.floor(scaled + shift / 2), owner])
            for k, shift in enumerate(np.argwhere(np.ones((2, 2, 2))))
        ]
        rows = np.unique(np.concatenate(grids), axis=0)
        _, self._cell = np.unique(rows[:, :4], axis=0, return_inverse=True)
        self._owner: NDArray[np.int64] = rows[:, 4].astype(np.int64)

    def crossed(self, beside: Neighbours) -> set[str]:
        """Return lanelets whose middle meets that of another which neither leads to it nor follows it."""
        found: set[str] = set()
        order = np.argsort(self._cell, kind="stable")
        for group in np.split(self._owner[order], np.flatnonzero(np.diff(self._cell[order])) + 1):
            if len(group) > 1:
                names = [self._driven[k].id for k in group.tolist()]
                found.update(names if len(names) > _CROWDED else (n for n in names if _is_strange(n, names, beside)))
        return found

    def grouped(self, inside: list[int], pairs: list[tuple[int, int]]) -> NDArray[np.int32]:
        """Return the number of the junction of each lanelet of `inside`: those in one cell, or in a pair, share it."""
        size, cells = len(self._driven), int(self._cell.max()) + 1
        chosen = np.isin(self._owner, inside)
        links = np.array(pairs, dtype=np.int64).reshape(-1, 2)
        first = np.concatenate([self._owner[chosen], links[:, 0]])
        second = np.concatenate([self._cell[chosen] + size, links[:, 1]])
        graph = coo_matrix((np.ones(len(first)), (first, second)), shape=(size + cells, size + cells))
        return np.asarray(connected_components(graph, directed=False)[1])[inside]


def _is_strange(name: str, names: list[str], beside: Neighbours) -> bool:
    near = {name, *beside.after[name], *beside.before.get(name, ())}
    near |= {other for each in beside.before.get(name, ()) for other in beside.after[each]}
    near |= {other for each in beside.after[name] for other in beside.before[each]}
    return any(other not in near for other in names)


def ways_of(
    lanelets: Mapping[str, Lanelet], beside: Neighbours, junctions: Mapping[str, str], notes: Notes
) -> tuple[dict[str, StreetWay], dict[str, tuple[str, ...]]]:
    """Return the ways over junctions by id, and the lanelets that each goes over, with those at its ends."""
    ways, chains = dict[str, StreetWay](), dict[str, tuple[str, ...]]()
    for start in beside.after:
        for number, chain in enumerate(chains_from(start, beside.after, junctions) if start not in junctions else ()):
            if number >= _MOST:
                notes.repair(f"ways beyond {_MOST} from one lanelet are left out", start)
                break
            way = _way(chain, lanelets, junctions)
            while way.id in ways:  # by other lanelets
                way = StreetWay(f"{way.id}'", *(getattr(way, name) for name in StreetWay.__slots__[1:]))
            ways[way.id], chains[way.id] = way, chain
    used = {name for chain in chains.values() for name in chain}
    notes.left_out["lanelets in junctions that lead from no lane to another"] += len(set(junctions) - used)
    return ways, chains


def _way(chain: tuple[str, ...], lanelets: Mapping[str, Lanelet], junctions: Mapping[str, str]) -> StreetWay:
    parts = [lanelets[name] for name in chain[1:-1]]
    line, width_m = joined([(part.line, part.width_m) for part in parts])
    limits = [part.speed_m_s for part in parts if part.speed_m_s is not None]
    name, speed = f"{chain[0]}>{chain[-1]}", min(limits, default=lanelets[chain[0]].speed_m_s)
    return StreetWay(name, chain[0], chain[-1], junctions[chain[1]], line, width_m, speed, turn_of(line))
