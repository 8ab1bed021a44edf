from __future__ import annotations

from typing import Any

import pytest

from coopsim.config.load import load
from coopsim.errors import CoopsimError, InvalidValueError, UnknownNameError
from coopsim.learn.clips.world_recipe import WorldRecipe


def world(**given: Any) -> WorldRecipe:
    made: WorldRecipe = load(WorldRecipe, given, "world")
    return made


def test_equal_recipes_are_written_alike() -> None:
    """Folders of clips know their source by this."""
    usual = WorldRecipe(dt_s=(0.1, 0.5), cars=(2, 3), start_s=(0.0, 25.0), lidars={"HDL-64E": 2.0})
    read = world(dt_s=[0.1, 0.5], cars=[2, 3], start_s=[0, 25], lidars={"HDL-64E": 2})
    assert read == usual and repr(read) == repr(usual)


@pytest.mark.parametrize("place", ["crossing", "urban_grid", "highway"])
def test_test_places_are_refused_with_the_reason(place: str) -> None:
    with pytest.raises(InvalidValueError, match="test place: results are measured"):
        WorldRecipe(environments=(place,))
    assert WorldRecipe(environments=(place,), allow_test_places=True).environments == (place,)


def test_shipped_files_and_test_sensors_are_refused() -> None:
    from coopsim.catalog import scenario_files

    with pytest.raises(InvalidValueError, match="shipped files"):
        WorldRecipe(environments=(scenario_files()[0],))
    with pytest.raises(InvalidValueError, match=r"VLP-16.*test sensor"):
        WorldRecipe(lidars={"VLP-16": 1.0})


@pytest.mark.parametrize(
    "wrong",
    [
        {"frames": 0},
        {"dt_s": ()},
        {"dt_s": (0.0,)},
        {"dt_s": 0.1},
        {"cars": (3, 1)},
        {"cars": (1.5, 2)},
        {"cars": (0, 2), "masts": (0, 1)},
        {"lidars": {}},
        {"lidars": {"HDL-32E": 0.0}},
        {"rain_share": 1.5},
        {"rain_mm_h": (0, 500)},
        {"fog_visibility_m": (1, 100)},
        {"environments": (3,)},
        {"junctions": 99},
        {"density": (float("nan"), 1.0)},
        {"first_place": -1},
        {"cameras": "surround"},
        {"cameras": {"front": 0.0}},
        {"camera_fov_deg": (90, 180)},
        {"camera_pitch_deg": (3, -3)},
        {"camera_above_m": (0.1, 200)},
        {"distorted_share": 2},
        {"times_of_day": {}},
    ],
)
def test_wrong_values_are_refused(wrong: dict[str, Any]) -> None:
    with pytest.raises(InvalidValueError):
        WorldRecipe(**wrong)


def test_misspelt_names_are_refused() -> None:
    with pytest.raises(UnknownNameError, match="frames"):
        world(frame=3)
    with pytest.raises(CoopsimError, match="HDL-32E"):
        WorldRecipe(lidars={"HDL-32": 1.0})
    with pytest.raises(UnknownNameError, match="surround_6"):
        WorldRecipe(cameras={"surround_5": 1.0})
    with pytest.raises(UnknownNameError, match="dusk"):
        WorldRecipe(times_of_day={"dawn": 1.0})
    with pytest.raises(UnknownNameError, match="town"):
        WorldRecipe(environments=("twon",))
