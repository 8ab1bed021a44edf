"""Vectors of single-agent environments: gymnasium's `VectorEnv`."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, Self

import numpy as np
from gymnasium.error import CustomSpaceError
from gymnasium.vector import VectorEnv
from gymnasium.vector.utils import batch_space, concatenate, create_empty_array, iterate

from coopsim.envs.vector.group import Transition
from coopsim.envs.vector.stepper import Stepper
from coopsim.envs.vector.vector_calls import VectorCalls
from coopsim.errors import InvalidActionError, InvalidValueError, LostEnvironmentsError

Results = tuple[Any, np.ndarray[Any, Any], np.ndarray[Any, Any], np.ndarray[Any, Any], dict[str, Any]]


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
        """Begin episodes.

        Returns:
            A batch of observations, by `observation_space`, and infos of the environments that began, as gymnasium's.

        Args:
            seed: integer from 0 to 2**63 - 1, of which each episode's seed is derived by environment and episode; a
                list of one for each environment is of their first episodes themselves; None goes on with the next
                episodes (at first: the option `seed`, or a fresh one).
            options: of the environments' `reset`; `{"reset_mask": mask}`, an array (num_envs,) of bool, resets these
                environments alone: the others go on, with their last observations.

        Raises:
            InvalidValueError: a seed or an option is not accepted. All environments are as they were.
            UnknownNameError: an option's name or value is not known, or is nearly `reset_mask`.
            EpisodeStateError: the first reset is not of all environments, or the vector is closed.
            LostEnvironmentsError: an environment raised an error, or its worker died; the others have begun episodes.
                The error has the results of these, unless a lost one has no observation yet.
                Reset the lost ones by `reset_mask`; or the next `step` begins their episodes, unless autoreset is
                disabled.
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
            actions: a batch by `action_space`. That of an environment that begins an episode is passed over.

        Raises:
            EpisodeStateError: before `reset`, or an episode is over and autoreset is disabled.
            InvalidActionError: names the environment and what is wrong. If the number of actions is wrong, nothing has
                changed; otherwise the other environments have stepped, and the next call steps only those refused.
            LostEnvironmentsError: an environment raised an error, or its worker died. The error has the results of all,
                in which the lost one is truncated; the next call, or `reset`, begins its next episode.
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

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()
