"""Evaluation of a policy over whole episodes: in simulation, or on recordings."""

from __future__ import annotations

import time
import warnings
from collections import defaultdict
from collections.abc import Callable, Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from coopsim.catalog import PolicySpec, usual_seed
from coopsim.comms.channel.channel import ChannelCounts
from coopsim.episode import Episode, Recorder, run_episode
from coopsim.errors import InvalidValueError
from coopsim.geometry.boxes import Boxes3D
from coopsim.geometry.se3 import Floats
from coopsim.metrics.evaluator import Evaluator
from coopsim.metrics.recorders import TRACKS
from coopsim.metrics.score import Score, summarize
from coopsim.provided import listening_env
from coopsim.support.checks import require_choice
from coopsim.types import NS_PER_S, GroundTruth, Tracks

if TYPE_CHECKING:
    from coopsim.agents.policy import Policy
    from coopsim.envs.parallel import CooperativeEnv

OnFrame = Callable[["CooperativeEnv"], None]
"""A function that is called after every step, and must not step itself; a recorder replaces it."""


@dataclass(frozen=True, slots=True, eq=False)
class Evaluation:
    """The evaluation of one policy in one episode.

    Attributes:
        score: score of each agent, and their mean.
        rewards: (F,) mean over agents, per frame.
        frames: number of frames.
        seconds: wall time of environment and policy together, without making them.
        messages: counts of sent, lost, delivered, ... messages, each counted per receiver; `rejected` are those that
            the policy could not read.
        links: counts of messages by link: sender and receiver.
        place_seed: seed of the drawn place of the episode; None: the place is not drawn.
        counts: counters of the policy, by name (`Policy.counts`).
        method: the method of a paper, or part of one, that the policy is (`Policy.method`).
        bound: the policy was told the truth, so that its scores are an upper bound (`Needs.truth`).
    """

    score: Score
    rewards: Floats
    frames: int
    seconds: float
    messages: ChannelCounts
    links: Mapping[tuple[str, str], ChannelCounts] = field(default_factory=dict)
    place_seed: int | None = None
    counts: Mapping[str, int] = field(default_factory=dict)
    method: str = ""
    bound: bool = False

    @property
    def frames_per_s(self) -> float:
        """Frames per second of wall time."""
        return self.frames / self.seconds


@dataclass(frozen=True, slots=True, eq=False)
class RecordingsEvaluation:
    """The evaluation of one policy on a set of recordings, pooled.

    Attributes:
        count: the score with false positives counted.
        ignore: the score with false positives ignored, to compare with tables that do so.
        frames: number of frames, over all sequences.
        seconds: wall time of tracking and scoring, without reading files.
        method: the method of a paper, or part of one, that the policy is (`Policy.method`).
        bound: the policy was told the truth (`Needs.truth`).
    """

    count: Score
    ignore: Score
    frames: int
    seconds: float
    method: str = ""
    bound: bool = False

    @property
    def frames_per_s(self) -> float:
        """Frames per second of wall time."""
        return self.frames / self.seconds


def evaluate(
    policy: Policy | str,
    environment: str = "crossing",
    *,
    seed: int | None = None,
    on_frame: OnFrame | None = None,
    recorders: Sequence[Recorder] = (),
    **options: Any,
) -> Evaluation:
    """Run a policy through one episode of an environment that broadcasts what the policy needs.

    Cameras are drawn only for a policy that needs them (`Policy.needs`), or where `cameras` asks for others.

    Args:
        policy: a policy, or a text for `PolicySpec`: its name with parameters, or the place of its class.
        environment: name of the environment.
        seed: decides everything in the episode; None: 0, or the scenario file's.
        on_frame: will go: give a recorder with `on_step`.
        recorders: keep what they want of the episode.
        **options: options of the environment, but not `uplink`, which the policy decides.

    Raises:
        CoopsimError: a name is unknown or a value is not accepted; the message says what is accepted.
    """
    policy = _instance(policy)
    seed = usual_seed(environment) if seed is None else seed
    with closing(listening_env(environment, policy, options)) as env:
        return _evaluate(env, policy, seed, (*recorders, *_watching(on_frame)))


def rollout(env: CooperativeEnv, policy: Policy | str, seed: int | None = None) -> Evaluation:
    """Run a policy through one episode of an environment, which stays open. Use `coopsim.run_episode` instead."""
    warnings.warn("coopsim.rollout will go: use coopsim.run_episode, then env.score()", DeprecationWarning, 2)
    return _evaluate(env, _instance(policy), seed)


def _evaluate(env: CooperativeEnv, policy: Policy, seed: int | None, recorders: Sequence[Recorder] = ()) -> Evaluation:
    _warm_up()
    kept = _Rewards()
    episode = run_episode(env, policy, (*recorders, kept), seed=seed)
    # A policy with its own `act` may not count.
    rejected, counts = getattr(policy, "rejected", {}), getattr(policy, "counts", {})
    return Evaluation(
        env.score(),
        np.array(kept.rewards),
        len(kept.rewards),
        episode.policy_s + episode.environment_s,
        replace(env.channel_counts, rejected=sum(rejected.values())),
        env.link_counts,
        env.episode_infos.get("place_seed"),
        dict(counts),
        policy.method,
        policy.needs.truth,
    )


