"""Forms: other spaces for the same observations or actions, whichever kind of environment they are wrapped around."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from typing import Any

import gymnasium
from gymnasium import spaces
from pettingzoo import ParallelEnv

from coopsim.envs.parallel import CooperativeEnv
from coopsim.errors import InvalidValueError

AnySpace = spaces.Space[Any]


class ObservationForm(ABC):
    """Another form of observations."""

    @abstractmethod
    def space(self, inner: AnySpace) -> AnySpace:
        """Return a new space of the observations that those in `inner` become.

        Raises:
            InvalidValueError: the form is not for such observations.
        """

    def begin(self, env: CooperativeEnv) -> None:
        """Begin an episode of this environment, and forget the last one."""

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
        """Return the action in `inner` that an action stands for.

        Args:
            agent: name of the agent that acts.
            action: its action in this form.
            space: what `space` returned for this agent.

        Raises:
            InvalidActionError: names the agent and what is wrong.
        """


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
