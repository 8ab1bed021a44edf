"""The base of wrappers in which agents choose a part of their actions alone, and a policy reports their tracks."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping
from typing import Any, ClassVar

import gymnasium
from gymnasium import spaces
from pettingzoo import ParallelEnv
from pettingzoo.utils import BaseParallelWrapper

from coopsim.agents.policy import Policy
from coopsim.envs.roles import Roles
from coopsim.envs.wrappers.base_wrappers import ByAgent, Stepped, cooperative_env
from coopsim.errors import EpisodeStateError, InvalidActionError, InvalidValueError
from coopsim.support.checks import require_choice
from coopsim.support.rng import derived_seed
from coopsim.types import AgentSpec, Tracks
from coopsim.wire.actions import unpack_action
from coopsim.wire.columns import space_of


class TrackedByPolicy(BaseParallelWrapper[str, Any, Any]):  # type: ignore[misc]  # pettingzoo is untyped
    """The parallel environment for learners that choose a part of the actions; see `Driving` and `Speaking`."""

    _kind: ClassVar[str]
    _needed: ClassVar[str]
    """Words for errors: the kind of action, and the need of agents that choose one."""

    def __init__(self, env: ParallelEnv[str, Any, Any], tracker: str | Policy = "late_fusion") -> None:
        if isinstance(env, gymnasium.Env):
            raise InvalidValueError('env must be parallel: make a single-agent one with tracker="late_fusion" instead')
        super().__init__(env)
        self._cooperative = cooperative_env(env)
        made = Roles.make(tracker, others=None).tracker
        if made is None:
            raise InvalidValueError("tracker must be a policy or its name, got None")
        self.tracker = made
        self.tracker.require(self._cooperative.agent_specs)
        self._chosen = {name: spec for name, spec in self._cooperative.agent_specs.items() if self._chooses(spec)}
        choosing = list(self._chosen)
        if not choosing:
            raise InvalidValueError(f"env must have agents that {self._needed}")
        for kind in ("action", "observation"):
            if not all(
                getattr(env, f"{kind}_space")(name) is getattr(self._cooperative, f"{kind}_space")(name)
                for name in choosing
            ):
                raise InvalidValueError(f"env must have coopsim's own {kind}s, which no wrapper changed")
        self.possible_agents = choosing
        self.agents: list[str] = []
        self._spaces: dict[str, spaces.Space[Any]] = {name: self._space(spec) for name, spec in self._chosen.items()}
        self._observations: ByAgent = {}
        self._actions: ByAgent | None = None

    def action_space(self, agent: str) -> spaces.Space[Any]:
        """Return the space of an agent's actions; always the same object.

        Raises:
            UnknownNameError: there is no such agent; the message lists those that there are.
        """
        return space_of(agent, self._spaces)

    def reset(
        self, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[ByAgent, dict[str, dict[str, Any]]]:
        """Begin an episode; see `CooperativeEnv.reset`."""
        observations, infos = self.env.reset(seed=seed, options=options)
        used = next(info["seed"] for info in infos.values())
        self.tracker.reset(self._cooperative.agent_specs, seed=derived_seed(used, "policy"))
        self._observed(observations)
        return self._of_choosing(observations), self._of_choosing(infos)

    def step(self, actions: Mapping[str, Any]) -> Stepped:
        """Go to the next frame with one action for every agent in `agents`.

        Raises:
            EpisodeStateError: there is no running episode.
            InvalidActionError: names the agent and what is wrong. The environment is as it was before.
        """
        if not self.agents:
            raise EpisodeStateError("there is no running episode: call reset to begin one")
        chosen = self._checked(actions)
        taken = dict(self._tracked())
        for name, action in chosen.items():
            taken[name] = taken[name] | self._part(self._chosen[name], action)
        observations, *rest = self.env.step(taken)
        self._observed(observations)
        return (self._of_choosing(observations), *(self._of_choosing(each) for each in rest))  # type: ignore[return-value]

    def reported_tracks(self, agent: str) -> Tracks:
        """Return the tracks that the policy reports for an agent's last observation, in the agent's base frame.

        Raises:
            UnknownNameError: the agent is not present; the message lists those that are.
        """
        require_choice("agent", agent, self._observations)
        return unpack_action(agent, {"tracks": self._tracked()[agent]["tracks"]})[0]

    @abstractmethod
    def _chooses(self, spec: AgentSpec) -> bool:
        """Return whether an agent chooses anything."""

    @abstractmethod
    def _space(self, spec: AgentSpec) -> spaces.Space[Any]:
        """Return a new space of an agent's choices."""

    @abstractmethod
    def _part(self, spec: AgentSpec, action: Any) -> ByAgent:
        """Return the part of the environment's action that a choice stands for."""

    def _tracked(self) -> ByAgent:
        """Return the tracker's actions; it must see no frame twice, whatever actions are refused."""
        if self._actions is None:
            self._actions = self.tracker.act(self._observations)
        return self._actions

    def _observed(self, observations: ByAgent) -> None:
        self._observations, self._actions = observations, None
        self.agents = [name for name in self.env.agents if name in self._spaces]

    def _of_choosing(self, by_agent: ByAgent) -> ByAgent:
        return {name: each for name, each in by_agent.items() if name in self._spaces}

    def _checked(self, actions: object) -> ByAgent:
        if not isinstance(actions, Mapping) or set(actions) != set(self.agents):
            got = sorted(map(str, actions)) if isinstance(actions, Mapping) else repr(actions)
            raise InvalidActionError(f"actions are a dict with one {self._kind} for each of {self.agents}, got {got}")
        return dict(actions)
