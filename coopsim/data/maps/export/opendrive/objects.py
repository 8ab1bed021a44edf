"""Objects of OpenDRIVE, each beside the road next to it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from coopsim.data.maps.export.bodies import bodies_of
from coopsim.data.maps.export.opendrive.road_elements import RoadElement
from coopsim.data.maps.export.xml_parts import Element, put
from coopsim.geometry import exact
from coopsim.geometry.se3 import Floats
from coopsim.world.places.description import PlaceDescription

_STEP_M = 0.5


def put_objects(
    elements: Sequence[Element], roads: Sequence[RoadElement], streets: int, description: PlaceDescription
) -> None:
    """Add all objects to the elements of roads, of which the first ones are streets."""
    places = _Places(roads, streets)
    lists: dict[int, Element] = {}
    for number, body in enumerate(bodies_of(description)):
        road, s, t, local = places.on_road(body.line)
        if road not in lists:
            lists[road] = put(elements[road], "objects")
        made = put(
            lists[road], "object", body.more, type=body.kind, id=number, name=f"{body.kind} {number}", s=s, t=t,
            zOffset=0.0, hdg=0.0, pitch=0.0, roll=0.0, orientation="none", height=body.height_m,
        )  # fmt: skip
        if len(local) > 1:
            outline = put(made, "outline", id=0, closed=body.closed, outer=True)
            for u, v in local.tolist():
                put(outline, "cornerLocal", u=u, v=v, z=0.0, height=body.height_m)
        if body.kind == "parkingSpace":
            put(made, "parkingSpace", access="all")


class _Places:
    """Places on the reference lines of roads, at short distances: x, y, cos and sin of the heading, s, road."""

    def __init__(self, roads: Sequence[RoadElement], streets: int) -> None:
        rows = []
        for road in roads:
            s = 0.0
            for each in road.line:
                along = np.linspace(0.0, each.length_m, int(each.length_m / _STEP_M) + 2)
                heading, number = each.heading(along), np.full(len(along), road.id)
                middle = each.position(along, np.zeros(len(along)))
                rows.append(np.column_stack([middle, exact.cos(heading), exact.sin(heading), s + along, number]))
                s += each.length_m
        self.rows, self.lengths = np.concatenate(rows), np.array([road.length_m for road in roads])
        self.on_streets = self.rows[:, 5] < streets

    def on_road(self, line: Floats) -> tuple[int, float, float, Floats]:
        """Return road, s, t and points (K, 2) m in the frame there, for an object on a line (K, 2) m.

        Outlines stand on the next street. A single point is on the next road that has it at its side.
        """
        offset, ahead = line.mean(axis=0) - self.rows[:, :2], self.rows[:, 2:4]
        away, s = exact.norm(offset, axis=1), self.rows[:, 4]
        along = (offset * ahead).sum(axis=1)
        beside = (np.abs(along) < _STEP_M) & (s + along >= 0.0) & (s + along <= self.lengths[self.rows[:, 5].astype(int)])
        k = int(np.where(self.on_streets if len(line) > 1 else beside, away, np.inf).argmin())
        (x, y), row = ahead[k], self.rows[k]
        local = (line - row[:2]) @ np.array([[x, -y], [y, x]])
        u, t = local.mean(axis=0).tolist()
        if len(line) == 1:  # the road may bend between the place and the foot
            return int(row[5]), float(row[4]) + u, t, local
        return int(row[5]), float(row[4]), t, local - [0.0, t]
