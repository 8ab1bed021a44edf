"""Write a built-in layout as a scenario file, as far as files can express it."""

from __future__ import annotations

from graphlib import TopologicalSorter
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from coopsim.world.places.layout import Footways, Layout
from coopsim.world.places.road_network import CircularLane


def write_layout(layout: Layout, path: Path, **sections: Any) -> Path:
    """Write a file with the layout as its `place`, and other sections."""
    lanes = {(start, end): layout.network.get_lane((start, end, 0)) for start, end, _ in layout.network.lanes}
    nodes: dict[str, list[float]] = {}
    for (start, end), lane in lanes.items():
        nodes.setdefault(start, _point(lane.position(0.0, 0.0)))
        nodes.setdefault(end, _point(lane.position(lane.length, 0.0)))
    roads = []
    for road, lane in lanes.items():
        roads.append({"from": road[0], "to": road[1], "speed_m_s": lane.speed_limit, "width_m": lane.width})
        if isinstance(lane, CircularLane):
            roads[-1] |= {"centre": _point(lane.center), "turn": "left" if lane.turn > 0 else "right"}
        if road in layout.priority:
            roads[-1]["priority"] = True
    rank = {slot: place for place, slot in enumerate(layout.connected_order, start=1)}
    starts = [
        {"road": list(slot.lane[:2]), "at_m": float(slot.along_m), "connected": rank[k]}
        for k, slot in enumerate(layout.slots)
    ]
    parked = [
        {"at": [bay.x_m, bay.y_m], "heading_deg": float(np.degrees(bay.heading_rad))}
        | ({} if bay.label is None else {"label": bay.label.title})
        for bay in layout.bays
    ]
    units = [
        {"at": _point(unit.translation[:2]), "look_at": _point((unit.translation + unit.rotation[:, 0])[:2])}
        for unit in layout.rsus
    ]
    place: dict[str, Any] = {
        "nodes": nodes,
        "roads": roads,
        "starts": starts,
        "cars_first": layout.cars_first,
        "speeds_m_s": [float(speed) for speed in layout.speeds_m_s],
        "parked": parked,
        "buildings": [{"outline": footprint.tolist(), "height_m": 9.0} for footprint in layout.road_map.buildings],
        "rsus": units,
        "mast_m": layout.rsu_height_m,
    }
    if layout.footways is not None:
        place["walks"] = _walks(layout.footways)
    path.write_text(yaml.safe_dump({"place": place, **sections}, sort_keys=False))
    return path


def _walks(footways: Footways) -> dict[str, Any]:
    """Return ways in an order that keeps the order of every node's neighbours."""
    links = TopologicalSorter[tuple[int, int]]()
    for node, row in enumerate(footways.neighbours):
        around = [(min(node, other), max(node, other)) for other in row[row >= 0].tolist()]
        for link in around:
            links.add(link)
        for before, after in pairwise(around):
            links.add(after, before)
    order = list(links.static_order())
    plain = [link for link in order if not footways.crossing[link]]
    across = [link for link in order if footways.crossing[link]]
    return {
        "nodes": {f"w{k}": _point(node) for k, node in enumerate(footways.nodes)},
        "ways": [[f"w{a}", f"w{b}"] for a, b in plain],
        "crosswalks": [[f"w{a}", f"w{b}"] for a, b in across],
    }


def _point(place: Any) -> list[float]:
    return [float(x) for x in place]
