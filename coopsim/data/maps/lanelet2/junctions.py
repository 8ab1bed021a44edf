"""Junctions of lanelets: files have none. Lanelets are within one by their tags, or where they part, join or cross."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from coopsim.data.maps.lanelet2.borders import divided
from coopsim.data.maps.lanelet2.lanelets import Lanelet, Neighbours
from coopsim.data.maps.street_map import length_of

_LONGEST_M = 100.0
"""Longest lanelet without a tag that is taken as within a junction."""
_CELL_M, _STEP_M, _NEXT = (1.5, 1.5, 3.0), 0.5, 3
"""Sizes of cells, east, north and up; distance of points; how many others in a cell a lanelet meets at most."""


def junctions_of(lanelets: Mapping[str, Lanelet], beside: Neighbours) -> dict[str, str]:
    """Return the junction of each lanelet that is within one, named after one of its lanelets."""
    meetings = _meetings({name: lanelets[name] for name in beside.after})
    crossed = {name for pair in meetings for name in pair if not beside.is_near(*pair)}
    inside = [name for name in beside.after if _is_inside(lanelets[name], beside, name in crossed)]
    index = {name: k for k, name in enumerate(inside)}
    follow = [(name, after) for name in inside for after in beside.after[name]]
    pairs = [(index[one], index[two]) for one, two in (*meetings, *follow) if one in index and two in index]
    ends = np.array(pairs, dtype=np.int64).reshape(-1, 2)
    graph = coo_matrix((np.ones(len(ends)), (ends[:, 0], ends[:, 1])), shape=(len(inside), len(inside)))
    group = connected_components(graph, directed=False)[1].tolist() if inside else []
    first: dict[int, str] = {}
    return {name: first.setdefault(number, name) for name, number in zip(inside, group, strict=True)}


def _is_inside(lanelet: Lanelet, beside: Neighbours, is_crossed: bool) -> bool:
    tags, before, after = lanelet.item.tags, beside.before.get(lanelet.name, ()), beside.after[lanelet.name]
    if not before or not after or tags.get("is_intersection") == "no":
        return False
    if "turn_direction" in tags or tags.get("is_intersection") == "yes":
        return True
    parts = any(len(beside.after[each]) > 1 for each in before) or any(len(beside.before[each]) > 1 for each in after)
    return (parts or is_crossed) and length_of(lanelet.line) <= _LONGEST_M


def _meetings(lanelets: Mapping[str, Lanelet]) -> list[tuple[str, str]]:
    """Return pairs of lanelets whose middles go through one cell of space.

    Lines that cross have points in one cell of at least one of eight grids, each half a cell from the others.
    """
    names = list(lanelets)
    points = [divided(each.line, _STEP_M) for each in lanelets.values()]
    owner, scaled = np.repeat(np.arange(len(names)), list(map(len, points))), np.concatenate(points) / _CELL_M
    found: set[tuple[int, int]] = set()
    for shift in np.argwhere(np.ones((2, 2, 2))):
        rows = np.unique(np.column_stack([np.floor(scaled + shift / 2), owner]), axis=0)
        for step in range(1, _NEXT + 1):
            share = (rows[:-step, :3] == rows[step:, :3]).all(axis=1)
            pairs = np.column_stack([rows[:-step, 3], rows[step:, 3]])[share].astype(np.int64)
            found.update((one, two) for one, two in pairs.tolist())
    return [(names[one], names[two]) for one, two in sorted(found)]
