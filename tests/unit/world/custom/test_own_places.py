"""A place of one's own: registered by name, written and read back equal; mistakes name the field."""

from __future__ import annotations

from dataclasses import replace
from importlib.metadata import EntryPoint
from pathlib import Path

import gymnasium
import numpy as np
import pettingzoo
import pytest

import coopsim
from coopsim.envs.simulated.scenario_file import load_scenario_file, write_scenario_file
from coopsim.errors import DuplicateNameError, InvalidValueError
from coopsim.world.custom.place import place_from
from coopsim.world.drawn_options import TownOptions
from coopsim.world.places.description import (
    MapArea,
    MapBay,
    MapBuilding,
    MapFurniture,
    MapHump,
    MapLane,
    MapPatch,
    MapStart,
    MapTree,
    MapUnit,
    MapWall,
    MapWays,
    PlaceDescription,
)
from coopsim.world.scenario import SCENARIOS, Place, ScenarioRegistry
from coopsim.world.towns.town import describe_town

STREET = PlaceDescription(
    nodes={"a": (0.0, -2.0), "b": (60.0, -2.0), "c": (60.0, 2.0), "d": (0.0, 2.0)},
    roads=(
        MapLane("a", "b"),
        MapLane("b", "c", turn="around"),
        MapLane("c", "d", speed_m_s=8),
        MapLane("d", "a", turn="around"),
    ),
)
FULL = replace(
    STREET,
    starts=(MapStart(("a", "b"), 9.0, ("c",), 1), MapStart(("c", "d"), 30.5)),
    cars_first=1,
    speeds_m_s=(0.0, 4.0, 8.0),
    walks=MapWays({"e": (5.0, 7.0), "f": (50.0, 7.0), "g": (50.0, -7.0)}, (("e", "f"),), (("f", "g"),)),
    rides=MapWays({"h": (5.0, 9.0), "k": (50.0, 9.0)}, (("h", "k", "h"),)),
    parked=(MapBay((20.0, -7.0), 180.0, "truck"),),
    buildings=(MapBuilding(((0.0, 20.0), (9.0, 20.0), (9.0, 30.0), (0.0, 30.0)), 7.5, "sage", True, "gable"),),
    walls=(MapWall(((0.0, 12.0), (30.0, 12.0)), 1.8, 0.3),),
    trees=(MapTree((40.0, 14.0), 8.0),),
    paved=(MapArea(((20.0, -12.0), (30.0, -12.0), (30.0, -5.0)), "parking"),),
    rsus=(MapUnit((30.0, 6.0), (30.0, 0.0)),),
    mast_m=6.5,
    drones_around=(10.0, 0.5),
    furniture=(
        MapFurniture("tree", (45.0, -12.0), 10.0, height_m=6.0, stem_m=1.5),
        MapFurniture("hedge", along=((0.0, -9.0), (9.0, -9.0)), thickness_m=0.6),
    ),
    kerb_m=0.1,
    crown=0.02,
    humps=(MapHump((30.0, 0.0), 0.0, 8.0, height_m=0.08),),
    wet=(MapPatch(((10.0, -3.0), (12.0, -3.0), (12.0, -2.0))),),
)


@pytest.mark.parametrize(
    "description", [STREET, FULL, describe_town(3, TownOptions(junctions=1))], ids=("little", "all", "town")
)
def test_a_description_is_read_back_equal_from_its_file(description: PlaceDescription, tmp_path: Path) -> None:
    place = load_scenario_file(write_scenario_file(tmp_path / "own.yaml", description)).scenario
    assert isinstance(place, Place)
    assert place.description == description and place.description.identity == description.identity
    assert len(place.make_layout().static) == len(place_from(description, "own").make_layout().static)


