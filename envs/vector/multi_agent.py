"""Vectors of environments with many agents each: lists of dicts by agent."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any, Self

from gymnasium import spaces

from coopsim.envs.vector.stepper import Stepper
from coopsim.envs.vector.vector_calls import VectorCalls
from coopsim.errors import InvalidActionError, LostEnvironmentsError
from coopsim.support.checks import require_choice

ByAgent = dict[str, Any]


class MultiAgentVector(VectorCalls):
    """Many environments of PettingZoo's parallel API, stepped together.

    Each environment's part is what its own `reset` and `step` return, at its place of a list. Observations are the
    caller's own arrays, which later steps leave alone; a `reset` with a mask returns those of the environments that go
    on once more, as they are by then.

    | autoreset_mode | after an episode's last step |
    |---|---|
    | NEXT_STEP | the next `step` passes over the environment's actions and begins an episode: its rewards are 0 |
    | SAME_STEP | the same `step` begins an episode, and returns its first observations and infos; what ended is in |
    | | `infos[i][agent]["final_obs"]` and `["final_info"]` |
    | DISABLED | `step` raises `EpisodeStateError` until `reset(options={"reset_mask": mask})` |
    """

    def __init__(self, stepper: Stepper, end: Callable[[], None]) -> None:
        super().__init__(stepper, end)
        self._observation_spaces: dict[str, spaces.Space[Any]] = stepper.description.observation
        self._action_spaces: dict[str, spaces.Space[Any]] = stepper.description.action
        self.possible_agents = list(self._action_spaces)
        self.num_envs = stepper.count
        self.render_mode = stepper.description.render_mode
        self.metadata = {**stepper.description.metadata, "autoreset_mode": stepper.mode}

    def observation_space(self, agent: str) -> spaces.Space[Any]:
        """Return the space of an agent's observations, the same in every environment."""
        require_choice("agent", agent, self.possible_agents)
        return self._observation_spaces[agent]

    def action_space(self, agent: str) -> spaces.Space[Any]:
        """Return the space of an agent's actions, the same in every environment."""
        require_choice("agent", agent, self.possible_agents)
        return self._action_spaces[agent]

    def reset(
        self, *, seed: int | Sequence[int | None] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[list[ByAgent], list[ByAgent]]:
        """Begin episodes.

        Returns:
            Observations and infos, each a list with a dict by agent for each environment.

        Args:
            seed: integer from 0 to 2**63 - 1, of which each episode's seed is derived by environment and episode; a
                list of one for each environment is of their first episodes themselves; None goes on with the next
                episodes (at first: the option `seed`, or a fresh one). The seed of an episode is in its infos.
            options: of the environments' `reset`; `{"reset_mask": mask}`, an array (num_envs,) of bool, resets these
                environments alone: the others go on, with their last observations and without infos.

        Raises:
            InvalidValueError: a seed or an option is not accepted. All environments are as they were.
            UnknownNameError: an option's name or value is not known, or is nearly `reset_mask`.
            EpisodeStateError: the first reset is not of all environments, or the vector is closed.
            LostEnvironmentsError: an environment raised an error, or its worker died; the others have begun episodes.
                The error has the results of these, with an empty dict or the last observations for a lost one.
                Reset the lost ones by `reset_mask`; or the next `step` begins their episodes, unless autoreset is
                disabled.
        """
        observations, begun, lost = self._stepper.reset(seed, options)
        results = [each or {} for each in observations], [begun.get(index, {}) for index in range(self.num_envs)]
        if lost:
            raise LostEnvironmentsError(lost, results)
        return results

    def step(
        self, actions: Sequence[Mapping[str, Any]]
    ) -> tuple[list[ByAgent], list[ByAgent], list[ByAgent], list[ByAgent], list[ByAgent]]:
        """Step all environments; return observations, rewards, terminations, truncations and infos.

        Args:
            actions: of each environment, by agent. Those of an environment that begins an episode are passed over.

        Raises:
            EpisodeStateError: before `reset`, or an episode is over and autoreset is disabled.
            InvalidActionError: names the environment and what is wrong. If the number of actions is wrong, nothing has
                changed; otherwise the other environments have stepped, and the next call steps only those refused.
            LostEnvironmentsError: an environment raised an error, or its worker died. The error has the results of all,
                in which the lost one is truncated; the next call, or `reset`, begins its next episode.
        """
        if not isinstance(actions, Sequence) or len(actions) != self.num_envs:
            got = f"{len(actions)}" if isinstance(actions, Sequence) else f"a {type(actions).__name__}"
            raise InvalidActionError(f"actions are a list of {self.num_envs} dicts, one by environment, got {got}")
        transitions, lost = self._stepper.step(actions)
        infos = []
        for each in transitions:
            info = each.info
            if each.final is not None:
                observations, final = each.final
                info = {name: dict(info.get(name, {})) for name in {**info, **final}}
                for name in final:
                    info[name].update(final_obs=observations.get(name), final_info=final[name])
            infos.append(info)
        results = (
            [each.observation for each in transitions],
            [each.reward for each in transitions],
            [each.terminated for each in transitions],
            [each.truncated for each in transitions],
            infos,
        )
        if lost:
            raise LostEnvironmentsError(lost, results)
        return results

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def __repr__(self) -> str:
        return f"MultiAgentVector(num_envs={self.num_envs}, agents={self.possible_agents})"
