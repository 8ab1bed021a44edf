"""Spaces of agents: made when they are first asked for, and then always the same."""

from __future__ import annotations

import pytest
from gymnasium import spaces

import coopsim
from coopsim.errors import UnknownNameError
from coopsim.wire.columns import LaterSpaces
from coopsim.wire.observation_format import ObservationFormat


def test_a_space_is_made_once_and_only_for_who_asks() -> None:
    made: list[str] = []

    def make(agent: str) -> spaces.Dict:
        made.append(agent)
        return spaces.Dict(own=spaces.Discrete(2))

    later = LaterSpaces(["cav_0", "rsu_0"], make)
    assert not made
    first = later.of("cav_0")
    assert later.of("cav_0") is first and later.of("rsu_0") is not first
    assert made == ["cav_0", "rsu_0"]
    with pytest.raises(UnknownNameError, match="unknown agent 'cav_9'"):
        later.of("cav_9")


def test_an_episode_of_a_policy_makes_no_space(monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*given: object) -> spaces.Dict:
        raise AssertionError("nobody asked for a space")

    monkeypatch.setattr(ObservationFormat, "space", refuse)
    coopsim.evaluate("late_fusion", "crossing", seed=0, vehicles=6, lidar=None, max_cycles=1)
