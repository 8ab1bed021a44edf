"""Work that an agent's uplink and its policy both need, done once per agent and frame.

An environment asks an agent's uplink first, in `reset` and `step`; the policy's `track` gets the same frame a moment
later. Make one of these in the policy, hand it to the uplink in `make_uplink`, and ask it in `track`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, fields, is_dataclass
from functools import partial
from typing import Any, Generic, TypeVar, cast

import numpy as np

from coopsim.types import Observation, SensorView

S = TypeVar("S")
T = TypeVar("T")


class EncodeOnce(Generic[T]):
    """An encoder of sensor data that runs once per agent and frame; itself a function from `SensorView` to its result.

    The latest view and result of each agent are kept. They are used again only for a view of the same content, so
    nothing of another frame or episode is ever mistaken for this one.

    Args:
        encode: the result of one view; a pure function. Only needed without `encode_all`.
        encode_all: the results of several agents' views at once, by agent; None: `encode` for each.
    """

    def __init__(
        self,
        encode: Callable[[SensorView], T] | None = None,
        encode_all: Callable[[Mapping[str, SensorView]], Mapping[str, T]] | None = None,
    ) -> None:
        if encode_all is None:
            assert encode is not None
            encode_all = partial(_each, encode)
        self._encode_all = encode_all
        self._latest: dict[str, tuple[SensorView, T]] = {}

    def __call__(self, view: SensorView) -> T:
        return self.all([view])[view.agent]

    def all(self, views: Iterable[SensorView]) -> dict[str, T]:
        """Return the results of several agents' views, by agent; those not known yet are encoded in one batch."""
        asked = {view.agent: view for view in views}
        new = {agent: view for agent, view in asked.items() if not self._knows(view)}
        if new:
            encoded = self._encode_all(new)
            self._latest |= {agent: (view, encoded[agent]) for agent, view in new.items()}
        return {agent: self._latest[agent][1] for agent in asked}

    def _knows(self, view: SensorView) -> bool:
        latest = self._latest.get(view.agent)
        if latest is None or latest[0].time_ns != view.time_ns:
            return False
        compared = ("odometry", "pose", "sweeps", "images")
        return all(same(getattr(latest[0], name), getattr(view, name)) for name in compared)


def _each(encode: Callable[[SensorView], T], views: Mapping[str, SensorView]) -> dict[str, T]:
    return {agent: encode(view) for agent, view in views.items()}


@dataclass
class _Progress(Generic[S, T]):
    state: S
    frames: int = 0
    observation: Observation | None = None
    result: T | None = None


class StepOnce(Generic[S, T]):
    """A state per agent, as a tracker, that takes a step once per frame; called with agent and observation.

    Inboxes do not matter: the state follows what the agent itself observes. A new episode gets a new state. It begins
    with `begin_sending` (in `Policy.make_uplink`: the environment was reset), with `begin` (in `Policy.begin`) where
    no uplink shares the state, and in any case where time goes back, or where a first frame is not the one that was
    stepped before.

    Args:
        start: a new state.
        step: the result for the next frame; changes the state.
    """

    def __init__(self, start: Callable[[], S], step: Callable[[S, Observation], T]) -> None:
        self._start, self._step = start, step
        self._agents: dict[str, _Progress[S, T]] = {}
        self._sending: set[str] = set()

    def begin_sending(self, agent: str) -> None:
        """Forget the agent's state, because its uplink begins an episode."""
        self._agents.pop(agent, None)
        self._sending.add(agent)

    def begin(self, agent: str) -> None:
        """Forget the agent's state, unless its uplink has begun the same episode before."""
        if agent not in self._sending:
            self._agents.pop(agent, None)
        self._sending.discard(agent)

    def state(self, agent: str) -> S:
        """Return the agent's state after its latest frame."""
        return self._agents[agent].state

    def __call__(self, agent: str, observation: Observation) -> T:
        progress = self._agents.get(agent)
        if progress is None or _of_another_episode(progress, observation):
            progress = self._agents[agent] = _Progress(self._start())
        if progress.observation is None or observation.time_ns > progress.observation.time_ns:
            progress.result = self._step(progress.state, observation)
            progress.observation, progress.frames = observation, progress.frames + 1
        return cast(T, progress.result)


def _of_another_episode(progress: _Progress[Any, Any], observation: Observation) -> bool:
    before = progress.observation
    if before is None or observation.time_ns > before.time_ns:
        return False
    if observation.time_ns < before.time_ns:
        return True
    return progress.frames == 1 and not same(_content(before), _content(observation))


def _content(observation: Observation) -> dict[str, Any]:
    """Return what tells an episode's first frame from another's, of what the environment and the policy both have."""
    found = observation.detections
    return {
        "pose": observation.pose.xyz_yaw,
        "odometry": observation.odometry,
        "boxes": found.boxes,
        "score": found.score,
        "sweeps": observation.sweeps,
    }


def same(one: Any, other: Any) -> bool:
    """Return whether two values have the same content: arrays, dataclasses and mappings of these; NaN equals NaN."""
    if one is other:
        return True
    if isinstance(one, np.ndarray) or isinstance(other, np.ndarray):
        return bool(np.array_equal(one, other, equal_nan=np.asarray(one).dtype.kind == "f"))
    if type(one) is not type(other) and not isinstance(one, Mapping):
        return False
    if is_dataclass(one):
        return all(same(getattr(one, field.name), getattr(other, field.name)) for field in fields(one))
    if isinstance(one, Mapping):
        return one.keys() == other.keys() and all(same(value, other[key]) for key, value in one.items())
    return bool(one == other)
