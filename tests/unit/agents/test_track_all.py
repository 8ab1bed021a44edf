"""A policy may report the tracks of all agents at once."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import pytest

from coopsim.agents.policy import Needs, Policy
from coopsim.errors import InvalidActionError
from coopsim.types import AgentSpec, Detections, Observation, Odometry, PoseEstimate, Tracks
from coopsim.wire.observation_format import ObservationFormat

AGENTS = ("cav_0", "cav_1")


class Batched(Policy):
    """Reports nothing, for all agents in one call."""

    needs = Needs(uplink="none")

    def __init__(self) -> None:
        self.calls: list[list[str]] = []

    def track(self, agent: str, observation: Observation) -> Tracks:
        return Tracks.empty()

    def track_all(self, observations: Mapping[str, Observation]) -> dict[str, Tracks]:
        self.calls.append(list(observations))
        return super().track_all(observations)


class Forgetful(Batched):
    """Leaves out the last agent."""

    def track_all(self, observations: Mapping[str, Observation]) -> dict[str, Tracks]:
        return {agent: Tracks.empty() for agent in list(observations)[:-1]}


def ready(policy: Policy) -> dict[str, dict[str, Any]]:
    """Begin an episode, and return the observations of its first frame."""
    policy.reset({name: AgentSpec(name, "cav", 0.1) for name in AGENTS})
    here = np.zeros(4)
    nothing = Observation(0, PoseEstimate(here), Odometry(here), Detections.empty())
    return ObservationFormat(AGENTS).pack_all(dict.fromkeys(AGENTS, nothing))


def test_a_frame_is_one_call() -> None:
    policy = Batched()
    assert list(policy.act(ready(policy))) == list(AGENTS)
    assert policy.calls == [list(AGENTS)]


def test_an_agent_left_out_is_named() -> None:
    policy = Forgetful()
    with pytest.raises(InvalidActionError, match=r"Forgetful.track_all .*'cav_1'.*got \['cav_0'\]"):
        policy.act(ready(policy))


def test_a_newer_track_below_a_batch_is_refused() -> None:
    with pytest.raises(TypeError, match="OneByOne overrides track and inherits a track_all"):

        class OneByOne(Batched):
            def track(self, agent: str, observation: Observation) -> Tracks:
                return Tracks.empty()


def test_a_mixin_with_a_newer_track_is_refused() -> None:
    class Mixin:
        def track(self, agent: str, observation: Observation) -> Tracks:
            return Tracks.empty()

    with pytest.raises(TypeError, match=r"track_all = coopsim\.Policy\.track_all"):

        class Mixed(Mixin, Batched):  # type: ignore[misc]
            pass


def test_a_subclass_may_ask_for_each_agent() -> None:
    class OneByOne(Batched):
        track_all = Policy.track_all

        def track(self, agent: str, observation: Observation) -> Tracks:
            self.calls.append([agent])
            return Tracks.empty()

    policy = OneByOne()
    policy.act(ready(policy))
    assert policy.calls == [[name] for name in AGENTS]
