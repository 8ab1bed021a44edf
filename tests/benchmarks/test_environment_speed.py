"""How fast the environment runs, what that depends on, and how much memory it takes.

Run by `make bench`. Nothing here fails by time; the figures are printed. Where `COOPSIM_PLOTS` names a folder,
the costs are drawn into it. For policies see `test_policy_speed`.
"""

from __future__ import annotations

import os
from pathlib import Path

import psutil
import pytest
from plot_cost import Costs, plot_costs
from stepping import DENSE, at_crossing, most_memory_mb, on_highway, rays_of, step_times

import coopsim

MOST_MB = 1500


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
    if os.environ.get("COOPSIM_PLOTS"):
        plot_costs(Path(os.environ["COOPSIM_PLOTS"]) / "speed.svg", costs)


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


def test_cost_of_the_truth() -> None:
    """What the infos cost: without the truth, with it, and with visibility by rays, too."""
    print()
    for lidar in (None, DENSE):
        envs = {
            "no truth": at_crossing(lidar=lidar),
            "expose_ground_truth": at_crossing(lidar=lidar, expose_ground_truth=True),
            "expose_visibility, too": at_crossing(lidar=lidar, expose_ground_truth=True, expose_visibility=True),
        }
        for name, times in step_times(envs, 30).items():
            print(f"{'no rays' if lidar is None else lidar:>9}, {name:>22}: {times}", flush=True)


@pytest.mark.filterwarnings("ignore:there is room for")
def test_memory_over_many_steps() -> None:
    """42 agents with late fusion, from step 200 on; `COOPSIM_STEPS` says to which step, 400 by default."""
    policy, last = coopsim.make_policy("late_fusion"), int(os.environ.get("COOPSIM_STEPS", "400"))
    population = {"vehicles": 100, "connected_cars": 40, "rsus": 2}
    env = coopsim.parallel_env("urban_grid", uplink=policy, lidar=None, max_cycles=last, **population)
    observations, _ = env.reset(seed=0)
    policy.reset(env.agent_specs, seed=0)
    process, before = psutil.Process(), 0
    print()
    for step in range(1, last + 1):
        observations, *_ = env.step(policy.act(observations))
        if step == 200 or not step % max(500, last // 20) or step == last:
            resident = process.memory_info().rss
            before = before or resident
            print(f"step {step:6d}: {resident / 2**20:6.1f} MB resident", flush=True)
    assert (resident - before) / 2**20 < 150
