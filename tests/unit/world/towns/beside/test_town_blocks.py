from itertools import pairwise

import numpy as np
import pytest
from shapely import LineString, Point, Polygon, STRtree

from coopsim.world.places.layout import lane_outline
from coopsim.world.towns.beside.town_blocks import dress_streets
from coopsim.world.towns.drawn_place import draw_place
from coopsim.world.towns.streets.street_plan import draw_plan
from coopsim.world.towns.streets.town_options import TownOptions

BODY_M = 0.25  # half of a person
LEAST_M2 = 1e-3
LIMBER_M2 = 0.02  # where lanes bend, their outline of chords reaches a little over the kerb

PAIRS = (
    ("lane", "building wall trunk mast way"),
    ("way", "building wall trunk mast bay"),
    ("crosswalk", "building wall trunk mast bay"),
    ("building", "building wall crown mast bay"),
    ("wall", "wall trunk mast bay"),
    ("trunk", "bay mast trunk"),
    ("bay", "mast bay"),
)


@pytest.fixture(scope="module", params=[(seed, None) for seed in range(8)] + [(3, 0.0), (3, 1.0)], ids=str)
def town(request):
    seed, openness = request.param
    return draw_place(seed, TownOptions(openness=openness))


def strip(walks, pair):
    return LineString([walks["nodes"][name] for name in pair]).buffer(0.8 + BODY_M)


def bay(item):
    angle = np.radians(item["heading_deg"])
    ahead = np.array([np.cos(angle), np.sin(angle)])
    a, b = 3.0 * ahead, 1.1 * np.array([-ahead[1], ahead[0]])
    return Polygon(np.array(item["at"]) + np.array([-a - b, a - b, a + b, b - a]))


def shapes_of(town):
    """Return what stands in a town, and where people walk, by kind."""
    place, lanes = town.description, town.make_layout().network.lanes.values()
    walks, trees = place["walks"], place.get("trees", [])
    return {
        "lane": [Polygon(quad) for lane in lanes for quad in lane_outline(lane)],
        "way": [strip(walks, pair) for way in walks["ways"] for pair in pairwise(way)],
        "crosswalk": [strip(walks, pair) for pair in walks["crosswalks"]],
        "building": [Polygon(item["outline"]) for item in place["buildings"]],
        "wall": [LineString(item["along"]).buffer(0.125, cap_style="flat") for item in place.get("walls", [])],
        "trunk": [Point(item["at"]).buffer(0.2) for item in trees],
        "crown": [Point(item["at"]).buffer(0.47 * item["crown_m"]) for item in trees],
        "mast": [Point(item["at"]).buffer(0.12) for item in place["rsus"]],
        "bay": [bay(item) for item in place.get("parked", [])],
    }


def test_nothing_stands_in_something_else(town):
    shapes = shapes_of(town)
    assert shapes["lane"] and shapes["way"] and shapes["crosswalk"] and shapes["building"]
    for name, others in PAIRS:
        tree = STRtree(shapes[name])
        for other in others.split():
            for number, shape in enumerate(shapes[other]):
                for k in tree.query(shape):
                    if name == other and k >= number:
                        continue
                    shared_m2 = shapes[name][k].intersection(shape).area
                    assert shared_m2 < (LIMBER_M2 if "lane" in (name, other) else LEAST_M2 * 20), (name, other, number)


def test_town_has_a_mast_and_ways_and_buildings(town):
    layout = town.make_layout()
    assert layout.rsus
    assert layout.footways is not None
    assert layout.footways.crossing.any()
    assert town.description["buildings"]


def test_first_masts_look_at_the_meeting_junction(town):
    assert town.description["rsus"][0]["look_at"] == town.description["drones_around"]


def test_same_seed_gives_the_same_town():
    plan = draw_plan(5, TownOptions())
    assert dress_streets(plan, 5) == dress_streets(plan, 5)
    assert dress_streets(plan, 5)["buildings"] != dress_streets(plan, 6)["buildings"]
