"""Situations that users write: numbers are drawn from their ranges, and a mistake gives one line that says where."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import coopsim
from coopsim.envs.simulated.scenario_file import load_scenario_file
from coopsim.errors import ScenarioFileError
from coopsim.world.scenario import Scenario
from coopsim.world.world import World

NAMED = """\
scenario: parking_street
situation:
  name: occluded_pedestrian
  speed_m_s: [8, 10]
  penetration: 0.3
options:
  lidar: null
"""
ROLES = """\
scenario: crossing
situation:
  over_s: 9
  penetration: 1
  ego: {from: [-70, -2], to: [60, -2], speed_m_s: [8, 12]}
  vehicles:
    - {name: runner, from: [-2, 100], to: [-2, -60], speed_m_s: [9, 13], manner: unyielding, meets_s: [0.1, 0.3]}
    - {name: van, at: [-14, -5.2], label: van, manner: parked}
    - {name: oncoming, from: [70, 2], to: [-2, -40], speed_m_s: 8}
  people:
    - {name: walker, path: [[40, -12], [40, 8]], speed_m_s: 1.5, meets_s: [0.1, 0.5]}
options:
  lidar: null
"""


def write(folder: Path, text: str) -> Path:
    path = folder / "own.yaml"
    path.write_text(text, encoding="utf-8")
    return path


def scenario(path: Path, seed: int) -> Scenario:
    file = load_scenario_file(path)
    assert file.situation is not None
    own = {name: value for name, value in file.keywords.items() if name not in ("lidar", "seed")}
    return file.situation(**own).of(seed)


def test_a_registered_situation_takes_ranges_from_a_file(tmp_path: Path) -> None:
    scripts = [scenario(write(tmp_path, NAMED), seed).script for seed in range(8)]
    speeds = [script.ego.speed_m_s for script in scripts if script is not None]
    assert len(set(speeds)) == 8 and all(8 <= speed <= 10 for speed in speeds)
    env = coopsim.parallel_env(tmp_path / "own.yaml")
    assert env.possible_agents == ["cav_0", "cav_1", "cav_2"]
    env.close()


def test_roles_meet_the_ego_when_the_file_says(tmp_path: Path) -> None:
    path = write(tmp_path, ROLES)
    for seed in range(6):
        found = scenario(path, seed)
        made = World(found, seed, control="acceleration", driven=("cav_0",))
        ego = made.agents()["cav_0"].actor_id
        while ego not in made.crashed():
            made.step(0.1, {"cav_0": 0.0})
        actors = made.actors()
        places = dict(zip(actors.id.tolist(), actors.boxes.center[:, :2], strict=True))
        near = {other: float(np.hypot(*(places[other] - places[ego]))) for other in made.conflict_ids}
        assert min(near, key=lambda other: near[other]) == made.conflict_ids[0], "the runner comes before the walker"
        assert min(near.values()) < 6
    again = scenario(path, 5).script
    assert again is not None and found.script is not None
    assert again.vehicles == found.script.vehicles
    env = coopsim.parallel_env(path)
    assert env.possible_agents == ["cav_0", "cav_1", "cav_2"], "all cars that move"
    env.close()


@pytest.mark.parametrize(
    ("old", "new", "line", "words"),
    [
        ("occluded_pedestrian", "ocluded_pedestrian", 3, "Did you mean 'occluded_pedestrian'"),
        ("[8, 10]", "fast", 4, "speed_m_s must be a finite number"),
        ("[8, 10]", "[10, 8]", 4, "speed_m_s must be"),
        ("speed_m_s", "sped_m_s", 4, "Did you mean 'speed_m_s'"),
        ("0.3", "3", 5, "penetration must be in"),
        ("options:\n", "population: {vehicles: 3}\noptions:\n", 6, "population must be left out"),
        ("scenario: parking_street", "scenario: highway", None, "there is none in 'highway'"),
    ],
)
def test_a_mistake_in_a_registered_one(tmp_path: Path, old: str, new: str, line: int | None, words: str) -> None:
    expect_error(write(tmp_path, NAMED.replace(old, new)), line, words)


@pytest.mark.parametrize(
    ("old", "new", "line", "words"),
    [
        ("[-70, -2]", "[-70, -20]", 5, "from must be within"),
        ("unyielding", "rude", 7, "unknown manner 'rude'"),
        ("label: van", "label: vn", 8, "Did you mean 'van'"),
        ("[[40, -12], [40, 8]]", "[[40, -12]]", 11, "path must be at least 2 points"),
        ("[[40, -12], [40, 8]]", "[[40, -12], [40, -9]]", 11, "meets_s needs a way that meets the ego's"),
        ("ego:", "eggo:", 5, "Did you mean 'ego'"),
        ("scenario: crossing", "scenario: town", 1, "always the same"),
        ("over_s: 9", "over_s: -1", 3, "over_s must be in"),
        ("speed_m_s: 8}", "speed_m_s: -8}", 9, "speed_m_s must be at least 0"),
    ],
)
def test_a_mistake_in_a_role(tmp_path: Path, old: str, new: str, line: int, words: str) -> None:
    expect_error(write(tmp_path, ROLES.replace(old, new)), line, words)


def expect_error(path: Path, line: int | None, words: str) -> None:
    with pytest.raises(ScenarioFileError) as caught:
        coopsim.parallel_env(path)
    text = str(caught.value)
    assert text.startswith(f"{path}:{line}: " if line else f"{path}: ")
    assert words in text and "\n" not in text