def test_numpys_numbers_and_lists_are_taken() -> None:
    nodes = {name: list(np.array(at)) for name, at in STREET.nodes.items()}
    assert place_from(replace(STREET, nodes=nodes), "own").description == STREET  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("roads", "message"),
    [
        ({0: MapLane("a", "b", width_m=-3)}, r"^roads\[0\]\.width_m: width_m must be in \[2.5, 8\], got -3$"),
        ({0: MapLane("a", "z")}, r"^roads\[0\]\.to: unknown node 'z'.* Accepted: a, b, c, d$"),
        (
            {2: MapLane("c", "d", left=("a", "z"))},
            r"^roads\[2\]\.left: left must be a road, got \[a, z\]. Accepted: \[",
        ),
        (
            {0: MapLane("a", "b", left=("c", "d")), 2: MapLane("c", "d", right=("d", "a"))},
            r"^roads\[0\]\.left: left must be a road that has this one as its other neighbour, \[a, b\], got one with",
        ),
        ({0: MapLane("a", "b", widths_m=(3, 4, 3))}, r"^roads\[0\]\.widths_m: widths_m must be 2 numbers"),
        (
            {0: MapLane("a", "b", widths_m=(3, 9))},
            r"^roads\[0\]\.widths_m\[1\]: widths_m must be in \[2.5, 8\], got 9$",
        ),
        ({1: MapLane("b", "c", turn="round")}, r"^roads\[1\]\.turn: unknown turn 'round'. Did you mean 'around'"),
    ],
)
def test_a_mistake_in_a_lane_names_its_field(roads: dict[int, MapLane], message: str) -> None:
    lanes = tuple(roads.get(k, lane) for k, lane in enumerate(STREET.roads))
    with pytest.raises(InvalidValueError, match=message):
        place_from(replace(STREET, roads=lanes), "own")


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"starts": (MapStart(("a", "b"), 61.0),)}, r"^starts\[0\]\.at_m: at_m must be in \[0, 60\], got 61$"),
        ({"starts": (MapStart(("b", "d"), 1.0),)}, r"^starts\[0\]\.road: road must be a road, got \[b, d\]"),
        ({"cars_first": -1}, r"^cars_first: cars_first must be .* >= 0, got -1$"),
        ({"humps": (MapHump((30.0, 30.0), 0.0, 8.0),)}, r"^humps\[0\]\.at: a hump must be on a road$"),
        (
            {"paved": (MapArea(((0, 9), (9, 9), (9, 12)), "sand"),)},
            r"^paved\[0\]\.kind: unknown kind 'sand'.* Accepted",
        ),
        ({"furniture": (MapFurniture("lamp", (9.0, 9.0), 0.0, stem_m=1.0),)}, r"unknown key in furniture 'stem_m'"),
        ({"furniture": (MapFurniture("lamp", (9.0, 9.0)),)}, r"^furniture\[0\]: heading_deg is missing in furniture"),
        ({"roads": 3}, r"^roads: roads must be a list, got 3$"),
    ],
)
def test_a_mistake_elsewhere_names_its_field(change: dict[str, object], message: str) -> None:
    with pytest.raises(InvalidValueError, match=message):
        place_from(replace(STREET, **change), "own")  # type: ignore[arg-type]


def test_a_piece_of_lane_is_as_wide_as_its_narrower_end() -> None:
    narrowing = MapLane("a", "b", via=((20.0, -2.0), (40.0, -2.0)), widths_m=(4, 4, 3, 3.5))
    layout = place_from(replace(STREET, roads=(narrowing, *STREET.roads[1:])), "own").make_layout()
    widths_m = [lane.width for index, lane in layout.network.lanes.items() if lane.length == 20.0]
    assert widths_m == [4, 3, 3]


def test_neighbours_are_kept() -> None:
    nodes = {**STREET.nodes, "e": (0.0, -6.0), "f": (60.0, -6.0)}
    beside = MapLane("e", "f", left=("a", "b"))
    roads = (replace(STREET.roads[0], right=("e", "f")), *STREET.roads[1:], beside, MapLane("f", "c", turn="around"))
    roads = (*roads, MapLane("d", "e", turn="around"))
    found = place_from(replace(STREET, nodes=nodes, roads=roads), "own").description
    assert found is not None and found.roads[0].right == ("e", "f") and found.roads[4].left == ("a", "b")


@pytest.fixture
def fresh_registries(monkeypatch: pytest.MonkeyPatch) -> None:
    """Forget what a test registers: other tests count environments."""
    for registry in (SCENARIOS, coopsim.ENVIRONMENTS):
        registry.names()
        monkeypatch.setattr(registry, "_entries", dict(registry._entries))
    for known in (gymnasium.registry, pettingzoo.parallel_registry):
        monkeypatch.setitem(known, "coopsim/own_street-v3", None)
        del known["coopsim/own_street-v3"]


@pytest.mark.usefixtures("fresh_registries")
def test_a_registered_place_is_an_environment() -> None:
    asked = []

    def describe() -> PlaceDescription:
        asked.append(1)
        return STREET

    coopsim.register_place("own_street", describe)
    assert not asked, "it is built when it is used"
    env = coopsim.parallel_env("own_street", max_cycles=3)
    env.reset(seed=1)
    assert env.agents and SCENARIOS.get("own_street").description == STREET and asked == [1]
    with pytest.raises(DuplicateNameError, match="own_street"):
        coopsim.register_place("own_street", STREET)
    with pytest.raises(DuplicateNameError, match="file-v3"):
        coopsim.register_place("file", STREET)
    with pytest.raises(InvalidValueError, match=r"place must be a PlaceDescription, or a function .* got dict"):
        coopsim.register_place("other", {"nodes": {}})  # type: ignore[arg-type]


def test_packages_add_places_by_entry_points(monkeypatch: pytest.MonkeyPatch) -> None:
    registry = ScenarioRegistry("scenario", group="coopsim.places")
    points = (
        EntryPoint("street", f"{__name__}:STREET", "coopsim.places"),
        EntryPoint("number", f"{__name__}:test_neighbours_are_kept", "coopsim.places"),
    )
    monkeypatch.setattr(registry, "_points", points)
    assert registry.names() == ("number", "street")
    assert registry.get("street").description == STREET and registry.get("street") is registry.get("street")
    with pytest.raises(InvalidValueError, match=r"scenario 'number' must be a PlaceDescription, .* got NoneType"):
        registry.get("number")
