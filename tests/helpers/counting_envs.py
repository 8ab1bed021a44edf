"""Environments that count, for tests of vectors: of one agent and of several, with all kinds of accidents."""

from __future__ import annotations

import os
import signal
import time
from typing import Any

import gymnasium
import numpy as np
from gymnasium import spaces
from pettingzoo import ParallelEnv

from coopsim.errors import InvalidActionError, InvalidValueError

REFUSED, FAILING, KILLED, SLOW = -1.0, -2.0, -3.0, -4.0
"""Actions that are not accepted, that raise, that kill the process, and that take a minute."""


def obey(action: float) -> None:
    if action == REFUSED:
        raise InvalidActionError("action must be >= 0")
    if action == FAILING:
        raise ZeroDivisionError("the detector broke")
    if action == KILLED:
        os.kill(os.getpid(), signal.SIGKILL)
    if action == SLOW:
        time.sleep(60)


class CountingEnv(gymnasium.Env[Any, Any]):
    """Observes its episode, its step and a draw by its seed; an episode has `length` steps, every other one more."""

    metadata = {"render_modes": ["rgb_array"]}  # noqa: RUF012

    def __init__(self, length: int = 3, size: int = 3) -> None:
        self.observation_space = spaces.Box(-np.inf, np.inf, (size,))
        self.action_space = spaces.Box(-9.0, 9.0, (1,))
        self.render_mode = "rgb_array"
        self.length, self.episode, self.steps, self.pause_s = length, -1, 0, 0.0

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Any, dict[str, Any]]:
        if "wrong" in (options or {}):
            raise InvalidValueError("reset options must be right")
        super().reset(seed=seed)
        self.episode, self.steps = self.episode + 1, 0
        return self._observed(), {"seed": -1 if seed is None else seed % 2**62, "options": dict(options or {})}

    def step(self, action: Any) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        obey(float(action[0]))
        time.sleep(self.pause_s)
        self.steps += 1
        over = self.steps >= self.length + self.episode % 2
        return self._observed(), float(action[0]), over and self.episode % 2 == 0, over, {"pid": os.getpid()}

    def render(self) -> Any:
        return np.full((2, 2, 3), self.steps, np.uint8)

    def _observed(self) -> Any:
        observed = np.zeros(self.observation_space.shape, np.float32)
        observed[:3] = self.episode, self.steps, 0.0
        return observed


class SeededEnv(CountingEnv):
    """Its observations, and the lengths of its episodes, are drawn by its seed."""

    def _observed(self) -> Any:
        observed = super()._observed()
        observed[2] = self.np_random.random()
        if self.steps == 0:
            self.length = int(self.np_random.integers(2, 6))
        return observed


class CountingAgents(ParallelEnv[str, Any, Any]):  # type: ignore[misc]  # pettingzoo is untyped
    """Two agents that observe as many numbers as there were steps."""

    metadata = {"name": "counting"}  # noqa: RUF012
    render_mode = None

    def __init__(self, length: int = 3) -> None:
        self.possible_agents, self.agents = ["a", "b"], list[str]()
        self.length, self.seed, self.steps = length, 0, 0

    def observation_space(self, agent: str) -> Any:
        return spaces.Dict({"rows": spaces.Sequence(spaces.Box(0, 99, (2,)), stack=True)})

    def action_space(self, agent: str) -> Any:
        return spaces.Box(-9.0, 9.0)

    def reset(self, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Any, Any]:
        self.agents, self.seed, self.steps = list(self.possible_agents), seed or 0, 0
        return self._observed(), {agent: {"seed": self.seed} for agent in self.agents}

    def step(self, actions: dict[str, Any]) -> tuple[Any, Any, Any, Any, Any]:
        for action in actions.values():
            obey(float(action))
        self.steps += 1
        over = self.steps >= self.length
        agents, self.agents = self.agents, [] if over else self.agents
        return (
            self._observed(),
            {agent: float(actions[agent]) for agent in agents},
            dict.fromkeys(agents, False),
            dict.fromkeys(agents, over),
            {agent: {"steps": self.steps} for agent in agents},
        )

    def score(self) -> tuple[int, int]:
        return self.seed, self.steps

    def _observed(self) -> Any:
        return {agent: {"rows": np.full((self.steps, 2), self.seed % 97, np.float32)} for agent in self.possible_agents}
