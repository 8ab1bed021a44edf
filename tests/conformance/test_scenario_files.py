"""Scenarios as files: what comes along can be played, and what is wrong is said with the file and the line."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import coopsim
from coopsim.cli import main
from coopsim.envs.simulated.scenario_file import SHIPPED
from coopsim.errors import InvalidValueError, ScenarioFileError
from coopsim.world.recording.episode_file import Episode


def write(folder: Path, text: str) -> Path:
    path = folder / "own.yaml"
    path.write_text(text)
    return path


@pytest.mark.parametrize("name", sorted(path.name for path in SHIPPED.glob("*.yaml")))
def test_shipped_files_can_be_played(name: str) -> None:
    env = coopsim.parallel_env(name, max_cycles=2)
    policy = coopsim.make_policy("no_fusion")
    observations, _ = env.reset(seed=0)
    policy.reset(env.agent_specs)
    while env.agents:
        observations, *_ = env.step(policy.act(observations))
    assert env.score().table()


def test_a_file_says_the_same_as_keywords(tmp_path: Path) -> None:
    path = write(
        tmp_path, "scenario: t_junction\npopulation: {vehicles: 6, connected_cars: 2}\noptions: {lidar: VLP-16}"
    )
    options: dict[str, Any] = {"vehicles": 6, "connected_cars": 2, "lidar": "VLP-16"}
    file, keywords = coopsim.parallel_env(path), coopsim.parallel_env("t_junction", **options)
    for env in (file, keywords):
        env.reset(seed=4)
    assert (file.state() == keywords.state()).all()
    assert file.possible_agents == keywords.possible_agents


def test_paths_are_relative_to_the_file_that_has_them(tmp_path: Path) -> None:
    """A scenario's channel, and that channel's measured delays, wherever the command runs."""
    (tmp_path / "radio").mkdir()
    (tmp_path / "radio" / "delays.csv").write_text("delay_s\n0.25\n0.25\n")
    (tmp_path / "radio" / "channel.yaml").write_text("latency: {model: empirical, path: delays.csv}")
    (tmp_path / "gnss.yaml").write_text("pose: {position_noise_m: 0.5}")
    path = write(
        tmp_path, "scenario: crossing\noptions: {channel: radio/channel.yaml, localization: gnss.yaml, lidar: VLP-16}"
    )
    options = coopsim.parallel_env(path)._options
    assert options.channel_config.latency.samples_s == (0.25, 0.25)
    (tmp_path / "beams.csv").write_text("elevation_deg\n1\n-5\n")
    for lidar in ("beams.csv", "{pattern: beams.csv}", "{front: {pattern: beams.csv}}"):
        env = coopsim.parallel_env(write(tmp_path, f"scenario: crossing\noptions: {{lidar: {lidar}}}"))
        (config,) = env._source._options.lidars.values()
        assert len(config.beams.elevation_rad) == 2
    here = write(tmp_path, "scenario: crossing\noptions: {channel: nowhere.yaml}")
    with pytest.raises(ScenarioFileError, match=r"own.yaml:2: channel: cannot read nowhere.yaml"):
        coopsim.parallel_env(here)


def test_lidars_have_names_in_a_file(tmp_path: Path) -> None:
    path = write(tmp_path, "scenario: crossing\noptions: {lidar: {roof: OS1-128, front: VLP-16}}")
    assert list(coopsim.parallel_env(path)._source._options.lidars) == ["roof", "front"]


def test_errors_about_a_channels_file_name_that_file(tmp_path: Path) -> None:
    (tmp_path / "channel.yaml").write_text("loss:\n  model: bernoulli\n  probability: 2\n")
    path = write(tmp_path, "scenario: crossing\noptions: {channel: channel.yaml}")
    with pytest.raises(InvalidValueError, match=r"^\S+channel.yaml:3: channel loss: probability must be in \[0, 1\]"):
        coopsim.parallel_env(path)


def test_keywords_go_before_the_file(tmp_path: Path) -> None:
    path = write(tmp_path, "scenario: crossing\npopulation: {rsus: 1}\n")
    assert "rsu_2" in coopsim.parallel_env(path, rsus=3).possible_agents


@pytest.mark.parametrize("given", [{"connected_cars": 6}, {"penetration": 0.25}])
def test_connected_cars_by_number_go_before_the_files_share_and_the_other_way_round(
    tmp_path: Path, given: dict[str, Any]
) -> None:
    said = "penetration: 0.9" if "connected_cars" in given else "connected_cars: 1"
    path = write(tmp_path, f"scenario: crossing\npopulation: {{vehicles: 24, trucks: 0, rsus: 0, {said}}}\n")
    assert len(coopsim.parallel_env(path, **given, lidar=None).possible_agents) == 6
    recorded = Episode(coopsim.record(path, tmp_path / "run", max_cycles=1, **given)).header.agents
    assert len(recorded) == 6
    played = coopsim.parallel_env(path, playback=tmp_path / "run", lidar=None)
    assert len(played.possible_agents) == 6


def test_a_file_has_a_seed_of_its_own_where_nobody_gives_one(tmp_path: Path) -> None:
    path = write(tmp_path, "scenario: crossing\nseed: 7\noptions: {lidar: null}\n")
    assert Episode(coopsim.record(path, tmp_path / "run", max_cycles=1)).header.seed == 7
    env = coopsim.parallel_env(path)
    states = []
    for seed in (None, None, 7, 8):
        env.reset(seed=seed)
        states.append(env.state())
    assert np.array_equal(states[0], states[1]) and np.array_equal(states[0], states[2])
    assert not np.array_equal(states[0], states[3])
    scores = [coopsim.evaluate("no_fusion", path, max_cycles=3, **given).score for given in ({}, {"seed": 7})]
    assert scores[0].to_dict() == scores[1].to_dict()


def test_a_recording_of_a_file_is_played_with_it_whatever_became_of_its_numbers(tmp_path: Path) -> None:
    path = write(tmp_path, "scenario: crossing\ndensity: 0.5\npopulation: {vehicles: 20, pedestrians: 6}\n")
    coopsim.record(path, tmp_path / "run", max_cycles=1)
    env = coopsim.parallel_env(path, playback=tmp_path / "run", lidar=None)
    env.reset(seed=0)
    assert len(env.state()) == 13


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("scenario: crosing\n", r"own.yaml:1: unknown scenario 'crosing'. Did you mean 'crossing'"),
        ("population: {vehicles: 3}\n", r"own.yaml:1: scenario is missing"),
        ("scenario: crossing\n\nplaces: 3\n", r"own.yaml:3: unknown key 'places'"),
        (
            "scenario: crossing\npopulation:\n  vehicels: 3\n",
            r"own.yaml:3: unknown key in population 'vehicels'. Did you mean 'vehicles'",
        ),
        (
            "scenario: crossing\npopulation:\n  vehicles: many\n",
            r"own.yaml:3: vehicles must be an integer >= 0, got 'many'",
        ),
        ("scenario: crossing\nseed: -1\n", r"own.yaml:2: seed must be an integer >= 0, got -1"),
        ("scenario: crossing\noptions: {seed: 1}\n", r"own.yaml:2: seed belongs to the top of the file"),
        ("scenario: crossing\ndensity: -1\n", r"own.yaml:2: density must be a finite number >= 0, got -1"),
        ("scenario: crossing\npopulation: 3\n", "own.yaml:2: population: expected keys and values"),
        (
            "scenario: crossing\noptions:\n  weather: {rain: 3}\n",
            r"own.yaml:3: unknown weather option 'rain'. Did you mean 'rain_mm_h'",
        ),
        (
            "scenario: crossing\noptions:\n  weather: {wetness: 3}\n",
            r"own.yaml:3: weather: wetness must be in \[0, 1\]",
        ),
        ("scenario: crossing\noptions:\n  lidar: {patern: VLP-16}\n", r"own.yaml:3: unknown lidar option 'patern'"),
        (
            "scenario: crossing\noptions:\n  lidar:\n    roof: OS1-128\n    front:\n      colums: 64\n",
            r"own.yaml:6: unknown lidar 'front' option 'colums'. Did you mean 'columns'",
        ),
        (
            "scenario: crossing\noptions:\n  lidar: {front: {columns: 0}}\n",
            r"own.yaml:3: lidar 'front': columns must be an integer in 1..16384, got 0",
        ),
        ("scenario: crossing\noptions:\n  lidar: {columns: 0}\n", r"own.yaml:3: lidar: columns must be an integer"),
        ("scenario: crossing\noptions:\n  lidar: VLP\n", r"own.yaml:3: unknown lidar 'VLP'. Did you mean 'VLP-16'"),
        ("scenario: crossing\noptions:\n  threads: 0\n  lidar: {columns: 64}\n", r"own.yaml:3: threads must be"),
        ("scenario: crossing\noptions:\n  threads: 2\n  lidar: {columns: 0}\n", r"yaml:4: (lidar: )?columns must be"),
        ("scenario: crossing\noptions:\n  loss: 0.1\n  loss: 0.2\n", r"own.yaml:4: loss is there twice"),
        ("scenario: [crossing\n", r"own.yaml:2: this is no YAML"),
        ("scenario: !!python/name:os.system\n", r"own.yaml:1: this is no YAML"),
        (
            "scenario: highway\npopulation: {vehicles: 2, connected_cars: 3}\n",
            r"own.yaml:2: connected_cars must be at most",
        ),
        (
            "scenario: crossing\npopulation:\n  connected_cars: 2\n  penetration: 0.1\n",
            r"own.yaml:4: penetration takes the place of connected_cars",
        ),
        ("scenario: crossing\nbuses: 2\n", r"own.yaml:2: buses belongs below population"),
        ("scenario: crossing\noptions: {density: 2}\n", r"own.yaml:2: density belongs to the top of the file"),
        ("scenario: crossing\noptions:\n  lidar: {pattern: VLP}\n", r"own.yaml:3: unknown lidar beam table 'VLP'"),
        ("scenario: crossing\noptions:\n  channel: &a {b: *a}\n", r"own.yaml:3: an alias is part of what it stands"),
        (
            "scenario: crossing\noptions:\n  channel:\n    loss:\n      model: bernoulli\n      p: 0.1\n",
            r"own.yaml:6: unknown channel loss option 'p'. Accepted: probability",
        ),
        ("", r"own.yaml:1: file: expected keys and values"),
    ],
)
def test_what_is_wrong_is_said_with_the_line(tmp_path: Path, text: str, message: str) -> None:
    with pytest.raises(ScenarioFileError, match=message):
        coopsim.parallel_env(write(tmp_path, text))


def test_what_a_keyword_has_wrong_is_not_the_files_fault(tmp_path: Path) -> None:
    path = write(tmp_path, "scenario: crossing\npopulation: {vehicles: 10}\n")
    with pytest.raises(InvalidValueError, match=r"^vehicles must be"):
        coopsim.parallel_env(path, vehicles=-1)


def test_a_file_that_is_not_there(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["demo", "--environment", "nowhere.yaml"]) == 2
    assert "there is no scenario file 'nowhere.yaml'. Accepted: a path, or one of" in capsys.readouterr().err
