"""Objects of OpenDRIVE, each beside the road next to it."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from coopsim.data.maps.export.bodies import bodies_of
from coopsim.data.maps.export.opendrive.road_elements import RoadElement
from coopsim.data.maps.export.xml_parts import Element, put
from coopsim.geometry import exact
from coopsim.geometry.se3 import Floats
from coopsim.world.places.description import PlaceDescription
from coopsim.world.towns.plan import Stretch


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
    """Reference lines of roads, as stretches: road, s and geometry of each."""

    def __init__(self, roads: Sequence[RoadElement], streets: int) -> None:
        self.lines = [(road.id, s, each) for road in roads for s, each in _with_s(road)]
        self.road, self.s = (np.array([line[k] for line in self.lines], dtype=np.float64) for k in (0, 1))
        self.on_streets = self.road < streets
        stretches = [each for *_, each in self.lines]
        self.start = np.array([each.start for each in stretches])
        self.heading, self.length, self.curvature = (
            np.array([getattr(each, name) for each in stretches])
            for name in ("heading_rad", "length_m", "curvature_1_m")
        )

    def on_road(self, line: Floats) -> tuple[int, float, float, Floats]:
        """Return road, s, t and points (K, 2) m in the frame there, for an object on a line (K, 2) m.

        A single point is on the next road that has it at its side. Outlines stand on the next street, at its end if
        they are beyond that.
        """
        along, t = self._feet(line.mean(axis=0))
        inside = np.clip(along, 0.0, self.length)
        away = np.where(inside == along, np.abs(t), np.inf if len(line) == 1 else np.abs(t) + np.abs(along - inside))
        k = int(np.where(self.on_streets | (len(line) == 1), away, np.inf).argmin())
        stretch, at = self.lines[k][2], inside[k : k + 1]
        heading, origin = float(stretch.heading(at)[0]), stretch.position(at, t[k : k + 1])[0]
        x, y = float(exact.cos(heading)), float(exact.sin(heading))
        return int(self.road[k]), float(self.s[k] + at[0]), float(t[k]), (line - origin) @ np.array([[x, -y], [y, x]])

    def _feet(self, point: Floats) -> tuple[Floats, Floats]:
        """Return how far along all stretches (N,) a point's foot is, and how far to the left of it the point (N,) m."""
        cos, sin = exact.cos(self.heading), exact.sin(self.heading)
        x, y = (point - self.start).T
        ahead, aside = cos * x + sin * y, cos * y - sin * x
        bent = self.curvature != 0.0
        radius = 1.0 / np.where(bent, self.curvature, 1.0)
        side = np.sign(radius)
        turned = exact.arctan2(ahead, side * (radius - aside)) % (2 * np.pi)  # about the middle of the arc
        return np.where(bent, np.abs(radius) * turned, ahead), np.where(
            bent, radius - side * exact.hypot(ahead, radius - aside), aside
        )


def _with_s(road: RoadElement) -> Iterator[tuple[float, Stretch]]:
    """Yield the stretches of a road, and where they begin."""
    s = 0.0
    for each in road.line:
        yield s, each
        s += each.length_m
