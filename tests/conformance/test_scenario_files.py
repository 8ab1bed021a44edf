"""Scenarios as files: what comes along can be played, and what is wrong is said with the file and the line."""

from pathlib import Path
from typing import Any

import pytest

import coopsim
from coopsim.cli import main
from coopsim.envs.scenario_file import SHIPPED
from coopsim.errors import InvalidValueError, ScenarioFileError


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
    here = write(tmp_path, "scenario: crossing\noptions: {channel: nowhere.yaml}")
    with pytest.raises(ScenarioFileError, match=r"own.yaml:2: channel: cannot read nowhere.yaml"):
        coopsim.parallel_env(here)


def test_keywords_go_before_the_file(tmp_path: Path) -> None:
    path = write(tmp_path, "scenario: crossing\npopulation: {rsus: 1}\n")
    assert "rsu_2" in coopsim.parallel_env(path, rsus=3).possible_agents


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("scenario: crosing\n", r"own.yaml:1: unknown scenario 'crosing'. Did you mean 'crossing'"),
        ("population: {vehicles: 3}\n", r"own.yaml:1: scenario is missing"),
        ("scenario: crossing\n\nplaces: 3\n", r"own.yaml:3: unknown key 'places'"),
        (
            "scenario: crossing\npopulation:\n  vehicels: 3\n",
            r"own.yaml:3: unknown key 'vehicels'. Did you mean 'vehicles'",
        ),
        (
            "scenario: crossing\npopulation:\n  vehicles: many\n",
            r"own.yaml:3: vehicles must be an integer >= 0, got 'many'",
        ),
        ("scenario: crossing\ndensity: -1\n", r"own.yaml:2: density must be a finite number >= 0, got -1"),
        ("scenario: crossing\npopulation: 3\n", "own.yaml:2: population: expected keys and values"),
        ("scenario: crossing\noptions:\n  weather: {rain: 3}\n", r"own.yaml:3: unknown key 'rain'"),
        ("scenario: crossing\noptions:\n  weather: {wetness: 3}\n", r"own.yaml:3: wetness must be in \[0, 1\]"),
        ("scenario: crossing\noptions:\n  lidar: VLP\n", r"own.yaml:3: unknown lidar 'VLP'. Did you mean 'VLP-16'"),
        ("scenario: crossing\noptions:\n  threads: 0\n  lidar: {threads: 2}\n", r"own.yaml:3: threads must be"),
        ("scenario: crossing\noptions:\n  threads: 2\n  lidar: {threads: 0}\n", r"own.yaml:4: (lidar: )?threads must be"),
        ("scenario: crossing\noptions:\n  loss: 0.1\n  loss: 0.2\n", r"own.yaml:4: loss is there twice"),
        ("scenario: [crossing\n", r"own.yaml:2: this is no YAML"),
        ("scenario: !!python/name:os.system\n", r"own.yaml:1: this is no YAML"),
        ("scenario: highway\npopulation: {vehicles: 2}\n", r"own.yaml: connected_cars must be at most"),
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
