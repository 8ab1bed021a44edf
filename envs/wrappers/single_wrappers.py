"""Wrappers of the single-agent environment that give it another form of observations or actions."""

from __future__ import annotations

from copy import deepcopy
from typing import Any

import gymnasium
from gymnasium.utils import RecordConstructorArgs

from coopsim.envs.wrappers.forms import ActionForm, ObservationForm, cooperative_env


class ObservingSingle(gymnasium.Wrapper[Any, Any, Any, Any], RecordConstructorArgs):
    """The single-agent environment with another form of observations.

    Args:
        env: the environment.
        form: of the observations; a copy is made.
    """

    def __init__(self, env: gymnasium.Env[Any, Any], form: ObservationForm) -> None:
        RecordConstructorArgs.__init__(self, form=form)  # of which env.spec makes the wrapper again
        super().__init__(env)
        self._cooperative, self.form = cooperative_env(env), deepcopy(form)
        self.observation_space = self.form.space(env.observation_space)

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Any, dict[str, Any]]:
        """Begin an episode; see `SingleAgentEnv.reset`."""
        observation, info = self.env.reset(seed=seed, options=options)
        self.form.begin(self._cooperative)
        return self._observed(observation), info

    def step(self, action: Any) -> tuple[Any, Any, bool, bool, dict[str, Any]]:
        """Go to the next frame; see `SingleAgentEnv.step`."""
        observation, reward, terminated, truncated, info = self.env.step(action)
        return self._observed(observation), reward, terminated, truncated, info

    def _observed(self, observation: Any) -> Any:
        return self.form.observe(self.get_wrapper_attr("ego"), observation)


class ActingSingle(gymnasium.Wrapper[Any, Any, Any, Any], RecordConstructorArgs):
    """The single-agent environment with another form of actions.

    Args:
        env: the environment.
        form: of the actions; a copy is made.
    """

    def __init__(self, env: gymnasium.Env[Any, Any], form: ActionForm) -> None:
        RecordConstructorArgs.__init__(self, form=form)  # of which env.spec makes the wrapper again
        super().__init__(env)
        cooperative_env(env)
        self.form = deepcopy(form)
        self.action_space = self.form.space(env.action_space)

    def step(self, action: Any) -> tuple[Any, Any, bool, bool, dict[str, Any]]:
        """Go to the next frame; see `SingleAgentEnv.step`."""
        return self.env.step(self.form.act(self.get_wrapper_attr("ego"), action, self.action_space))
