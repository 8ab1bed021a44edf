"""Drawn towns work as any scenario works: which place an episode is in, files, recordings, vectors, and memory."""

from __future__ import annotations

import gc
import os
from pathlib import Path
from typing import Any

import numpy as np
import psutil
import pytest
from test_environments import Make, assert_same, play

import coopsim
from coopsim.errors import InvalidValueError, RecordingError, ScenarioFileError, UnknownNameError
from coopsim.viz.portrait import write_picture
from coopsim.world.drawn_options import TownOptions
from coopsim.world.recording.episode_file import Episode
from coopsim.world.scenario import make_scenario
from coopsim.world.towns.scenarios import draw_town, write_town

SMALL_TOWN: dict[str, Any] = {"junctions": 1, "lanes": 1}


def history(env: Any, seed: int) -> list[Any]:
    return [dict(enumerate(step)) for step in play(env, seed)]


def place_seeds(env: Any, *seeds: int) -> list[int]:
    return [env.reset(seed=seed)[1]["cav_0"]["place_seed"] for seed in seeds]


def outline(env: Any) -> list[bytes]:
    return [polygon.tobytes() for polygon in env.road_map.lanes]


def test_an_episode_is_in_the_place_of_its_seed_or_in_the_one_that_is_held(make_small: Make) -> None:
    drawn = make_small("town", lidar=None, **SMALL_TOWN)
    held = make_small("town", lidar=None, place_seed=1, **SMALL_TOWN)
    assert place_seeds(drawn, 2, 1) == [2, 1] and place_seeds(held, 2, 1) == [1, 1]
    assert_same(dict(enumerate(play(drawn, 1)[-1])), dict(enumerate(play(held, 1)[-1])))
    there, here = drawn.reset(seed=2)[0]["cav_0"]["pose"], held.reset(seed=2)[0]["cav_0"]["pose"]
    assert outline(drawn) != outline(held) and not np.array_equal(there, here)
    again = held.reset(seed=3)[0]["cav_0"]["pose"]
    assert not np.array_equal(again, here), "traffic changes while the place is held"


def test_a_set_of_places_and_no_other(make_small: Make) -> None:
    env = make_small("town", lidar=None, place_seed=range(7, 9), **SMALL_TOWN)
    assert place_seeds(env, 0, 1, 2) == [7, 8, 7]
    assert {info["place_seed"] for info in env.reset(seed=1)[1].values()} == {8}


def test_what_shows_the_place_follows_it(make_small: Make) -> None:
    env = make_small("town", lidar=None, render_mode="rgb_array", **SMALL_TOWN)
    pictures, maps = [], []
    for seed in (1, 2, 1):
        env.reset(seed=seed)
        pictures.append(env.render())
        maps.append(outline(env))
    assert np.array_equal(pictures[0], pictures[2]) and not np.array_equal(pictures[0], pictures[1])
    assert maps[0] == maps[2] != maps[1]


def test_a_town_in_a_file_has_the_same_episodes(make_small: Make, tmp_path: Path) -> None:
    options = TownOptions(junctions=1)
    path = write_town(tmp_path / "town.yaml", draw_town(2, options))
    drawn = coopsim.parallel_env("town", place_seed=2, junctions=1, lidar="VLP-16", lidar_columns=64, max_cycles=3)
    read = coopsim.parallel_env(path, lidar="VLP-16", lidar_columns=64, max_cycles=3)
    of_drawn, of_read = history(drawn, 4), history(read, 4)
    for step in (of_drawn[0][1], of_read[0][1]):
        for infos in step.values():
            infos.pop("place_seed", None)
    for a, b in zip(of_drawn, of_read, strict=True):
        assert_same(a, b)


