"""The asphalt covers every lane, and leaves no slit between two that touch."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from shapely import Point, Polygon, union_all

from coopsim.envs.simulated.scenario_file import SHIPPED, load_scenario_file
from coopsim.world.places.layout import lane_outline
from coopsim.world.places.road_network import CircularLane
from coopsim.world.scenario import SCENARIOS, Place, make_scenario

ISLAND_M2 = 10.0
"""Between the ways in and out of a roundabout there is green on purpose."""


@pytest.mark.parametrize("name", list(SCENARIOS))
def test_no_scenario_has_a_hole_in_its_asphalt(name: str) -> None:
    outlines = make_scenario(name).layout.road_map.lanes
    # Edges that are the same but for rounding still touch.
    surface = union_all([Polygon(outline).buffer(1e-6, join_style="mitre") for outline in outlines])
    holes = [Polygon(ring) for part in getattr(surface, "geoms", [surface]) for ring in part.interiors]
    assert not [hole.representative_point().coords[0] for hole in holes if hole.area < ISLAND_M2]


def test_kinks_of_a_road_from_a_file_leave_no_slit() -> None:
    place = load_scenario_file(SHIPPED / "village.yaml").scenario
    assert isinstance(place, Place)
    outlines = place.make_layout().road_map.lanes
    assert all(Polygon(outline).exterior.is_ccw for outline in outlines)
    surface = union_all([Polygon(outline) for outline in outlines]).buffer(1e-3)
    for kink in ((-60.0, -2.0), (-60.0, 2.0), (-110.0, 4.0), (-110.0, 8.0)):
        assert surface.covers(Point(kink).buffer(1.95))  # a lane is 4 m wide


@given(
    radius_m=st.floats(8.0, 60.0),
    start_rad=st.floats(-np.pi, np.pi),
    swept_rad=st.floats(0.3, np.pi),
    left=st.booleans(),
)
def test_an_outline_covers_its_bend(radius_m: float, start_rad: float, swept_rad: float, left: bool) -> None:
    end_rad = start_rad + (swept_rad if left else -swept_rad)
    lane = CircularLane([3.0, -2.0], radius_m, start_rad, end_rad, width=4.0)
    outlines = [Polygon(outline) for outline in lane_outline(lane)]
    assert all(outline.exterior.is_ccw for outline in outlines)
    along = np.linspace(0.0, lane.length, 500)
    edges = [[lane.position(s, side) for s in along] for side in (2.0, -2.0)]
    bend = Polygon([*edges[0], *edges[1][::-1]])
    assert union_all(outlines).buffer(1e-3).covers(bend)  # whose own edges are chords, too
    assert bend.buffer(0.1).covers(union_all(outlines))
