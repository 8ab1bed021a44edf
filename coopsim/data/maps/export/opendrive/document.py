"""The OpenDRIVE file of a drawn town: 1.7, with elements that 1.4 has, so that older readers take it, too."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from xml.etree import ElementTree

import numpy as np

from coopsim.data.maps.export.map_format import MAP_FORMATS, require_suffix
from coopsim.data.maps.export.opendrive.cross_sections import (
    Section,
    one_lane,
    sections_of,
)
from coopsim.data.maps.export.opendrive.objects import put_objects
from coopsim.data.maps.export.opendrive.reference_lines import line_of, stretch_of
from coopsim.data.maps.export.opendrive.road_elements import Link, RoadElement, lane_number, put_road
from coopsim.data.maps.export.opendrive.signals import put_controllers, put_signals
from coopsim.data.maps.export.parking_strips import parking_strips
from coopsim.data.maps.export.town_network import LaneEnd, Ring, TownNetwork, Way
from coopsim.data.maps.export.xml_parts import Element, document, put
from coopsim.world.towns.plan import LANE_M, Street, StreetEnd


@MAP_FORMATS.register("opendrive")
def opendrive_files(town: TownNetwork, path: Path) -> dict[Path, str]:
    """Write OpenDRIVE (`.xodr`), for CARLA, esmini, MetaDrive and others."""
    require_suffix(path, ".xodr")
    return {path: opendrive_text(town)}


def opendrive_text(town: TownNetwork) -> str:
    """Return the file of a town."""
    return document(_Document(town).root)


class _Document:
    """A file that is being written."""

    def __init__(self, town: TownNetwork) -> None:
        self.town, self.right_ahead = town, town.inner_left > 0
        strips = parking_strips(town.plan)
        self.sections = {f"s{street.number}": sections_of(street, strips) for street in town.plan.streets}
        self.sections |= {ring.name: [one_lane(ring.lane.length, LANE_M, kerbed=True)] for ring in town.rings}
        names = [*self.sections, *(way.road for way in town.ways)]
        self.roads = {name: number for number, name in enumerate(names)}
        self.junctions = {name: len(names) + k for k, name in enumerate(town.junctions)}
        self.root = self._write()

    def _write(self) -> Element:
        town, root = self.town, ElementTree.Element("OpenDRIVE")
        self._put_header(root)
        streets = [self._street(street) for street in town.plan.streets]
        self.lines = {road.name: road.line for road in (*streets, *map(self._ring, town.rings))}
        roads = [*streets, *map(self._ring, town.rings), *map(self._way, town.ways)]
        elements = [put_road(root, road, self.right_ahead, town.description.kerb_m) for road in roads]
        put_objects(elements, roads, len(streets), town.description)
        groups = put_signals({way.road: elements[self.roads[way.road]] for way in town.ways}, town)
        numbers = put_controllers(root, groups)
        for name in self.junctions:
            self._put_junction(root, name, numbers)
        return root

    def _put_header(self, root: Element) -> None:
        nodes = np.array(list(self.town.description.nodes.values()))
        (west, south), (east, north) = nodes.min(axis=0).tolist(), nodes.max(axis=0).tolist()
        put(
            root, "header", revMajor=1, revMinor=7, name=self.town.name, version="1.00", north=north, south=south,
            east=east, west=west, vendor="coopsim",
        )  # fmt: skip

    def _street(self, street: Street) -> RoadElement:
        ends = (self._to_junction(street, street.begin), self._to_junction(street, street.end))
        several = max(station.lanes for station in street.stations) > 1
        name, marks = f"s{street.number}", "solid" if several else "broken"
        line, sections = self.town.stretches(street), self.sections[name]
        return RoadElement(self.roads[name], name, line, sections, 0.0, street.speed_m_s, *ends, marks=marks)

    def _to_junction(self, street: Street, end: StreetEnd) -> Link:
        return Link("junction", self.junctions[self.town.junction_at(street, end)], None, {})

    def _ring(self, ring: Ring) -> RoadElement:
        before, behind = (Link("junction", self.junctions[name], None, {}) for name in (ring.start, ring.end))
        (section,) = self.sections[ring.name]
        number, line, speed_m_s = self.roads[ring.name], [stretch_of(ring.lane)], ring.lane.speed_limit
        return RoadElement(number, ring.name, line, [section], self._aside(LANE_M), speed_m_s, before, behind)

    def _way(self, way: Way) -> RoadElement:
        """Return the road of a way: its reference line is the middle of the way."""
        section, at_end = self._where(way.start, leaves=True)
        width_m = section.widths[way.start.forwards][f"drive{way.start.lane}"][at_end]
        line = line_of(way, (self._heading(way.start, leaves=True), self._heading(way.end, leaves=False)))
        own = one_lane(sum(stretch.length_m for stretch in line), width_m, kerbed=way.kerbed)
        name = ">".join(way.road)
        ends = self._to_road(way.start, leaves=True), self._to_road(way.end, leaves=False)
        speed_m_s, junction = way.lanes[0].speed_limit, self.junctions[way.junction]
        return RoadElement(self.roads[way.road], name, line, [own], self._aside(width_m), speed_m_s, *ends, junction)

    def _aside(self, width_m: float) -> float:
        """Return how far to the left of a way's middle its lane begins, whose outer edge is where the kerb is."""
        return (width_m - LANE_M / 2) * self.town.inner_left

    def _where(self, lane: LaneEnd, *, leaves: bool) -> tuple[Section, bool]:
        """Return the section at which a way leaves a lane or comes to it, and whether that is at the road's end."""
        at_end = lane.forwards == leaves
        return self.sections[lane.road][-1 if at_end else 0], at_end

    def _heading(self, lane: LaneEnd, *, leaves: bool) -> float:
        """Return the direction of travel, rad, where a way leaves a lane or comes to it."""
        at_end = lane.forwards == leaves
        stretch = self.lines[lane.road][-1 if at_end else 0]
        heading_rad = float(stretch.heading(np.array([stretch.length_m if at_end else 0.0]))[0])
        return heading_rad if lane.forwards else heading_rad + np.pi

    def _to_road(self, lane: LaneEnd, *, leaves: bool) -> Link:
        section, at_end = self._where(lane, leaves=leaves)
        names = {"drive0": f"drive{lane.lane}", "walk": "walk"}
        numbers = {
            own: lane_number(section, lane.forwards, there, self.right_ahead) for own, there in names.items()
        }  # fmt: skip
        return Link("road", self.roads[lane.road], "end" if at_end else "start", numbers)

    def _put_junction(self, root: Element, name: str, numbers: Mapping[str, int]) -> None:
        junction = put(root, "junction", id=self.junctions[name], name=name, type="default")
        for number, way in enumerate(self.town.junctions[name]):
            here = self._to_road(way.start, leaves=True)
            attributes = {"incomingRoad": here.id, "connectingRoad": self.roads[way.road], "contactPoint": "start"}
            connection = put(junction, "connection", {"id": number, **attributes})
            own = one_lane(1.0, 1.0, kerbed=way.kerbed)
            for each in own.widths[True]:
                to = lane_number(own, True, each, self.right_ahead)
                put(connection, "laneLink", {"from": here.lanes[each], "to": to})
        for first, other in self.town.first_ways(name):
            put(junction, "priority", high=self.roads[first.road], low=self.roads[other.road])
        for group, number in numbers.items():
            if group.partition(" ")[0] == name:
                put(junction, "controller", id=number)
