"""The one loop of an episode tells its recorders every report and every step, in order."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest

import coopsim
from coopsim.episode import Episode, Recorder, run_episode
from coopsim.types import Tracks
from coopsim.wire.actions import pack_tracks

IDLE = {"tracks": pack_tracks(Tracks.empty())}


class World:
    """An environment of two agents that counts its steps."""

    def __init__(self, length: int) -> None:
        self.length, self.time, self.agents = length, 0, list[str]()
        self.agent_specs, self.default_seed = {"a": None, "b": None}, 5

    def reset(self, seed: int, options: dict[str, Any]) -> Any:
        self.time, self.agents, self.asked = 0, ["a", "b"], (seed, options)
        observations, infos = self._frame()
        it: Any = self
        self.episode = Episode(it, seed, it, observations, observations, infos)
        return observations, infos

    def step(self, actions: dict[str, Any]) -> Any:
        assert actions == {name: f"{name} at {self.time}" for name in "ab"}
        self.time += 1
        self.agents = [] if self.time == self.length else ["a", "b"]
        observations, infos = self._frame()
        it: Any = self
        rewards = {"a": self.time, "b": 0.0}
        self.episode.go_on(it, observations, observations=observations, rewards=rewards, infos=infos)
        return observations, rewards, {}, {}, infos

    def _frame(self) -> Any:
        return dict.fromkeys("ab", self.time), {name: {"truth": self.time} for name in "ab"}


class Reports:
    def __init__(self, truth: bool = False) -> None:
        self.needs, self.told = SimpleNamespace(truth=truth), list[Any]()

    def reset(self, specs: Any, seed: int) -> None:
        self.seed = seed

    def act(self, observations: Any, *infos: Any) -> Any:
        self.told.append(infos)
        return {name: f"{name} at {time}" for name, time in observations.items()}


class Notes(Recorder):
    def __init__(self) -> None:
        self.lines: list[Any] = []

    def begin(self, episode: Episode) -> None:
        self.lines.append(("begin", episode.observations["a"], dict(episode.actions)))

    def on_report(self, episode: Episode) -> None:
        self.lines.append(("report", episode.steps, episode.observations["a"], episode.actions["b"]))

    def on_step(self, episode: Episode) -> None:
        self.lines.append(("step", episode.steps, episode.observations["a"], episode.rewards["a"]))


def run(length: int = 2, policy: Any = None, **more: Any) -> tuple[Any, list[Any], Episode]:
    world: Any = World(length)
    notes = Notes()
    return world, notes.lines, run_episode(world, policy or Reports(), (notes,), seed=3, **more)


def test_every_report_and_step_is_told_in_order() -> None:
    world, lines, episode = run(2, options={"sequence": "x"})
    assert lines == [
        ("begin", 0, {}),
        ("report", 0, 0, "b at 0"),
        ("step", 1, 1, 1),
        ("report", 1, 1, "b at 1"),
        ("step", 2, 2, 2),
    ]
    assert world.asked == (3, {"sequence": "x"}) and episode.steps == 2
    assert episode.policy_s > 0 and episode.environment_s > 0


def test_it_stops_after_as_many_steps_as_asked_for() -> None:
    _, lines, episode = run(5, most_steps=1)
    assert [line[0] for line in lines] == ["begin", "report", "step"] and episode.steps == 1


@pytest.mark.parametrize("more", [{}, {"most_steps": 2}])
def test_a_last_report_is_of_the_frame_after_the_last_step(more: dict[str, int]) -> None:
    _, lines, _ = run(2, last_report=True, **more)
    assert lines[-1] == ("report", 2, 2, "b at 2")


def test_only_a_policy_that_needs_the_truth_is_told_infos() -> None:
    hidden, told = Reports(), Reports(truth=True)
    run(1, hidden)
    run(1, told)
    assert hidden.told == [()]
    assert told.told == [({name: {"truth": 0} for name in "ab"},)]


def test_without_a_seed_it_takes_the_environments_own() -> None:
    world: Any = World(1)
    assert run_episode(world, Reports()).seed == 5  # type: ignore[arg-type]
    world.default_seed = None
    assert run_episode(world, Reports()).seed == 0  # type: ignore[arg-type]


def test_the_policys_seed_is_that_of_the_loop_that_users_write() -> None:
    env = coopsim.parallel_env("crossing", lidar=None, vehicles=2, pedestrians=0, max_cycles=1)
    reports: Any = SimpleNamespace(needs=SimpleNamespace(truth=False), act=lambda seen: dict.fromkeys(seen, IDLE))
    reports.reset = lambda specs, seed: setattr(reports, "seed", seed)
    run_episode(env, reports, seed=3)
    env.reset(seed=3)
    assert reports.seed == env.policy_seed != 3


def test_recorders_are_told_frames_reports_messages_and_outcomes() -> None:
    told: list[Any] = []

    class Told(Recorder):
        def on_report(self, episode: Episode) -> None:
            assert episode.frame.time_ns == episode.env.time_ns and set(episode.tracks) == set(episode.env.agents)
            senders = {message.sender for message in episode.received["cav_0"].inbox}
            told.append((episode.steps, senders, len(episode.tracks["cav_0"])))

        def on_step(self, episode: Episode) -> None:
            told.append((episode.steps, set(episode.rewards), episode.frame.last))

    policy = coopsim.make_policy("late_fusion")
    env = coopsim.parallel_env("crossing", uplink=policy, lidar=None, vehicles=6, pedestrians=0, max_cycles=2)
    episode = run_episode(env, policy, [Told()], seed=3)
    others = {"cav_1", "cav_2", "rsu_0"}
    assert told[0][:2] == (0, others) and told[2][:2] == (1, others) and told[2][2] > 0
    assert told[1] == (1, others | {"cav_0"}, False) and told[3] == (2, others | {"cav_0"}, True)
    assert episode.policy is policy and len(episode.tracks["cav_0"]) == told[2][2]
