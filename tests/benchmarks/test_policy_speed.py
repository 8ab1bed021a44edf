"""How many steps policies leave of real time, where their time goes, and how it grows with messages.

Run by `make bench`. Nothing here fails by time; the figures are printed. Where `COOPSIM_PLOTS` names a folder, the cost
by messages is drawn into it.
"""

from __future__ import annotations

import cProfile
import os
import time
from pathlib import Path
from typing import Any, NamedTuple

import pytest
from plot_cost import plot_policies
from rooms import PARTS, time_by_part

import coopsim

SECONDS = 2.5
"""How long a row is measured, at most 100 steps and at least 5."""

ROWS: dict[str, dict[str, Any]] = {
    "urban_grid, 1 agent": {"vehicles": 100, "connected_cars": 1, "rsus": 0},
    "urban_grid, 4 agents": {"vehicles": 100, "connected_cars": 3, "rsus": 1},
    "urban_grid, 12 agents": {"vehicles": 100, "connected_cars": 10, "rsus": 2},
    "urban_grid, 42 agents": {"vehicles": 100, "connected_cars": 40, "rsus": 2},
    "highway, 7 agents": {"vehicles": 400, "connected_cars": 7, "rsus": 0},
}
LEADING = ("late_fusion", "coop_fuse")
OTHERS = ("no_fusion", "sequential_kf", "dino_codt_tracking", "graph_lap_aos", "track_to_track")
AGENTS = (2, 4, 8, 16, 32, 64)


class Rate(NamedTuple):
    """Speed of a loop: steps a second, and milliseconds of a step that the policy and the environment took."""

    steps_per_s: float
    policy_ms: float
    env_ms: float


class Loop:
    """An environment without rays and a policy for all of its agents."""

    def __init__(self, policy: str, name: str, **options: Any) -> None:
        self._policy = coopsim.make_policy(policy)
        self._env = coopsim.parallel_env(name, uplink=self._policy, lidar=None, max_cycles=10**6, **options)
        self._seen, _ = self._env.reset(seed=0)
        self._policy.reset(self._env.agent_specs, seed=0)
        self.run(5)  # the first steps pay for compiling, and have no tracks yet

    @property
    def agents(self) -> int:
        return len(self._env.possible_agents)

    def run(self, most: int, seconds: float = 1e9) -> Rate:
        acted = stepped = 0.0
        done = 0
        while done < most and (done < 5 or acted + stepped < seconds):
            began = time.perf_counter()
            actions = self._policy.act(self._seen)
            between = time.perf_counter()
            self._seen, *_ = self._env.step(actions)
            acted, stepped, done = acted + between - began, stepped + time.perf_counter() - between, done + 1
        return Rate(done / (acted + stepped), 1e3 * acted / done, 1e3 * stepped / done)


@pytest.mark.filterwarnings("ignore:there is room for")
@pytest.mark.parametrize("policy", [*LEADING, *OTHERS])
def test_steps_per_second(policy: str) -> None:
    """The leading policies everywhere, the others where there are 1, 12 or 42 agents."""
    print()
    for place, population in ROWS.items():
        if policy in LEADING or place.endswith((" 1 agent", "12 agents", "42 agents")):
            rate = Loop(policy, place.partition(",")[0], **population).run(100, SECONDS)
            print(
                f"{place:>24} {policy:>20} {rate.steps_per_s:7.1f} steps/s; policy {rate.policy_ms:6.1f} ms, "
                f"environment {rate.env_ms:5.1f} ms",
                flush=True,
            )


@pytest.mark.filterwarnings("ignore:there is room for")
@pytest.mark.parametrize("policy", LEADING)
def test_where_the_time_goes(policy: str) -> None:
    """Under the profiler, which lengthens what makes many calls."""
    print(f"\n{policy + ', % of a step':>44} {'12 agents':>10} {'42 agents':>10}")
    shares = []
    for agents in (12, 42):
        loop, profile = Loop(policy, "urban_grid", **ROWS[f"urban_grid, {agents} agents"]), cProfile.Profile()
        profile.enable()
        loop.run(8)
        profile.disable()
        shares.append(time_by_part(profile))
    for part in (*PARTS, "the rest"):
        print(f"{part:>44} " + " ".join(f"{100 * share[part]:10.1f}" for share in shares))


@pytest.mark.filterwarnings("ignore:there is room for")
def test_cost_of_messages() -> None:
    """The time of one receiver's frame, with a message from each other agent."""
    print(f"\n{'ms a receiver, by agents':>24} " + " ".join(f"{agents:7d}" for agents in AGENTS))
    costs: dict[str, dict[int, float]] = {}
    for policy in LEADING:
        costs[policy] = {}
        print(f"{policy:>24} ", end="", flush=True)
        for agents in AGENTS:
            population = {"vehicles": 72, "trucks": 0, "connected_cars": agents - 1, "rsus": 1}
            rate = Loop(policy, "urban_grid", **population).run(20, SECONDS / 2)
            costs[policy][agents - 1] = rate.policy_ms / agents
            print(f"{rate.policy_ms / agents:7.2f}", end=" ", flush=True)
        print()
    if os.environ.get("COOPSIM_PLOTS"):
        plot_policies(Path(os.environ["COOPSIM_PLOTS"]) / "policy_speed.svg", costs)


@pytest.mark.parametrize("policy", ["ab3dmot", "sequential_kf", "coop_fuse"])
def test_frames_per_second_of_a_replay(policy: str, v2v4real: Path) -> None:
    """Two cars of V2V4Real, tracked and scored; metrics at the end included."""
    coopsim.evaluate_recordings(policy, v2v4real, ("ego", "1"))  # compiles
    result = coopsim.evaluate_recordings(policy, v2v4real, ("ego", "1"))
    print(f"\n{policy}: {result.frames} frames in {result.seconds:.1f} s, {result.frames_per_s:.0f} frames/s")
