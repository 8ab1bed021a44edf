"""The one loop of an episode: an environment, a policy, and recorders that keep what they want of it.

Whatever measures, films, checks or exports a policy runs this loop, so that all of them see the same episode. The
records that metrics read come out of `env.step` itself, so the loop that users write has them, too.
"""

from __future__ import annotations

import time
import weakref
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, Any

from coopsim.support.registry import Registry
from coopsim.support.rng import derived_seed
from coopsim.wire.actions import act_of, tracks_of

if TYPE_CHECKING:
    from coopsim.agents.policy import Policy
    from coopsim.envs.frames import Frame
    from coopsim.envs.parallel import CooperativeEnv
    from coopsim.types import Observation, Tracks
    from coopsim.types.lies import Lie

ByAgent = Mapping[str, Any]


class _NotKept:
    """Attribute that does not keep its value alive: an environment has its episode, and goes when nobody has it."""

    def __init__(self, name: str) -> None:
        self._name = f"_{name}"

    def __get__(self, instance: Any, owner: type | None = None) -> Any:
        return self if instance is None else vars(instance)[self._name]()

    def __set__(self, instance: Any, value: Any) -> None:
        vars(instance)[self._name] = weakref.ref(value)


@dataclass(eq=False)
class Episode:
    """A running episode, as recorders see it: `env.episode`. They must not change it, and must not step it.

    Attributes:
        env: the environment; None once nobody has it any more.
        seed: seed of the episode.
        frame: the newest frame, with the truth.
        received: what each agent has of it: own data, and the messages that arrived.
        observations: the same as it is packed for policies.
        infos: infos by agent, with the truth where the environment exposes it: the newest.
        lies: lies in the messages that were sent in the newest frame.
        facts: facts of the episode that its recorders know by name, such as `attackers`, agents that may lie, and
            `conflicts`, ids of the actors that a situation sends into the ego's way.
        policy: the policy that acts for all agents; None: the environment does not know it.
        actions: last report of the policy by agent; empty before the first.
        rewards: rewards of the last step by agent; empty before the first step.
        steps: number of steps so far, so that it numbers the frame whose observations are the newest.
        policy_s: wall time that the policy has taken so far, in `run_episode`.
        environment_s: wall time that the environment's steps have taken so far, with the uplinks in it.
        uplink_s: wall time that the making of messages has taken, as of the last step.
    """

    env: CooperativeEnv
    seed: int
    frame: Frame
    received: Mapping[str, Observation]
    observations: ByAgent
    infos: ByAgent
    lies: tuple[Lie, ...] = ()
    facts: Mapping[str, Any] = field(default_factory=dict)
    policy: Policy | None = None
    actions: ByAgent = field(default_factory=dict)
    rewards: Mapping[str, float] = field(default_factory=dict)
    steps: int = 0
    policy_s: float = 0.0
    environment_s: float = 0.0
    uplink_s: float = 0.0

    @cached_property
    def tracks(self) -> Mapping[str, Tracks]:
        """Tracks in the last report, by agent, each in the agent's base frame; empty before the first report."""
        return tracks_of(self.actions)

    def report(self, actions: ByAgent, tracks: Mapping[str, Tracks] | None = None) -> None:
        """Take over the policy's report for the newest frame, and its tracks where they are unpacked already."""
        self.actions = actions
        self.__dict__.pop("tracks", None)
        if tracks is not None:
            self.__dict__["tracks"] = tracks

    def go_on(self, frame: Frame, received: Mapping[str, Observation], **newest: Any) -> None:
        """Take over the next frame, and by name what else is new: observations, infos, rewards, lies."""
        vars(self).update(newest, frame=frame, received=received, steps=self.steps + 1)


Episode.env = _NotKept("env")  # type: ignore[assignment]  # the field's values go through it


class Recorder:
    """Keeps what it wants of an episode. Override what you need; here nothing is kept.

    A recorder that is registered in `RECORDERS` makes records for metrics: each episode has a new object of it, made
    without arguments, where a metric names it. Others are given to `run_episode` or `evaluate`.
    """

    def begin(self, episode: Episode) -> None:
        """Look at an episode before its first report."""

    def on_report(self, episode: Episode) -> None:
        """Look at what the policy has just reported for the newest frame, before the environment goes on."""

    def on_step(self, episode: Episode) -> None:
        """Look at the outcome of a step: the next frame, and the rewards for the report before it."""

    def records(self) -> Mapping[str, Any]:
        """Return what was kept of each agent; an agent of which there is nothing to say is left out."""
        return {}


RECORDERS: Registry[type[Recorder]] = Registry("recorder", home="coopsim.metrics.recorders", group="coopsim.recorders")
"""Classes of recorders by name; an installed package adds its own by the entry-point group `coopsim.recorders`."""

Records = Mapping[str, Mapping[str, Any]]
"""Records by the recorder's name and by agent."""


def run_episode(
    env: CooperativeEnv,
    policy: Policy,
    recorders: Sequence[Recorder] = (),
    *,
    seed: int | None = None,
    most_steps: int | None = None,
    last_report: bool = False,
    options: Mapping[str, Any] | None = None,
) -> Episode:
    """Run a policy through one episode of an environment, which stays open: `env.score()` has the score.

    The environment is reset before the policy, as the policy is told the agents of the episode.

    Args:
        env: an environment that broadcasts what the policy needs, as with the option `uplink=policy`.
        policy: the policy.
        recorders: are told of every report and every step, in this order.
        seed: decides everything in the episode; None: the environment's option `seed`, or 0.
        most_steps: number of steps after which to stop; None: at the episode's end.
        last_report: let the policy report for the frame after the last step, too, which is not scored.
        options: options of the environment's `reset`.

    Raises:
        CoopsimError: the environment or the policy refuses what it was given.
    """
    seed = (env.default_seed or 0) if seed is None else seed
    observations, infos = env.reset(seed=seed, options=dict(options or {}))
    policy.reset(env.agent_specs, seed=policy_seed(seed))
    episode = env.episode
    episode.policy, episode.observations, episode.infos = policy, observations, infos
    for each in recorders:
        each.begin(episode)
    while env.agents and (most_steps is None or episode.steps < most_steps):
        _report(episode, policy, recorders)
        _step(episode, recorders)
    if last_report:
        _report(episode, policy, recorders)
    return episode


def policy_seed(seed: int) -> int:
    """Return the seed of the policies in an episode: it decides what they draw, and tells nothing of the world's."""
    return derived_seed(seed, "policy")


def _report(episode: Episode, policy: Policy, recorders: Sequence[Recorder]) -> None:
    started = time.perf_counter()
    episode.report(act_of(policy, episode.observations, episode.infos))
    episode.policy_s += time.perf_counter() - started
    for each in recorders:
        each.on_report(episode)


def _step(episode: Episode, recorders: Sequence[Recorder]) -> None:
    started = time.perf_counter()
    episode.observations, episode.rewards, _, _, episode.infos = episode.env.step(dict(episode.actions))
    episode.environment_s += time.perf_counter() - started
    for each in recorders:
        each.on_step(episode)