def evaluate_recordings(
    policy: Policy | str,
    path: str | Path,
    detections: Sequence[str] | None = None,
    *,
    sequences: Sequence[str] | None = None,
    seed: int = 0,
    on_frame: OnFrame | None = None,
    recorders: Sequence[Recorder] = (),
    **options: Any,
) -> RecordingsEvaluation:
    """Run a policy over the sequences of a folder of recordings and pool the scores.

    Args:
        policy: a policy, or a text for `PolicySpec`: its name with parameters, or the place of its class.
        path: the folder.
        detections: name under `detections/` of recordings in text files, or several; each is one agent. None:
            recordings with sweeps, whose agents are their own.
        sequences: names of those to play; None: all.
        seed: decides losses and delays of the channel.
        on_frame: will go: give a recorder with `on_step`.
        recorders: keep what they want of every sequence.
        **options: options of the replay environment, but not `uplink`, which the policy decides.

    Raises:
        CoopsimError: a name is unknown, a value is not accepted, or a file is broken.
    """
    policy, recorders = _instance(policy), (*recorders, *_watching(on_frame))
    env = listening_env("replay", policy, replay_keywords(path, detections, options))
    _warm_up()
    kept: dict[str, dict[str, list[Any]]] = {agent: defaultdict(list) for agent in env.possible_agents}
    sent_bytes, on_air_s = dict.fromkeys(kept, 0.0), dict.fromkeys(kept, 0.0)
    dt_s = next(iter(env.agent_specs.values())).dt_s
    seconds, frames = 0.0, 0
    try:
        for sequence in env.sequences if sequences is None else sequences:
            require_choice("sequence", sequence, env.sequences)
            episode = run_episode(env, policy, recorders, seed=seed, options={"sequence": sequence})
            episode_s = env.time_ns / NS_PER_S + dt_s
            seconds, frames = seconds + episode.policy_s + episode.environment_s, frames + episode.steps
            for name, records in env.records.items():
                for agent, record in records.items():
                    kept[agent][name].append(record)
            for agent in env.logs:  # of the sequence's own agents
                sent_bytes[agent] += env.bytes_per_s(agent) * episode_s
                on_air_s[agent] += episode_s
    finally:
        env.close()
    started = time.perf_counter()
    if not frames:
        raise InvalidValueError("sequences must name at least one, got none")
    count = Score.mean(
        {
            agent: summarize(records.pop(TRACKS), bytes_per_s=sent_bytes[agent] / on_air_s[agent], records=records)
            for agent, records in kept.items()
            if records
        }
    )
    ignore = count.ignoring_false_positives()
    seconds += time.perf_counter() - started
    return RecordingsEvaluation(count, ignore, frames, seconds, policy.method, policy.needs.truth)


def replay_keywords(path: str | Path, detections: Sequence[str] | None, options: Mapping[str, Any]) -> dict[str, Any]:
    """Return the options of the replay of a folder, which has detections in text files or not."""
    return {"path": path, **({} if detections is None else {"detections": detections}), **options}


class _Rewards(Recorder):
    """Mean rewards over agents, of each frame."""

    def __init__(self) -> None:
        self.rewards: list[float] = []

    def on_step(self, episode: Episode) -> None:
        self.rewards.append(float(np.mean(list(episode.rewards.values()))))


def _watching(on_frame: OnFrame | None) -> list[Recorder]:
    """Return a recorder that calls a caller's function after every step; none without one."""
    if on_frame is None:
        return []
    warnings.warn("on_frame will go: give recorders=[...] with one that has on_step", DeprecationWarning, stacklevel=3)
    watcher = Recorder()
    watcher.on_step = lambda episode: on_frame(episode.env)  # type: ignore[method-assign]
    return [watcher]


def _warm_up() -> None:
    """Compile the metrics before a clock runs, which takes seconds once on a machine."""
    box, zero = Boxes3D.from_array([[0.0, 0.0, 0.0, 4.0, 2.0, 1.5, 0.0]]), np.zeros(1, dtype=np.int64)
    evaluator = Evaluator()
    evaluator.update(GroundTruth(zero, box, zero), Tracks(zero, box, np.zeros((1, 2)), np.ones(1), zero))
    summarize([evaluator.log])


def _instance(policy: Policy | str) -> Policy:
    if isinstance(policy, str):
        return PolicySpec.parse(policy).make()
    if isinstance(policy, type):
        raise InvalidValueError(f"policy must be an object, got the class {policy.__name__}: write {policy.__name__}()")
    if not hasattr(policy, "act"):
        raise InvalidValueError(f"policy must be a coopsim.Policy or the name of one, got {policy!r}")
    return policy
