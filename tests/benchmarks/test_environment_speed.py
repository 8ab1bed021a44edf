"""How fast the environment runs, where the time goes, and whether memory holds still. Run by `make bench`.

Nothing here fails by time; the figures are printed.
"""

from __future__ import annotations

import cProfile
import pstats
import time
from typing import Any

import psutil

import coopsim

PARTS = {
    "traffic": "world/world.py:step",
    "triangles and ray scene": "sensors/geometry.py:triangles sensors/raycast.py:__init__",
    "LiDAR sweeps": "sensors/lidar.py:sense",
    "detection": "detection/simulated.py:detect",
    "localization": "localization.py:localize",
    "channel and codec": "comms/channel.py:send comms/channel.py:deliver",
    "packing observations": "envs/spaces.py:pack_observation",
    "policy": "agents/base.py:act",
    "scoring": "envs/scoring.py:update",
}


def start(max_cycles: int, **options: Any) -> tuple[Any, Any, Any]:
    policy = coopsim.make_policy("late_fusion")
    env = coopsim.parallel_env("crossing", max_cycles=max_cycles, uplink=policy.uplink, **options)
    observations, _ = env.reset(seed=0)
    policy.reset(env.agent_specs, seed=0)
    return env, policy, observations


def steps(env: Any, policy: Any, observations: Any, count: int) -> Any:
    for _ in range(count):
        observations, *_ = env.step(policy.act(observations))
    return observations


def test_steps_per_second_and_where_the_time_goes() -> None:
    """3 cars and 1 roadside unit, 32 x 1024 LiDAR each, 30 vehicles, no cameras, late fusion."""
    env, policy, observations = start(1000)
    observations = steps(env, policy, observations, 20)
    began = time.perf_counter()
    observations = steps(env, policy, observations, 150)
    print(f"\n{150 / (time.perf_counter() - began):.1f} steps/s end to end")
    profile = cProfile.Profile()
    profile.enable()
    steps(env, policy, observations, 100)
    profile.disable()
    found: Any = pstats.Stats(profile).stats  # type: ignore[attr-defined]
    total = sum(row[2] for row in found.values())
    rest = total
    for part, places in PARTS.items():
        wanted = [place.split(":") for place in places.split()]
        spent = sum(
            row[3]
            for (path, _, function), row in found.items()
            if any(path.endswith(file) and function == name for file, name in wanted)
        )
        rest -= spent
        print(f"{part:>26}: {10 * spent:6.2f} ms a step ({100 * spent / total:4.1f} %, under the profiler)")
    print(f"{'the rest':>26}: {10 * rest:6.2f} ms a step ({100 * rest / total:4.1f} %)")


def test_memory_over_two_thousand_steps() -> None:
    """Resident memory, from step 200 on."""
    env, policy, observations = start(2000)
    process = psutil.Process()
    observations = steps(env, policy, observations, 200)
    before = process.memory_info().rss
    steps(env, policy, observations, 1800)
    grown_mb = (process.memory_info().rss - before) / 2**20
    print(f"\nresident memory grew by {grown_mb:.1f} MB from step 200 to 2000")
    assert grown_mb < 50
