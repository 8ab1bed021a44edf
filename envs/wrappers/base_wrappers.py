"""Wrappers with another form of observations or actions, around environments of all agents or of one."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from copy import deepcopy
from typing import Any

import gymnasium
from gymnasium import spaces
from gymnasium.utils import RecordConstructorArgs
from pettingzoo import ParallelEnv
from pettingzoo.utils import BaseParallelWrapper

from coopsim.envs.parallel import CooperativeEnv
from coopsim.errors import InvalidActionError, InvalidValueError
from coopsim.wire.columns import space_of

AnySpace = spaces.Space[Any]


class ObservationForm(ABC):
    """Another form of observations."""

    @abstractmethod
    def space(self, inner: AnySpace) -> AnySpace:
        """Return a new space of the observations that those in `inner` become.

        Raises:
            InvalidValueError: the form is not for such observations.
        """

    def bind(self, env: Any) -> None:
        """Take over the environment within the wrapper, once, before its first episode.

        Raises:
            InvalidValueError: the form is not for such an environment.
        """

    def begin(self, env: CooperativeEnv) -> None:
        """Begin an episode of this environment, and forget the last one."""

    def action_space(self, inner: AnySpace) -> AnySpace:
        """Return the space of actions for such observations: by default the environment's own."""
        return inner

    def act(self, agent: str, action: Any) -> Any:
        """Return the environment's action for one that was chosen by an agent's last observation in this form.

        What is no action in `action_space` is returned as it is, for the environment to refuse.
        """
        return action

    @abstractmethod
    def observe(self, agent: str, observation: Any) -> Any:
        """Return an agent's observation in this form; called once for each of its observations, in order."""

    def observe_all(self, observations: Mapping[str, Any]) -> dict[str, Any]:
        """Return the observations of one frame, by agent, in this form. By default `observe` is called for each."""
        return {name: self.observe(name, observation) for name, observation in observations.items()}


class ActionForm(ABC):
    """Another form of actions."""

    @abstractmethod
    def space(self, inner: AnySpace) -> AnySpace:
        """Return a new space of the actions that stand for those in `inner`.

        Raises:
            InvalidValueError: the form is not for such actions.
        """

    @abstractmethod
    def act(self, agent: str, action: Any, space: AnySpace) -> Any:
        """Return the action in `inner` that an action stands for; `space` is what `space` returned for the agent."""


def kind_of(space: AnySpace) -> str:
    """Return the kind of a space in words for messages: "a Dict of own, picture", "a Box (24,)"."""
    kind = type(space).__name__
    if isinstance(space, spaces.Dict):
        return f"a {kind} of {', '.join(space.spaces)}"
    return f"a {kind} {space.shape}" if isinstance(space, spaces.Box) else f"a {kind}"


def cooperative_env(env: Any) -> CooperativeEnv:
    """Return the environment of all agents within wrappers.

    Raises:
        InvalidValueError: `env` is no environment of coopsim's.
    """
    inner = env.unwrapped if isinstance(env, (ParallelEnv, gymnasium.Env)) else None
    inner = getattr(inner, "parallel", inner)
    if not isinstance(inner, CooperativeEnv):
        raise InvalidValueError(
            f"env must be an environment by coopsim.parallel_env, coopsim.single_env or gymnasium.make, got {env!r}"
        )
    return inner


ByAgent = dict[str, Any]
Stepped = tuple[ByAgent, dict[str, float], dict[str, bool], dict[str, bool], dict[str, dict[str, Any]]]


class ObservingParallel(BaseParallelWrapper[str, Any, Any]):  # type: ignore[misc]  # pettingzoo is untyped
    """The parallel environment with another form of observations."""

    def __init__(self, env: ParallelEnv[str, Any, Any], form: ObservationForm) -> None:
        super().__init__(env)
        self._cooperative, self.form = cooperative_env(env), form
        form.bind(env)
        self._spaces = {name: form.space(env.observation_space(name)) for name in env.possible_agents}
        self._action_spaces = {name: form.action_space(env.action_space(name)) for name in env.possible_agents}

    def action_space(self, agent: str) -> AnySpace:
        """Return the space of an agent's actions; always the same object.

        Raises:
            UnknownNameError: there is no such agent; the message lists those that there are.
        """
        return space_of(agent, self._action_spaces)

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
        if isinstance(actions, dict):  # the environment refuses all else
            actions = {name: self.form.act(name, each) for name, each in actions.items()}
        observations, *rest = self.env.step(actions)
        return (self.form.observe_all(observations), *rest)


class ActingParallel(BaseParallelWrapper[str, Any, Any]):  # type: ignore[misc]  # pettingzoo is untyped
    """The parallel environment with another form of actions."""

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


class ObservingSingle(gymnasium.Wrapper[Any, Any, Any, Any], RecordConstructorArgs):
    """The single-agent environment with a copy of another form of observations."""

    def __init__(self, env: gymnasium.Env[Any, Any], form: ObservationForm) -> None:
        RecordConstructorArgs.__init__(self, form=form)  # of which env.spec makes the wrapper again
        super().__init__(env)
        self._cooperative, self.form = cooperative_env(env), deepcopy(form)
        self.form.bind(env)
        self.observation_space = self.form.space(env.observation_space)
        self.action_space = self.form.action_space(env.action_space)

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Any, dict[str, Any]]:
        """Begin an episode; see `SingleAgentEnv.reset`."""
        observation, info = self.env.reset(seed=seed, options=options)
        self.form.begin(self._cooperative)
        return self._observed(observation), info

    def step(self, action: Any) -> tuple[Any, Any, bool, bool, dict[str, Any]]:
        """Go to the next frame; see `SingleAgentEnv.step`."""
        action = self.form.act(self.get_wrapper_attr("ego"), action)
        observation, reward, terminated, truncated, info = self.env.step(action)
        return self._observed(observation), reward, terminated, truncated, info

    def _observed(self, observation: Any) -> Any:
        return self.form.observe(self.get_wrapper_attr("ego"), observation)


class ActingSingle(gymnasium.Wrapper[Any, Any, Any, Any], RecordConstructorArgs):
    """The single-agent environment with a copy of another form of actions."""

    def __init__(self, env: gymnasium.Env[Any, Any], form: ActionForm) -> None:
        RecordConstructorArgs.__init__(self, form=form)  # of which env.spec makes the wrapper again
        super().__init__(env)
        cooperative_env(env)
        self.form = deepcopy(form)
        self.action_space = self.form.space(env.action_space)

    def step(self, action: Any) -> tuple[Any, Any, bool, bool, dict[str, Any]]:
        """Go to the next frame; see `SingleAgentEnv.step`."""
        return self.env.step(self.form.act(self.get_wrapper_attr("ego"), action, self.action_space))
