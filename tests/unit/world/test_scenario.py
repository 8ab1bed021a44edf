"""What is asked for is checked, and the message says what is accepted."""

from typing import Any

import pytest

from coopsim.errors import InvalidValueError, UnknownNameError
from coopsim.world.scenario import make_scenario


@pytest.mark.parametrize(
    ("numbers", "message"),
    [
        ({"connected_cars": 9, "vehicles": 10}, r"at most the number of cars, which is 8 \(10 vehicles less 2 trucks"),
        ({"vehicles": -1}, "vehicles must be an integer >= 0, got -1"),
        ({"pedestrians": -3}, "pedestrians must be an integer >= 0, got -3"),
        ({"rsus": 1.5}, "rsus must be an integer >= 0, got 1.5"),
        ({"truck_share": 1.2}, r"truck_share must be in \[0, 1\], got 1.2"),
        ({"connected_cars": 0, "rsus": 0}, "at least one agent"),
        ({"vehicles": 1000}, r"vehicles must be at most \d+ in 'highway', got 1000"),
        ({"rsus": 5}, "rsus must be at most 4 in 'highway', got 5"),
        ({"pedestrians": 1}, "pedestrians must be at most 0 in 'highway', got 1"),
    ],
)
def test_bad_number(numbers: dict[str, Any], message: str) -> None:
    with pytest.raises(InvalidValueError, match=message):
        make_scenario("highway", **numbers)


@pytest.mark.parametrize(
    ("name", "numbers", "message"),
    [
        ("crosing", {}, "unknown scenario 'crosing'. Did you mean 'crossing'"),
        (
            "crossing",
            {"pedestrian": 2},
            "unknown number of scenario 'crossing' 'pedestrian'. Did you mean 'pedestrians'",
        ),
    ],
)
def test_unknown_name_comes_with_a_suggestion(name: str, numbers: dict[str, Any], message: str) -> None:
    with pytest.raises(UnknownNameError, match=message):
        make_scenario(name, **numbers)


def test_a_full_place_is_accepted_and_one_more_is_not() -> None:
    layout = make_scenario("crossing").layout
    assert layout.footways is not None and 100 < layout.footways.room < 1000
    for name, room in {"vehicles": len(layout.slots), "pedestrians": layout.footways.room}.items():
        assert getattr(make_scenario("crossing", **{name: room}).population, name) == room
        with pytest.raises(InvalidValueError, match=f"{name} must be at most {room}"):
            make_scenario("crossing", **{name: room + 1})
