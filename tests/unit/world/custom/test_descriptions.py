"""Places from descriptions in memory are those from files, bit by bit, and can be written as files."""

from dataclasses import fields, is_dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from coopsim.envs.simulated.scenario_file import SHIPPED, load_scenario_file, write_scenario_file
from coopsim.errors import InvalidValueError, UnknownNameError
from coopsim.world.custom.place import place_from
from coopsim.world.places.description import MapTree
from coopsim.world.places.layout import Layout
from coopsim.world.places.road_network import Lane, RoadNetwork
from coopsim.world.scenario import Place, make_scenario

VILLAGE = SHIPPED / "village.yaml"


def place_of(path: Path) -> Place:
    place = load_scenario_file(path).scenario
    assert isinstance(place, Place) and place.description is not None
    return place


def bits(value: Any) -> Any:
    """Return a value's content, arrays as bytes, for comparison."""
    if isinstance(value, np.ndarray):
        return value.shape, value.dtype.str, value.tobytes()
    if isinstance(value, dict):
        return [(bits(key), bits(item)) for key, item in value.items()]
    if isinstance(value, (tuple, list)):
        return [bits(item) for item in value]
    if isinstance(value, (RoadNetwork, Lane)):
        return bits(vars(value))
    return [bits(getattr(value, each.name)) for each in fields(value)] if is_dataclass(value) else repr(value)


def test_a_description_makes_the_place_of_its_file(tmp_path: Path) -> None:
    read = place_of(VILLAGE)
    assert read.description is not None
    made = place_from(read.description, "copy")
    assert made.name == "copy" and made.population == read.population and made.description == read.description
    written = write_scenario_file(tmp_path / "copy.yaml", read.description, seed=3, population={"vehicles": 2})
    again = load_scenario_file(written)
    assert again.keywords == {"seed": 3, "vehicles": 2}
    for place in (made, again.scenario):
        assert isinstance(place, Place)
        assert bits(place.make_layout()) == bits(read.make_layout())


def test_layouts_that_differ_have_other_bits() -> None:
    layout = place_of(VILLAGE).make_layout()
    assert isinstance(layout, Layout)
    description = place_of(VILLAGE).description
    assert description is not None
    *rest, church = description.buildings
    higher = replace(description, buildings=(*rest, replace(church, height_m=15)))
    assert bits(place_from(higher, "other").make_layout()) != bits(layout)


def test_names_that_look_like_numbers_stay_names(tmp_path: Path) -> None:
    path = tmp_path / "own.yaml"
    path.write_text(
        "place:\n  nodes: {010: [0, -2], no: [60, -2], 1e3: [60, 2], d: [0, 2]}\n  roads:\n"
        "    - {from: 010, to: no}\n    - {from: no, to: 1e3, turn: around}\n"
        "    - {from: 1e3, to: d}\n    - {from: d, to: 010, turn: around}\n"
    )
    read = place_of(path)
    assert read.description is not None
    copy = place_of(write_scenario_file(tmp_path / "copy.yaml", read.description))
    assert list(copy.make_layout().network.lanes) == list(read.make_layout().network.lanes)


def test_what_is_wrong_is_said_with_the_keys() -> None:
    description = place_of(VILLAGE).description
    assert description is not None
    roads = [replace(lane, width_m=-1) if k == 3 else lane for k, lane in enumerate(description.roads)]
    with pytest.raises(InvalidValueError, match=r"^roads\[3\]\.width_m: width_m must be in \[2.5, 8\], got -1$"):
        place_from(replace(description, roads=tuple(roads)), "wrong")
    with pytest.raises(InvalidValueError, match=r"^trees\[0\]\.at: at must be at least 2 m .* in roads\[0\]: it"):
        place_from(replace(description, trees=(MapTree((-50.0, -2.0)),)), "wrong")
    with pytest.raises(InvalidValueError, match=r"^nodes is missing in place"):
        place_from({"roads": []}, "wrong")
    with pytest.raises(UnknownNameError, match="unknown key 'lidar'"):
        write_scenario_file("never.yaml", description, lidar=None)


def test_furniture_of_a_file_does_not_depend_on_its_name(tmp_path: Path) -> None:
    one, other = tmp_path / "one.yaml", tmp_path / "other.yaml"
    for path in (one, other):
        path.write_text(VILLAGE.read_text())
    first, second = (make_scenario(place_of(path), detail="full") for path in (one, other))
    assert first.name != second.name and len(first.layout.furnishing) > 0
    assert bits(first.layout.furnishing) == bits(second.layout.furnishing)
