"""How fast the environment runs, what that depends on, where the time goes, and how much memory it takes.

Run by `make bench`. Nothing here fails by time; the figures are printed. Where `COOPSIM_PLOT` names a file,
the costs are drawn into it.
"""

from __future__ import annotations

import cProfile
import os
import pstats
import time
from pathlib import Path
from typing import Any

import psutil
from plot_cost import Costs, plot_costs
from stepping import DENSE, at_crossing, most_memory_mb, on_highway, rays_of, step_times

import coopsim

MOST_MB = 1500

PARTS = {
    "traffic": "world/world.py:step",
    "triangles and ray scene": "sensors/scene.py:triangles sensors/raycast.py:__init__",
    "LiDAR sweeps": "sensors/lidar/lidar.py:sense",
    "detection": "detection/simulated/simulated.py:detect",
    "localization": "localization/localizer.py:localize",
    "channel and codec": "comms/channel/channel.py:send comms/channel/channel.py:deliver",
    "packing observations": "wire/observation_format.py:pack",
    "policy": "agents/policy.py:act",
    "scoring": "envs/scoring.py:update",
}


def test_steps_per_second() -> None:
    """3 cars and 1 roadside unit among 70 actors, no policy: 64 x 1024 rays each, or no rays at all."""
    by_threads = {f"{threads} thread(s)": at_crossing(lidar=DENSE, threads=threads) for threads in (1, 2)}
    print("\n64 x 1024 rays for each of 4 agents")
    for name, times in step_times(by_threads, 100).items():
        print(f"  {name}: {times}")
    (times,) = step_times({"none": at_crossing(lidar=None)}, 500).values()
    print(f"no rays\n  {times}")


def test_costs() -> None:
    """Against agents, rays and vehicles, everything else as above."""
    costs: dict[str, Costs] = {
        "agents, 64 x 1024 rays each": {
            agents: step_times(
                {str(threads): at_crossing(agents, lidar=DENSE, threads=threads) for threads in (1, 2)}, 40
            )
            for agents in (1, 2, 4, 8, 16)
        },
        "rays of each of 4 agents": {
            beams * columns: step_times(
                {str(threads): at_crossing(lidar=rays_of(beams, columns), threads=threads) for threads in (1, 2)}, 25
            )
            for beams, columns in ((16, 1024), (64, 1024), (128, 2048), (128, 8192))
        },
        "vehicles, 4 agents, 64 x 1024 rays": {
            vehicles: step_times(
                {str(threads): on_highway(vehicles, lidar=DENSE, threads=threads) for threads in (1, 2)}, 40
            )
            for vehicles in (10, 25, 50, 100, 200, 400)
        },
    }
    for what, cost in costs.items():
        print(f"\n{what}")
        for number, by_threads in cost.items():
            one, two = by_threads["1"], by_threads["2"]
            print(f"{number:9d}: 1 thread {one}")
            print(f"           2 threads {two}; {one.least_ms / two.least_ms:.2f} times as fast")
    if os.environ.get("COOPSIM_PLOT"):
        plot_costs(Path(os.environ["COOPSIM_PLOT"]), costs)


def test_memory_at_the_largest() -> None:
    """Of a process that does nothing else."""
    found = {
        "as a start, 4 agents without rays": most_memory_mb(at_crossing, lidar=None),
        "16 agents, 64 x 1024 rays": most_memory_mb(at_crossing, 16, lidar=DENSE),
        "4 agents, 128 x 8192 rays": most_memory_mb(at_crossing, lidar=rays_of(128, 8192)),
        "400 vehicles": most_memory_mb(on_highway, 400, lidar=DENSE),
    }
    print()
    for what, most_mb in found.items():
        print(f"{what:>34}: {most_mb:6.0f} MB")
    assert max(found.values()) < MOST_MB


def start(max_cycles: int, **options: Any) -> tuple[Any, Any, Any]:
    policy = coopsim.make_policy("late_fusion")
    env = coopsim.parallel_env(
        "crossing", detector="simulated", max_cycles=max_cycles, uplink=policy.needs.uplink, **options
    )
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
