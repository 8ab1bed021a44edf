"""The one loop of an episode tells its recorders every report and every step, in order."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest

from coopsim.episode import Episode, Recorder, run_episode


class World:
    """An environment of two agents that counts its steps."""

    def __init__(self, length: int) -> None:
        self.length, self.time, self.agents = length, 0, list[str]()
        self.agent_specs = {"a": None, "b": None}
        self.trusted: list[tuple[int, str, Any]] = []

    def reset(self, seed: int, options: dict[str, Any]) -> Any:
        self.time, self.agents, self.asked = 0, ["a", "b"], (seed, options)
        return self._frame()

    def step(self, actions: dict[str, Any]) -> Any:
        assert actions == {name: f"{name} at {self.time}" for name in "ab"}
        self.time += 1
        self.agents = [] if self.time == self.length else ["a", "b"]
        observations, infos = self._frame()
        return observations, {"a": self.time, "b": 0.0}, {}, {}, infos

    def note_trust(self, agent: str, trust: Any, passes: int) -> None:
        self.trusted.append((self.time, agent, trust))

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

    def judgements(self, agents: list[str]) -> Any:
        return {"a": ({"b": 0.5}, 1)} if "a" in agents else {}


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


def test_trust_is_noted_in_the_frame_that_it_is_of() -> None:
    world, _, _ = run(2)
    assert world.trusted == [(0, "a", {"b": 0.5}), (1, "a", {"b": 0.5})]
