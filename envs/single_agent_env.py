"""The single-agent environment: gymnasium's API for one agent of a cooperative environment."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from coopsim.agents.policy import Policy
from coopsim.envs.ego_step import EgoStep
from coopsim.envs.frames import TRUTH_INFOS
from coopsim.envs.parallel import CooperativeEnv
from coopsim.envs.rewards import warn_of_tracking_reward
from coopsim.envs.roles import Others, PolicyLike, Roles, make_provided
from coopsim.errors import CoopsimError, EpisodeStateError, InvalidActionError, InvalidValueError
from coopsim.support.checks import require_choice
from coopsim.support.rng import require_seed
from coopsim.types import AgentSpec, Tracks
from coopsim.viz.caption import with_caption
from coopsim.wire.actions import MESSAGE, act_of, idle, pack_tracks, unpack_action

Packed = dict[str, Any]

_OVER = "the episode is over: call reset to begin another"
_HALFWAY = "the last step ended halfway in an error: call reset to begin an episode"


class SingleAgentEnv(gymnasium.Env[Packed, Any]):
    """An environment in which one agent, the ego, acts, and the others follow given policies.

    Observation, reward and info are the ego's own in `CooperativeEnv`; sweeps and cameras are left out of the
    observation where there are none. The action is the ego's, too, a dict with `tracks` and, for
    a car that its action drives, its command, and with `uplink="action"` its `message`. With a `tracker` it is the
    command alone: the maneuver, `Discrete(5)`, or under `control="acceleration"` the acceleration in m/s²,
    `Box(-8, 3, (1,))`; or the message alone; or a dict with both.

    Where the options `uplink` and `cameras` are not given, the policies decide them. Every agent broadcasts what its
    policy makes; one without a policy that reads messages broadcasts the same kind of content.

    A seed gives the same episode as in the environment of all agents. `reset` without a seed draws the next episode's
    seed from `np_random`, or takes the option `seed`.

    Attributes:
        parallel: the environment of all agents: its `score()`, `agent_specs`, `bev_frame()` and more.
        ego: name of the agent that acts.
        policies: policies of the agents that have one; the ego's is the tracker.

    Args:
        environment: name of the environment or path of a scenario file, see `coopsim.parallel_env`.
        ego: name of the agent that acts; None: the first of `possible_agents`.
        others: the other agents' policy: a name or spec ("late_fusion(merge_iou=0.2)"), a `Policy`, a mapping of agents
            to either, or None. Agents without a policy report nothing. Agents with equal specs share one policy. A
            `Policy` is copied, so that two environments never share its state.
        tracker: a policy that reports the ego's tracks, so that the learner only drives; needs `control="policy"` or
            "acceleration".
        **options: options of the environment, see `coopsim.parallel_env`.

    Raises:
        UnknownNameError: no such environment, ego, agent, policy or option; the message lists the close ones.
        InvalidValueError: a value is not accepted, or the tracker leaves nothing for the ego to decide.
        PolicyMismatchError: two policies need different things, or the environment or the options exclude what one
            needs.
    """

    observation_space: spaces.Dict
    metadata: dict[str, Any] = {  # noqa: RUF012  # gymnasium reads it of the class, which an object may override
        "render_modes": ["rgb_array", "human"],
        "render_fps": 10,
    }

    def __init__(
        self,
        environment: str | Path,
        *,
        ego: str | None = None,
        others: Others = None,
        tracker: PolicyLike = None,
        **options: Any,
    ) -> None:
        roles = Roles.make(tracker, others)
        self.parallel, broadcasts = make_provided(environment, roles.by_name, options)
        try:
            self.ego = _chosen_ego(self.parallel, ego)
            self.policies = _assigned(roles, self.parallel.possible_agents, self.ego)
            specs = self.parallel.agent_specs
            self._left = _left_by_tracker(specs[self.ego])
            if tracker is not None and not self._left:
                raise InvalidValueError(
                    f"tracker leaves only driving and messages to the ego, and {self.ego} does not drive: leave out "
                    'tracker, or make a simulation with control="policy" or "acceleration" and a car as ego, or an '
                    'environment with uplink="action"'
                )
        except CoopsimError:
            self.parallel.close()
            raise
        if tracker is not None and specs[self.ego].command is not None and self.parallel.has_default_reward:
            warn_of_tracking_reward()
        if broadcasts is not None:
            broadcasts.by_agent = {name: each for name, each in self.policies.items() if each.needs.uplink != "none"}
        self._hides_truth = any(each.needs.truth for each in self.policies.values()) and not options.get(
            "expose_ground_truth"
        )
        self._groups = _groups(self.policies)
        self._silent = {name: _silence(spec) for name, spec in specs.items() if name not in self.policies}
        self._tracked = tracker is not None
        self.metadata = type(self).metadata | {"render_fps": self.parallel.metadata["render_fps"]}
        self.render_mode = self.parallel.render_mode
        self.observation_space = _without_empty(self.parallel.observation_space(self.ego))
        whole = self.parallel.action_space(self.ego)
        self.action_space = whole if tracker is None else _part_of(whole, self._left)
        self._observations: dict[str, Packed] = {}
        self._present: tuple[str, ...] = ()
        self._infos: dict[str, dict[str, Any]] = {}
        self._policies_actions: dict[str, Packed] | None = None
        self._shown: EgoStep
        self._refusal: str | None = "there is no episode yet: call reset first"

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Packed, dict[str, Any]]:
        """Begin an episode; return the ego's observation and info, which has the episode's `seed`.

        Args:
            seed: integer >= 0 that decides everything: this episode, and those of the calls without a seed after it.
            options: options of `CooperativeEnv.reset`.

        Raises:
            CoopsimError: `CooperativeEnv.reset` refuses it.
            EpisodeStateError: the ego is not in the episode's first frame.
        """
        if seed is not None:
            require_seed(seed)
        of_episode = self._next_seed() if seed is None else int(seed)
        observations, infos = self.parallel.reset(of_episode, options)
        super().reset(seed=None if seed is None else of_episode)
        self._refusal = "the last reset ended halfway in an error: call reset to begin an episode"
        for policy, _ in self._groups:
            policy.reset(self.parallel.agent_specs, seed=self.parallel.policy_seed)
        if self.ego not in observations:
            raise EpisodeStateError(f"{self.ego} is not in the episode's first frame: {sorted(observations)} are")
        self._observations, self._policies_actions, self._refusal = observations, None, None
        self._present, self._infos = tuple(observations), infos
        self._show()
        return self._own(observations[self.ego]), self._told(infos[self.ego])

    def step(self, action: Any) -> tuple[Packed, float, bool, bool, dict[str, Any]]:
        """Act, let the others act, and go to the next frame.

        The episode is truncated at its last frame, or when the ego is no more in it: then the observation is the last
        one again.

        Raises:
            EpisodeStateError: there is no running episode.
            InvalidActionError: says what is wrong. The environment and the policies are as they were before.
        """
        if self._refusal is not None:
            raise EpisodeStateError(self._refusal)
        policies_actions = self._ask_policies()
        actions = policies_actions | {self.ego: self._whole(action, policies_actions)}
        self._show()
        observations, rewards, terminations, truncations, infos = self.parallel.step(actions)
        self._show(actions[self.ego], rewards[self.ego])
        self._observations, self._policies_actions = self._observations | observations, None
        self._present, self._infos = tuple(observations), infos
        terminated = terminations[self.ego]
        truncated = not terminated and (truncations[self.ego] or self.ego not in self.parallel.agents)
        if terminated or truncated:
            self._refusal = _OVER
        seen, told = self._own(self._observations[self.ego]), self._told(infos[self.ego])
        return seen, rewards[self.ego], terminated, truncated, told

    def reported_tracks(self, agent: str) -> Tracks:
        """Return the tracks that an agent's policy reports for the last observation, in the agent's base frame.

        Raises:
            UnknownNameError: no policy reports the tracks of this agent; the message lists those that have one.
            EpisodeStateError: there is no episode yet, or the last step ended halfway in an error.
        """
        require_choice("agent with a policy", agent, self.policies)
        if self._refusal not in (None, _OVER):
            raise EpisodeStateError(str(self._refusal))
        return unpack_action(agent, {"tracks": self._ask_policies()[agent]["tracks"]})[0]

    def render(self) -> NDArray[np.uint8] | None:
        """Draw the scene about the ego, see `CooperativeEnv.render`, with its speed, its action and its reward.

        They are of the frame that is shown. A window (`render_mode="human"`) has no caption.
        """
        picture = self.parallel.render(self.ego)
        return None if picture is None else with_caption(picture, self._shown.lines)

    def close(self) -> None:
        """Close the window and release the sensors' resources."""
        self.parallel.close()

    def _show(self, action: Packed | None = None, reward: float | None = None) -> None:
        """Note the ego's car in the current frame, before its step, or the action and reward of the step, after it."""
        if self.render_mode != "rgb_array":
            return
        if action is None:
            self._shown = EgoStep(self.ego, self.parallel.cars.get(self.ego))
            return
        command = self.parallel.agent_specs[self.ego].command
        given = None if command is None else np.asarray(action[command]).ravel().tolist()
        given = given if given is None else tuple(given) if len(given) > 1 else given[0]
        self._shown = EgoStep(self.ego, self._shown.car, given, reward)

    def _next_seed(self) -> int:
        usual = self.parallel.default_seed
        return int(self.np_random.integers(2**32)) if usual is None else usual

    def _ask_policies(self) -> dict[str, Packed]:
        """Return the actions of all agents that are present; those without a policy report nothing."""
        if self._policies_actions is None:
            refusal, self._refusal = self._refusal, _HALFWAY
            self._policies_actions = self._asked()
            self._refusal = refusal
        return self._policies_actions

    def _asked(self) -> dict[str, Packed]:
        actions = {agent: action for agent, action in self._silent.items() if agent in self._present}
        for policy, served in self._groups:
            if seen := {agent: self._observations[agent] for agent in served if agent in self._present}:
                actions |= act_of(policy, seen, self._infos)
        return actions

    def _told(self, info: dict[str, Any]) -> dict[str, Any]:
        """Return the ego's info: without the truth that is there only because a policy needs it."""
        return {key: each for key, each in info.items() if not (self._hides_truth and key in TRUTH_INFOS)}

    def _own(self, packed: Packed) -> Packed:
        """Return a copy of the observation: gymnasium wants no two to share an array, and a recording repeats its."""
        return {key: _copied(packed[key]) for key in self.observation_space}

    def _whole(self, action: Any, policies_actions: Mapping[str, Packed]) -> Any:
        """Return the ego's action as the environment of all agents takes it, which checks it."""
        if not self._tracked:
            return action
        if isinstance(action, np.ndarray) and action.shape == ():  # gymnasium counts these as elements of Discrete
            action = action[()]
        if len(self._left) == 1:
            return policies_actions[self.ego] | {self._left[0]: action}
        if not isinstance(action, Mapping) or set(action) != set(self._left):
            got = sorted(map(str, action)) if isinstance(action, Mapping) else repr(action)
            raise InvalidActionError(f"{self.ego}: an action is a dict with {sorted(self._left)}, got {got}")
        return policies_actions[self.ego] | dict(action)