def test_a_recording_carries_its_place(make_small: Make, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = coopsim.record("town", tmp_path / "run", seed=4, place_seed=2, junctions=1, max_cycles=3)
    header = Episode(path).header
    assert (header.scenario, header.detail, header.place_seed) == ("town", "full", 2)
    sensed = {"lidar": "VLP-16", "lidar_columns": 64, "max_cycles": 3}
    live = history(coopsim.parallel_env("town", place_seed=2, junctions=1, **sensed), 4)
    monkeypatch.delattr("coopsim.world.towns.scenarios.draw_place")
    for a, b in zip(live, history(coopsim.parallel_env("town", playback=path, **sensed), 4), strict=True):
        assert_same(a, b)
    with pytest.raises(InvalidValueError, match="junctions must be left out with playback"):
        coopsim.parallel_env("town", playback=path, junctions=1)
    with pytest.raises(InvalidValueError, match=r"detail must be 'full', as .* was recorded, got 'plain'"):
        coopsim.parallel_env("town", playback=path, detail="plain")
    with pytest.raises(RecordingError, match="accepted here: 'crossing', or 'town', which plays all recordings that"):
        coopsim.parallel_env("crossing", playback=path)


def test_a_recording_of_any_described_place_is_played_as_a_town(tmp_path: Path) -> None:
    path = coopsim.record("village.yaml", tmp_path / "run", max_cycles=2)
    env = coopsim.parallel_env("town", playback=path, lidar=None)
    _, infos = env.reset(seed=0)
    assert "place_seed" not in infos["cav_0"] and Episode(path).header.detail == "plain"
    old = coopsim.record("crossing", tmp_path / "old", max_cycles=2)
    with pytest.raises(RecordingError, match="was recorded in 'crossing'; accepted here: 'town'"):
        coopsim.parallel_env("town", playback=old)


def test_a_vector_draws_the_places_that_one_environment_draws() -> None:
    options = {**SMALL_TOWN, "lidar": None, "detector": "simulated", "max_cycles": 2}
    with coopsim.vector("town", 2, workers=0, **options) as vector:
        together, infos = vector.reset(seed=[1, 2])
        assert [each["cav_0"]["place_seed"] for each in infos] == [1, 2]
        together = [{agent: dict(each) for agent, each in env.items()} for env in together]
    alone = coopsim.parallel_env("town", **options)
    for index, seed in enumerate((1, 2)):
        assert_same(together[index], alone.reset(seed=seed)[0])


def test_one_agent_that_learns_meets_all_places() -> None:
    env = coopsim.single_env("town", lidar=None, max_cycles=2, **SMALL_TOWN)
    assert [env.reset(seed=seed)[1]["place_seed"] for seed in (1, 2)] == [1, 2]


def test_detail_is_plain_or_full(make_small: Make) -> None:
    env = make_small("town", detail="plain", **SMALL_TOWN)
    plain, full = (make_scenario("crossing", detail=detail) for detail in ("plain", "full"))
    assert len(full.static) > len(plain.static) == len(plain.layout.static) and len(full.models) > len(plain.models)
    assert full.models[: len(plain.models)] == plain.models
    few, many = (make_small("town", detail=detail, **SMALL_TOWN).reset(seed=1)[0] for detail in ("plain", "full"))
    assert not np.array_equal(few["cav_0"]["sweeps"]["lidar"], many["cav_0"]["sweeps"]["lidar"])
    assert_same(few, env.reset(seed=1)[0])
    with pytest.raises(UnknownNameError, match="unknown detail 'fine'"):
        make_small("crossing", detail="fine")


def test_a_scenario_file_names_towns_and_their_options(tmp_path: Path) -> None:
    path = tmp_path / "towns.yaml"
    path.write_text("scenario: town\noptions: {place_seed: 3-4, junctions: 1, lidar: null}\n")
    assert place_seeds(coopsim.parallel_env(path), 0, 1) == [3, 4]
    assert place_seeds(coopsim.parallel_env(path, place_seed=6), 0) == [6]
    run = coopsim.record(path, tmp_path / "run", seed=1, max_cycles=1)
    assert Episode(run).header.place_seed == 4
    path.write_text("scenario: town\noptions:\n  lidar: null\n  junctions: 0\n")
    with pytest.raises(ScenarioFileError, match=r"towns.yaml:4: junctions must be an integer in 1..9, got 0"):
        coopsim.parallel_env(path)
    path.write_text("scenario: crossing\noptions:\n  place_seed: 3\n")
    with pytest.raises(ScenarioFileError, match=r"towns.yaml:3: place_seed is an option of 'town'"):
        coopsim.parallel_env(path)


@pytest.mark.parametrize("name", ["place_seed", "junctions", "openness", "lanes"])
def test_options_of_towns_are_told_from_typos(name: str) -> None:
    with pytest.raises(InvalidValueError, match=f"{name} is an option of 'town', .* 'crossing' is always the same"):
        coopsim.parallel_env("crossing", **{name: 1})
    with pytest.raises(
        InvalidValueError, match="which draws places, and must be left out: the place of a file is fixed"
    ):
        coopsim.parallel_env("village.yaml", **{name: 1})


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"place_seed": -1}, "place_seed must be an integer >= 0, a range"),
        ({"openness": 1.5}, r"openness must be in \[0, 1\], got 1.5"),
        ({"lanes": 4}, "lanes must be an integer in 1..3, got 4"),
        ({"place_sed": 1}, "unknown option 'place_sed'. Did you mean 'place_seed'"),
    ],
)
def test_wrong_options_are_refused_before_the_first_episode(options: dict[str, Any], message: str) -> None:
    with pytest.raises((InvalidValueError, UnknownNameError), match=message):
        coopsim.parallel_env("town", **options)


def test_pictures_and_files_with_wrong_names_are_refused(tmp_path: Path) -> None:
    town = make_scenario("crossing")
    with pytest.raises(InvalidValueError, match=r"picture must end in .png, .jpg, .jpeg, got '.*town.gif'"):
        write_picture(tmp_path / "town.gif", town, 0)
    with pytest.raises(InvalidValueError, match="town must be a scenario with a description, got 'crossing'"):
        write_town(tmp_path / "town.yaml", town)


def test_memory_does_not_grow_from_place_to_place(make_small: Make) -> None:
    env, process = make_small("town", lidar=None, max_cycles=1, **SMALL_TOWN), psutil.Process(os.getpid())
    resident = []
    for seed in range(12):
        env.reset(seed=seed)
        if seed % 6 == 5:
            gc.collect()
            resident.append(process.memory_info().rss)
    assert resident[1] - resident[0] < 20e6, "a place has about 10 MB"
