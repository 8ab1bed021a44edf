"""Agents' sweeps shared by threads are those of one thread, bit by bit."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import pytest

import coopsim
from coopsim.errors import InvalidValueError
from coopsim.sensors.lidar.lidar import LidarConfig
from coopsim.sensors.weather import Weather

TWO = {
    "roof": LidarConfig("VLP-16", columns=256),
    "above": LidarConfig("VLP-16", columns=256, turn_s=0.1, yaw_rad=0.5, above_m=0.5),
}


def frames(threads: int, **options: Any) -> list[Any]:
    env = coopsim.parallel_env("crossing", vehicles=10, connected_cars=5, threads=threads, **options)
    policy = coopsim.make_policy("no_fusion")
    observations, _ = env.reset(seed=5)
    policy.reset(env.agent_specs, seed=5)
    seen: list[Any] = [observations]
    for _ in range(3):
        observations, *rest = env.step(policy.act(observations))
        seen += [observations, *rest]
    env.close()
    return seen


def assert_same(one: Any, other: Any) -> None:
    if isinstance(one, Mapping):
        assert one.keys() == other.keys()
        for key in one:
            assert_same(one[key], other[key])
    else:
        np.testing.assert_array_equal(one, other)


@pytest.mark.parametrize(
    "options",
    [
        {"lidar": TWO, "weather": Weather(rain_mm_h=10.0, fog_visibility_m=200.0), "expose_ground_truth": True},
        {"lidar": LidarConfig("VLP-16", columns=64, backend="embree"), "uplink": "none"},
    ],
    ids=["grid", "embree"],
)
def test_threads_change_no_bit(options: dict[str, Any]) -> None:
    alone = frames(1, **options)
    assert len(alone) > 1
    for threads in (2, 5):
        for one, other in zip(alone, frames(threads, **options), strict=True):
            assert_same(one, other)


@pytest.mark.parametrize("threads", [0, -1, 1.5, None, True])
def test_threads_are_a_positive_integer(threads: Any) -> None:
    with pytest.raises(InvalidValueError, match="threads must be an integer >= 1"):
        coopsim.parallel_env("crossing", threads=threads)