def _chosen_ego(env: CooperativeEnv, ego: object) -> str:
    if ego is None:
        first: str = env.possible_agents[0]
        return first
    require_choice("ego", ego, env.possible_agents)
    return str(ego)


def _assigned(roles: Roles, agents: list[str], ego: str) -> dict[str, Policy]:
    """Return the policies by agent."""
    for agent in roles.others:
        if agent == ego:
            raise InvalidValueError(f"others must not have the ego {ego!r}, which acts itself; tracker= can help it")
        require_choice("agent in others", agent, agents)
    assigned = {agent: roles.of(agent, ego=ego) for agent in agents}
    return {agent: policy for agent, policy in assigned.items() if policy is not None}


def _groups(policies: Mapping[str, Policy]) -> list[tuple[Policy, list[str]]]:
    """Return each policy with the agents that it serves, told apart by identity: policies may compare as equal."""
    served: dict[int, tuple[Policy, list[str]]] = {}
    for agent, policy in policies.items():
        served.setdefault(id(policy), (policy, []))[1].append(agent)
    return list(served.values())


def _left_by_tracker(spec: AgentSpec) -> tuple[str, ...]:
    """Return the parts of an agent's action that are left to it where a policy tracks."""
    command = () if spec.command is None else (spec.command,)
    return command if spec.message is None else (*command, MESSAGE)


