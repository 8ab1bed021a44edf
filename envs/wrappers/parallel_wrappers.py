"""Wrappers of the parallel environment that give it another form of observations or actions."""

from __future__ import annotations

from typing import Any

from pettingzoo import ParallelEnv
from pettingzoo.utils import BaseParallelWrapper

from coopsim.envs.parallel import space_of
from coopsim.envs.wrappers.forms import ActionForm, AnySpace, ObservationForm, cooperative_env
from coopsim.errors import InvalidActionError

ByAgent = dict[str, Any]
Stepped = tuple[ByAgent, dict[str, float], dict[str, bool], dict[str, bool], dict[str, dict[str, Any]]]


class ObservingParallel(BaseParallelWrapper[str, Any, Any]):  # type: ignore[misc]  # pettingzoo is untyped
    """The parallel environment with another form of observations.

    Args:
        env: the environment.
        form: of the observations.
    """

    def __init__(self, env: ParallelEnv[str, Any, Any], form: ObservationForm) -> None:
        super().__init__(env)
        self._cooperative, self.form = cooperative_env(env), form
        self._spaces = {name: form.space(env.observation_space(name)) for name in env.possible_agents}

    def observation_space(self, agent: str) -> AnySpace:
        """Return the space of an agent's observations; always the same object.

        Raises:
            UnknownNameError: there is no such agent; the message lists those that there are.
        """
        return space_of(agent, self._spaces)

    def reset(
        self, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[ByAgent, dict[str, dict[str, Any]]]:
        """Begin an episode; see `CooperativeEnv.reset`."""
        observations, infos = self.env.reset(seed=seed, options=options)
        self.form.begin(self._cooperative)
        return self.form.observe_all(observations), infos

    def step(self, actions: ByAgent) -> Stepped:
        """Go to the next frame; see `CooperativeEnv.step`."""
        observations, *rest = self.env.step(actions)
        return (self.form.observe_all(observations), *rest)


class ActingParallel(BaseParallelWrapper[str, Any, Any]):  # type: ignore[misc]  # pettingzoo is untyped
    """The parallel environment with another form of actions.

    Args:
        env: the environment.
        form: of the actions.
    """

    def __init__(self, env: ParallelEnv[str, Any, Any], form: ActionForm) -> None:
        super().__init__(env)
        cooperative_env(env)
        self.form = form
        self._spaces = {name: form.space(env.action_space(name)) for name in env.possible_agents}

    def action_space(self, agent: str) -> AnySpace:
        """Return the space of an agent's actions; always the same object.

        Raises:
            UnknownNameError: there is no such agent; the message lists those that there are.
        """
        return space_of(agent, self._spaces)

    def step(self, actions: ByAgent) -> Stepped:
        """Go to the next frame; see `CooperativeEnv.step`."""
        if not isinstance(actions, dict):
            raise InvalidActionError(f"actions are a dict by agent, got {type(actions).__name__}")
        known = self._spaces  # the environment refuses all other agents, by name
        taken = {
            name: self.form.act(name, each, known[name]) if name in known else each for name, each in actions.items()
        }
        stepped: Stepped = self.env.step(taken)
        return stepped
