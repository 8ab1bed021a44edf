"""A recorded world in the environment: the same traffic for every policy, sensor and channel."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from representatives import all_of
from small_env import SIMULATED, SMALL
from test_environments import assert_same, play

import coopsim
from coopsim.errors import InvalidValueError, RecordingError, UnknownNameError
from coopsim.world.recording.episode_file import Episode

Make = Callable[..., Any]


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The small crossing, 12 steps of it."""
    path = tmp_path_factory.mktemp("recording") / "run.coopsim"
    return coopsim.record("crossing", path, seed=4, max_cycles=SMALL["max_cycles"], vehicles=SMALL["vehicles"])


@pytest.mark.parametrize("name", all_of(SIMULATED, "crossing", "occluded_crossing", "platoon", "town"))
def test_played_back_with_the_same_options_it_is_the_same_to_the_last_bit(
    make_small: Make, tmp_path: Path, name: str
) -> None:
    path = tmp_path / "run.coopsim"
    noisy = {
        "position_noise_m": 0.2,
        "latency_s": 0.15,
        "loss": 0.1,
        "expose_ground_truth": True,
        "expose_visibility": True,
    }
    live = make_small(name, record=path, **noisy)
    first = play(live, seed=9)
    again = make_small(name, playback=path, **noisy)
    for k, (a, b) in enumerate(zip(first, play(again, seed=9), strict=True)):
        assert_same(dict(enumerate(a)), dict(enumerate(b)), f"step {k}")
    assert again.score().to_dict() == live.score().to_dict()
    if name != "town":  # where it has room for the actors of all places
        assert again.state_space == live.state_space


def test_recording_changes_nothing_and_needs_no_sensing(make_small: Make, recording: Path, tmp_path: Path) -> None:
    recorded = play(make_small(record=tmp_path / "sensed"), seed=4)
    for a, b in zip(recorded, play(make_small(), seed=4), strict=True):
        assert_same(dict(enumerate(a)), dict(enumerate(b)))
    assert (tmp_path / "sensed").read_bytes() == recording.read_bytes()


def test_other_sensors_channels_policies_and_seeds_meet_the_same_traffic(make_small: Make, recording: Path) -> None:
    def states(policy: str, seed: int, **options: Any) -> list[Any]:
        env = make_small(playback=recording, uplink=coopsim.POLICIES.get(policy).needs.uplink, **options)
        tracker = coopsim.make_policy(policy)
        observations, _ = env.reset(seed=seed)
        tracker.reset(env.agent_specs, seed=seed)
        seen = [env.state()]
        while env.agents:
            observations, *_ = env.step(tracker.act(observations))
            seen.append(env.state())
        return seen

    one = states("no_fusion", 0)
    other = states("track_to_track", 1, lidar="HDL-32E", lidar_range_m=60.0, loss=0.5, position_noise_m=1.0)
    np.testing.assert_array_equal(one, other)
    assert len(one) == 13
    assert not np.array_equal(one[0], one[-1])


def test_population_time_step_and_length_are_the_recordings(recording: Path) -> None:
    env = coopsim.parallel_env("crossing", playback=recording, lidar="VLP-16", lidar_columns=64)
    assert len(play(env, seed=0)) == 13
    assert env.state_space.shape == (18, 11)
    shorter = coopsim.parallel_env("crossing", playback=str(recording), max_cycles=5, lidar="VLP-16", lidar_columns=64)
    assert len(play(shorter, seed=0)) == 6


def test_a_recording_made_under_policy_control_plays_as_it_was_driven(make_small: Make, tmp_path: Path) -> None:
    path = tmp_path / "driven"
    live = make_small(record=path, control="policy")
    play(live, seed=2)
    again = make_small(playback=path)
    play(again, seed=2)
    np.testing.assert_array_equal(live.state(), again.state())


def test_every_reset_begins_the_recording_anew(make_small: Make, tmp_path: Path) -> None:
    env = make_small(record=tmp_path / "run")
    play(env, seed=1)
    env.reset(seed=2)
    episode = Episode(tmp_path / "run")
    assert (episode.frames, episode.header.seed) == (1, 2)


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ({"control": "policy"}, "cannot be played back"),
        ({"dt_s": 0.2}, r"dt_s must be 0.1, as .* was recorded, got 0.2"),
        ({"max_cycles": 13}, "max_cycles must be at most 12, as .* has no more steps, got 13"),
        ({"max_cycles": "all"}, "max_cycles must be an integer"),
        ({"vehicles": 11}, "vehicles must be 10, as .* was recorded, got 11"),
        ({"rsus": 2}, "rsus must be 1"),
        ({"record": "other"}, "record and playback exclude each other"),
    ],
)
def test_what_was_not_recorded_is_refused(make_small: Make, recording: Path, options: Any, said: str) -> None:
    with pytest.raises(InvalidValueError, match=said):
        make_small(playback=recording, **options)


def test_wrong_files_scenarios_and_names_are_refused(make_small: Make, recording: Path, tmp_path: Path) -> None:
    with pytest.raises(RecordingError, match="recorded in 'crossing'; accepted here: 'highway'"):
        make_small("highway", playback=recording)
    with pytest.raises(RecordingError, match=r"cannot read .*none"):
        make_small(playback=tmp_path / "none")
    with pytest.raises(InvalidValueError, match="must be the file of a recorded episode, got 3"):
        make_small(playback=3)
    with pytest.raises(InvalidValueError, match="record must be the path of a file or None, got 3"):
        make_small(record=3)
    with pytest.raises(InvalidValueError, match="cannot write"):
        make_small(record=tmp_path)
    with pytest.raises(UnknownNameError, match="vehicles"):
        make_small(playback=recording, vehicels=3)
    make_small(record=tmp_path / "one").reset(seed=0)
    with pytest.raises(RecordingError, match="holds a single frame"):
        coopsim.parallel_env("crossing", playback=tmp_path / "one")