def _part_of(space: spaces.Dict, parts: Sequence[str]) -> spaces.Space[Any]:
    return space[parts[0]] if len(parts) == 1 else spaces.Dict({name: space[name] for name in parts})


def _silence(spec: AgentSpec) -> Packed:
    """Return the action that reports nothing, changes nothing and says nothing."""
    nothing: Packed = {"tracks": pack_tracks(Tracks.empty())}
    if spec.command is not None:
        nothing[spec.command] = idle(spec.command)
    return nothing if spec.message is None else nothing | {MESSAGE: None}


def _without_empty(space: spaces.Dict) -> spaces.Dict:
    """Return the space without its parts that are always empty, sweeps or cameras: gymnasium refuses these."""
    return spaces.Dict({key: each for key, each in space.items() if not isinstance(each, spaces.Dict) or len(each)})


def _copied(value: Any) -> Any:
    if isinstance(value, Mapping):
        return {key: _copied(each) for key, each in value.items()}
    return value.copy() if isinstance(value, np.ndarray) else value


def single_env(
    name: str | Path,
    /,
    *,
    ego: str | None = None,
    others: Others = None,
    tracker: PolicyLike = None,
    **options: Any,
) -> SingleAgentEnv:
    """Make the environment called `name` for one agent that learns, with gymnasium's API; the others follow policies.

    Args:
        name: name of the environment, see `coopsim.parallel_env`.
        ego: name of the agent that acts; None: the first one.
        others: the policy of the other agents, by name, spec or object; a mapping of agents to such policies; or None:
            they report nothing.
        tracker: a policy that reports the ego's tracks, so that the learner only drives; needs `control="policy"`.
        **options: options of `coopsim.parallel_env`.

    Raises:
        CoopsimError: an error of `coopsim.parallel_env`, or of `SingleAgentEnv`.
    """
    return SingleAgentEnv(name, ego=ego, others=others, tracker=tracker, **options)
