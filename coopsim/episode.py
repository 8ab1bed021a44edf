"""The one loop of an episode: an environment, a policy, and recorders that keep what they want of it.

Whatever measures, films, checks or exports a policy runs this loop, so that all of them see the same episode.
"""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from coopsim.support.rng import derived_seed
from coopsim.wire.actions import act_of

if TYPE_CHECKING:
    from coopsim.agents.policy import Policy
    from coopsim.envs.parallel import CooperativeEnv

ByAgent = Mapping[str, Any]


@dataclass(slots=True, eq=False)
class Episode:
    """A running episode, as recorders see it. They must not change it, and must not step the environment.

    Attributes:
        env: the environment.
        policy: the policy that acts for all agents.
        seed: seed of the episode.
        observations: packed observations by agent: the newest.
        infos: infos by agent, with the truth where the environment exposes it: the newest.
        actions: last report of the policy by agent; empty before the first.
        rewards: rewards of the last step by agent; empty before the first step.
        steps: number of steps so far, so that it numbers the frame whose observations are the newest.
        policy_s: wall time that the policy has taken so far.
        environment_s: wall time that the environment's steps have taken so far, with the uplinks in it.
    """

    env: CooperativeEnv
    policy: Policy
    seed: int
    observations: ByAgent
    infos: ByAgent
    actions: ByAgent = field(default_factory=dict)
    rewards: Mapping[str, float] = field(default_factory=dict)
    steps: int = 0
    policy_s: float = 0.0
    environment_s: float = 0.0


class Recorder:
    """Keeps what it wants of an episode. Override what you need; here nothing is kept."""

    def begin(self, episode: Episode) -> None:
        """Look at an episode before its first report."""

    def on_report(self, episode: Episode) -> None:
        """Look at what the policy has just reported for the newest frame, before the environment goes on."""

    def on_step(self, episode: Episode) -> None:
        """Look at the outcome of a step: the next frame, and the rewards for the report before it."""


def run_episode(
    env: CooperativeEnv,
    policy: Policy,
    recorders: Sequence[Recorder] = (),
    *,
    seed: int,
    most_steps: int | None = None,
    last_report: bool = False,
    options: Mapping[str, Any] | None = None,
) -> Episode:
    """Run a policy through one episode of an environment, which stays open.

    The environment is reset before the policy, as the policy is told the agents of the episode.

    Args:
        env: an environment that broadcasts what the policy needs, as with the option `uplink=policy`.
        policy: the policy.
        recorders: are told of every report and every step, in this order.
        seed: decides everything in the episode.
        most_steps: number of steps after which to stop; None: at the episode's end.
        last_report: let the policy report for the frame after the last step, too, which is not scored.
        options: options of the environment's `reset`.

    Raises:
        CoopsimError: the environment or the policy refuses what it was given.
    """
    observations, infos = env.reset(seed=seed, options=dict(options or {}))
    policy.reset(env.agent_specs, seed=derived_seed(seed, "policy"))
    episode = Episode(env, policy, seed, observations, infos)
    for each in recorders:
        each.begin(episode)
    while env.agents and (most_steps is None or episode.steps < most_steps):
        _report(episode, recorders)
        _step(episode, recorders)
    if last_report:
        _report(episode, recorders)
    return episode


def _report(episode: Episode, recorders: Sequence[Recorder]) -> None:
    started = time.perf_counter()
    episode.actions = act_of(episode.policy, episode.observations, episode.infos)
    episode.policy_s += time.perf_counter() - started
    for each in recorders:
        each.on_report(episode)


def _step(episode: Episode, recorders: Sequence[Recorder]) -> None:
    env = episode.env
    started = time.perf_counter()
    if hasattr(episode.policy, "judgements"):  # a policy with its own `act` may have none
        for agent, (trust, passes) in episode.policy.judgements(env.agents).items():
            env.note_trust(agent, trust, passes)
    episode.observations, episode.rewards, _, _, episode.infos = env.step(dict(episode.actions))
    episode.environment_s += time.perf_counter() - started
    episode.steps += 1
    for each in recorders:
        each.on_step(episode)
