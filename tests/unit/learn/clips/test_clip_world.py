from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from helpers.clips import SMALL

from coopsim.errors import InvalidValueError
from coopsim.learn.clips.simulated import SimulatedClips
from coopsim.learn.clips.world import draw_world
from coopsim.learn.clips.world_recipe import WorldRecipe

_STREET = """
place:
  nodes: {a: [0, -2], b: [90, -2], c: [90, 2], d: [0, 2]}
  roads:
    - {from: a, to: b}
    - {from: b, to: c, turn: around}
    - {from: c, to: d}
    - {from: d, to: a, turn: around}
population: {pedestrians: 0}
"""


def test_changing_one_range_changes_nothing_else() -> None:
    one = draw_world(SMALL, 0, 7)
    other = draw_world(replace(SMALL, rain_share=1.0, dt_s=(0.5,), range_noise_m=(0.05, 0.05)), 0, 7)
    assert (one.scenario.place_seed, one.seed, one.start_s) == (other.scenario.place_seed, other.seed, other.start_s)
    assert one.scenario.population == other.scenario.population
    assert other.weather is not None and 0.5 <= other.weather.rain_mm_h <= 25 and 0 <= other.weather.wetness <= 1
    assert (other.dt_s, other.lidar.range_noise_m) == (0.5, 0.05)


def test_draws_are_in_the_ranges_and_as_frequent_as_asked() -> None:
    recipe = WorldRecipe(places=1, junctions=1, fog_share=0.5, rain_share=0.0)  # one place, which is drawn once
    worlds = [draw_world(recipe, 0, index) for index in range(200)]
    populations = [world.scenario.population for world in worlds]
    assert {world.scenario.place_seed for world in worlds} == {100_000}
    assert {each.connected for each in populations} == {1, 2, 3, 4}
    assert {each.rsus for each in populations} == {0, 1, 2}
    assert 0.08 < np.mean([each.drones for each in populations]) < 0.24
    assert 0.7 < np.mean([world.lidar.pattern == "HDL-32E" for world in worlds]) < 0.9
    assert all(0.01 <= world.lidar.range_noise_m <= 0.04 and 0 <= world.start_s <= 20 for world in worlds)
    fogs = [world.weather.fog_visibility_m for world in worlds if world.weather is not None]
    assert 70 < len(fogs) < 130 and min(fogs) >= 60 and max(fogs) <= 600 and np.median(fogs) < 260
    assert 0.15 < np.mean([world.scenario.detail == "plain" for world in worlds]) < 0.35
    assert len({world.seed for world in worlds}) == 200


def test_own_places_are_accepted_from_files_and_test_places_are_not(tmp_path: Path) -> None:
    path = tmp_path / "street.yaml"
    path.write_text(_STREET)
    recipe = WorldRecipe(environments=(str(path),), frames=1, cars=(2, 2), masts=(0, 0), drone_share=0, buses=(0, 0))
    clip = SimulatedClips(recipe).clip(0)
    assert [agent.name for agent in clip.scenes[0].agents] == ["cav_0", "cav_1"]
    path.write_text("scenario: crossing\n")
    with pytest.raises(InvalidValueError, match=r"street\.yaml must have a place of its own.*'crossing'"):
        SimulatedClips(recipe).clip(0)
