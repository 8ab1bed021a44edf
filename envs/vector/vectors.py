"""Vectors of environments: lists of dicts by agent, or gymnasium's `VectorEnv` for one agent."""

from __future__ import annotations

import weakref
from collections.abc import Callable, Mapping, Sequence
from typing import Any, Self

import numpy as np
from gymnasium import spaces
from gymnasium.error import CustomSpaceError
from gymnasium.vector import VectorEnv
from gymnasium.vector.utils import batch_space, concatenate, create_empty_array, iterate

from coopsim.envs.vector.environments import Transition
from coopsim.envs.vector.stepper import Stepper
from coopsim.errors import InvalidActionError, InvalidValueError, LostEnvironmentsError
from coopsim.support.checks import require_choice

ByAgent = dict[str, Any]

Results = tuple[Any, np.ndarray[Any, Any], np.ndarray[Any, Any], np.ndarray[Any, Any], dict[str, Any]]


class VectorCalls:
    """Calls of the environments by name, and their end: by `close`, or when the vector is no longer used.

    Args:
        stepper: has the environments.
        end: ends their workers; must not refer to the vector.
    """

    closed: bool = False

    def __init__(self, stepper: Stepper, end: Callable[[], None]) -> None:
        self._stepper = stepper
        self._finalizer = weakref.finalize(self, end)

    def call(self, name: str, *args: Any, **keywords: Any) -> tuple[Any, ...]:
        """Call a method of every environment, or get an attribute, as `call("score")`; return the values, in order.

        Raises:
            EpisodeStateError: the vector is closed.
            Exception: an error of an environment.
            LostEnvironmentsError: a worker died.
        """
        return self._stepper.call("get", [(name, args, keywords)] * self._stepper.count)

    def get_attr(self, name: str) -> tuple[Any, ...]:
        """Return an attribute of every environment, in order; a method is called.

        Raises:
            Exception: an error of an environment, such as AttributeError where there is no such attribute.
            LostEnvironmentsError: a worker died.
        """
        return self.call(name)

    def set_attr(self, name: str, values: Any) -> None:
        """Set an attribute of every environment: a list or tuple has one value for each, all else is of all.

        Raises:
            InvalidValueError: the list or tuple is of another length than the vector.
            Exception: an error of an environment.
            LostEnvironmentsError: a worker died.
        """
        count = self._stepper.count
        each = values if isinstance(values, (list, tuple)) else [values] * count
        if len(each) != count:
            raise InvalidValueError(f"values must be {count}, one for each environment, got {len(each)}")
        self._stepper.call("set", [(name, value) for value in each])

    def render(self) -> tuple[Any, ...] | None:
        """Return a picture of every environment, in order, where they were made with a `render_mode`.

        Raises:
            Exception: an error of an environment.
            LostEnvironmentsError: a worker died.
        """
        return self.call("render")

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self, **_: Any) -> None:
        """Close the environments and end the workers; may be called again."""
        self.closed = True
        try:
            self._stepper.close()
        finally:
            self._finalizer()


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
            options: options of the environments' `reset`; `{"reset_mask": mask}`, an array (num_envs,) of bool, resets
                these environments alone: the others go on, with their last observations and without infos.

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
            actions: actions by agent, for each environment. Those of one that begins an episode are passed over.

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

    def __repr__(self) -> str:
        return f"MultiAgentVector(num_envs={self.num_envs}, agents={self.possible_agents})"


class SingleAgentVector(VectorCalls, VectorEnv[Any, Any, Any]):
    """Many single-agent environments, stepped together: a `gymnasium.vector.VectorEnv`.

    Observations are batches by `observation_space`: an array (num_envs, ...) for each `Box` or `Discrete`; parts whose
    length varies are tuples of one for each environment, and a learner wants them wrapped (`wrap`). Arrays are the
    caller's own, which later steps leave alone. Infos and `autoreset_mode` are as in gymnasium's own vectors.
    """

    def __init__(self, stepper: Stepper, end: Callable[[], None]) -> None:
        super().__init__(stepper, end)
        described = stepper.description
        self.num_envs = stepper.count
        self.render_mode = described.render_mode
        self.metadata = {**described.metadata, "autoreset_mode": stepper.mode}
        self.autoreset_mode = stepper.mode  # gymnasium's own vectors have it, and TorchRL asks for it
        self.single_observation_space, self.single_action_space = described.observation, described.action
        try:
            self.observation_space = batch_space(described.observation, stepper.count)
            self.action_space = batch_space(described.action, stepper.count)
        except (CustomSpaceError, TypeError, ValueError) as error:
            raise InvalidValueError(f"the environment's spaces cannot be batched: {error}") from error

    def reset(
        self, *, seed: int | Sequence[int | None] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Any, dict[str, Any]]:
        """Begin episodes; see `MultiAgentVector.reset`.

        Returns:
            A batch of observations, by `observation_space`, and infos of the environments that began, as gymnasium's.

        Raises:
            LostEnvironmentsError: see there; it has no results if a lost environment has no observation yet.
        """
        observations, begun, lost = self._stepper.reset(seed, options)
        infos: dict[str, Any] = {}
        for index in sorted(begun):
            infos = self._add_info(infos, begun[index], index)
        if lost:
            whole = all(each is not None for each in observations)
            raise LostEnvironmentsError(lost, (self._batch(observations), infos) if whole else None)
        return self._batch(observations), infos

    def step(self, actions: Any) -> Results:
        """Step all environments; return observations, rewards, terminations, truncations (num_envs,) and infos.

        Args:
            actions: batch by `action_space`; see `MultiAgentVector.step` for refused actions and lost environments.
        """
        transitions, lost = self._stepper.step(self._split(actions))
        if lost:
            whole = all(each.observation is not None for each in transitions)
            raise LostEnvironmentsError(lost, self._results(transitions) if whole else None)
        return self._results(transitions)

    def _split(self, actions: Any) -> list[Any]:
        """Return the actions one by one."""
        try:
            split = list(iterate(self.action_space, actions))
        except (TypeError, ValueError, KeyError, IndexError) as error:
            raise InvalidActionError(f"actions must be a batch of {self.action_space}: {error}") from error
        if len(split) != self.num_envs:
            raise InvalidActionError(f"actions must be {self.num_envs}, one for each environment, got {len(split)}")
        return split

    def _results(self, transitions: Sequence[Transition]) -> Results:
        infos: dict[str, Any] = {}
        for index, each in enumerate(transitions):
            if each.final is not None:
                infos = self._add_info(infos, {"final_obs": each.final[0], "final_info": each.final[1]}, index)
            infos = self._add_info(infos, each.info, index)
        return (
            self._batch([each.observation for each in transitions]),
            np.array([each.reward for each in transitions], np.float64),
            np.array([each.terminated for each in transitions], np.bool_),
            np.array([each.truncated for each in transitions], np.bool_),
            infos,
        )

    def _batch(self, observations: Sequence[Any]) -> Any:
        space = self.single_observation_space
        empty: Any = create_empty_array(space, self.num_envs, fn=np.zeros)
        return concatenate(space, observations, empty)
