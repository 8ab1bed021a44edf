"""The conformance check of a policy."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Mapping
from contextlib import closing
from copy import deepcopy
from typing import TYPE_CHECKING, Any

import numpy as np

from coopsim.catalog import PolicySpec
from coopsim.comms.channel.channel_config import ChannelConfig
from coopsim.comms.channel.latency import GaussianLatency
from coopsim.comms.channel.loss import BernoulliLoss
from coopsim.episode import Episode as RunningEpisode
from coopsim.episode import Recorder, run_episode
from coopsim.errors import CoopsimError
from coopsim.geometry.se3 import wrap_angle
from coopsim.provided import listening_env
from coopsim.testing.harness import SMALL, Episode, digest, name_of, require_same, untouched
from coopsim.types import Tracks
from coopsim.wire.actions import unpack_action

if TYPE_CHECKING:
    from coopsim.agents.policy import Policy
    from coopsim.comms.uplinks.uplink import Uplink
    from coopsim.types import AgentSpec

_ROUGH = ChannelConfig(GaussianLatency(0.15, 0.1), BernoulliLoss(0.3), duplication=0.3)

_TOLERANCE = 1e-2  # m, rad, m/s and of scores


def check_policy(policy: str | Policy | Callable[[], Policy], environment: str = "crossing", **options: Any) -> None:
    """Check that a policy keeps what environments rely on.

    It must report valid tracks for every agent: over an ideal channel, over one with losses, delays and duplicates,
    alone, and among unreadable messages. Observations must stay as they are. The same seed must give the
    same tracks again after `reset`, whatever episodes were before, and whatever the order in which agents are asked.
    One object for each agent, given that agent's observation alone, must report the same as one object for all: what
    one agent knows of another has come over the channel. Of a policy given as an object, deep copies are made.

    Args:
        policy: a registered name or spec, an object, or a class or function that makes one.
        environment: name of the environment.
        **options: options of the environment.

    Raises:
        AssertionError: a check failed; the message names it.
        CoopsimError: there is no such policy, or the environment cannot give what it needs.
    """
    made, name = _make(policy), name_of(policy)
    given = {**SMALL, "max_cycles": 6, **({} if made.needs.lidar else {"lidar": None}), **options}
    first = _play(made, name, environment, given)
    rough = {**given, "channel": _ROUGH}
    together = _play(made, name, environment, rough)
    _play(made, name, environment, {**given, "communication_range_m": 0.0})
    _play(made, name, environment, given, spoil=True)
    again = _play(made, name, environment, given)
    require_same(first, again, f"{name} must report the same again after reset", _differ)
    fresh = made if not (isinstance(policy, str) or callable(policy)) else _make(policy)
    anew = _play(fresh, name, environment, given)
    require_same(first, anew, f"{name} must report the same with the same seed", _differ)
    backwards = _play(made, name, environment, given, backwards=True)
    require_same(first, backwards, f"{name} must not depend on the order in which agents are asked", _differ)
    apart: Any = _OneForEach(lambda: _make(policy) if made is not policy else deepcopy(made))
    alone = _play(apart, name, environment, rough)
    rule = f"{name} must report for an agent what it does without the others' observations, as messages are all it gets"
    require_same(together, alone, rule, _differ_more)


class _OneForEach:
    """A policy for each agent, which acts and sends for that agent alone, behind the methods of one policy."""

    def __init__(self, make: Callable[[], Policy]) -> None:
        self._make, self.needs = make, make().needs
        self._each: dict[str, Policy] = {}

    def _of(self, agent: str) -> Policy:
        if agent not in self._each:
            self._each[agent] = self._make()
        return self._each[agent]

    def make_uplink(self, spec: AgentSpec, rng: np.random.Generator) -> Uplink:
        return self._of(spec.name).make_uplink(spec, rng)

    def require(self, specs: Mapping[str, AgentSpec]) -> None:
        self._make().require(specs)

    def reset(self, specs: Mapping[str, AgentSpec], seed: int) -> None:
        for name in specs:
            self._of(name).reset(specs, seed=seed)

    def act(self, observations: Mapping[str, Any], *infos: Mapping[str, Any]) -> dict[str, Any]:
        return {name: self._of(name).act({name: packed}, *infos)[name] for name, packed in observations.items()}


def _make(policy: str | Policy | Callable[[], Policy]) -> Policy:
    if isinstance(policy, str):
        return PolicySpec.parse(policy).make()
    made: Any = policy() if inspect.isclass(policy) or inspect.isroutine(policy) else policy
    assert hasattr(made, "act") and hasattr(made, "needs"), f"a policy must be a coopsim.Policy, got {made!r}"
    return made  # type: ignore[no-any-return]


def _play(
    policy: Policy,
    name: str,
    environment: str,
    options: Mapping[str, Any],
    *,
    spoil: bool = False,
    backwards: bool = False,
) -> Episode:
    """Run one episode, and check every report."""
    watched: Any = _Watched(policy, name, spoil, backwards)
    reports = _Reports(name)
    with closing(listening_env(environment, policy, options)) as env:
        run_episode(env, watched, (reports,), seed=5)
    return reports.frames


class _Reports(Recorder):
    """The reports of an episode, each checked."""

    def __init__(self, name: str) -> None:
        self.frames: list[dict[str, Tracks]] = []
        self._name = name

    def on_report(self, episode: RunningEpisode) -> None:
        commands = {agent: episode.env.agent_specs[agent].command for agent in episode.observations}
        self.frames.append(_reports(self._name, dict(episode.actions), commands))


class _Watched:
    """A policy whose every call is checked; with unreadable messages or in reverse order, if asked for."""

    def __init__(self, policy: Policy, name: str, spoil: bool, backwards: bool) -> None:
        self._policy, self._name, self._spoil, self._backwards = policy, name, spoil, backwards
        self.needs, self.reset = policy.needs, policy.reset

    def act(self, observations: Mapping[str, Any], *infos: Mapping[str, Any]) -> dict[str, Any]:
        name = self._name
        given = {agent: _spoiled(each) for agent, each in observations.items()} if self._spoil else observations
        asked = dict(reversed(list(given.items()))) if self._backwards else given
        with untouched(asked, f"{name} must leave its observations as they are"):
            try:
                actions = self._policy.act(asked, *infos)
            except Exception as error:
                raise AssertionError(f"{name} must report tracks, got {type(error).__name__}: {error}") from error
        assert actions.keys() == asked.keys(), f"{name} must act for {sorted(asked)}, got {sorted(actions)}"
        return actions


def _reports(name: str, actions: Mapping[str, Any], commands: Mapping[str, str | None]) -> dict[str, Tracks]:
    try:
        return {agent: unpack_action(agent, action, commands[agent])[0] for agent, action in actions.items()}
    except CoopsimError as error:
        raise AssertionError(f"{name} must report valid tracks: {error}") from error


def _spoiled(packed: Mapping[str, Any]) -> dict[str, Any]:
    """Return an observation in whose inbox every payload has lost its last byte."""
    inbox = dict(packed["inbox"])
    sizes, heap = inbox["payload_bytes"], packed["inbox_payload"]
    ends = np.cumsum(sizes)
    kept = np.ones(len(heap), dtype=np.bool_)
    kept[ends[sizes > 0] - 1] = False
    inbox["payload_bytes"] = np.maximum(sizes - 1, 0)
    return {**packed, "inbox": inbox, "inbox_payload": heap[kept]}


def _differ(one: Tracks, other: Tracks) -> str:
    return "" if digest(one) == digest(other) else "the tracks"


def _differ_more(one: Tracks, other: Tracks) -> str:
    """Compare tracks, but for changes by a network's arithmetic in batches of another size."""
    if not (np.array_equal(one.id, other.id) and np.array_equal(one.label, other.label)):
        return "the tracks"
    apart = one.boxes.array - other.boxes.array
    apart[:, 6] = wrap_angle(apart[:, 6])
    near = all(
        np.abs(each).max(initial=0.0) < _TOLERANCE
        for each in (apart, one.velocity - other.velocity, one.score - other.score)
    )
    return "" if near else "the tracks"
