"""Outlines of a custom place."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from coopsim.geometry.se3 import Floats, wrap_angle
from coopsim.world.custom.roads import Roads
from coopsim.world.custom.ways import Ways
from coopsim.world.places.layout import lane_outline
from coopsim.world.places.markings import lane_lines
from coopsim.world.places.road_network import RoadNetwork
from coopsim.world.snapshot import RoadMap

_STRAIGHT_RAD = 1e-3  # at smaller kinks the slit outside is at most 2 mm wide


def road_map_of(
    roads: Roads, walks: Ways | None, paved: Mapping[str, list[Floats]], buildings: list[Floats], walls: list[Floats]
) -> RoadMap:
    """Return the outlines of a place.

    Args:
        roads: of the place.
        walks: of people.
        paved: outlines (K, 2) m by the field that they belong to.
        buildings: outlines (K, 2) m.
        walls: outlines (4, 2) m.
    """
    lanes = [quad for lane in roads.network.lanes.values() for quad in lane_outline(lane)] + _wedges(roads.network)
    crosswalks, pavements = (walks.crosswalks, walks.pavements) if walks else ([], [])
    more = {field: tuple(outlines) for field, outlines in paved.items()}
    more |= {"lanes": (*lanes, *paved["lanes"]), "pavements": (*pavements, *paved["pavements"])}
    lines = lane_lines(roads.network, roads.movements)
    return RoadMap(crosswalks=tuple(crosswalks), buildings=tuple(buildings), walls=tuple(walls), markings=lines, **more)


def _wedges(network: RoadNetwork) -> list[Floats]:
    """Return triangles (3, 2) m, counter-clockwise, that fill the outsides of kinks between lanes."""
    wedges = []
    for (_, node, _), lane in network.lanes.items():
        for after in (other for lanes in network.graph.get(node, {}).values() for other in lanes):
            turn = float(wrap_angle(after.heading_at(0.0) - lane.heading_at(lane.length)))
            if abs(turn) < _STRAIGHT_RAD:
                continue
            outside = -np.sign(turn) / 2
            corners = [lane.position(lane.length, outside * lane.width), after.position(0.0, outside * after.width)]
            wedges.append(np.array([after.position(0.0, 0.0), *(corners if turn > 0 else corners[::-1])]))
    return wedges
