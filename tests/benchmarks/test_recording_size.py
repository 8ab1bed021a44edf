"""How large a recording is, how fast it plays, what visibility costs. By `make bench`; nothing fails by time."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Any

import coopsim
from coopsim.data.episode import Episode
from coopsim.world.recorded import PlayedWorld, recorded_scenario
from coopsim.world.scenario import make_scenario
from coopsim.world.world import World

STEPS = 600


def step_ms(world: Any) -> float:
    world.step(0.1)  # compiles what there is to compile
    began = time.perf_counter()
    for _ in range(STEPS - 1):
        world.step(0.1)
        world.actors()
    return (time.perf_counter() - began) / (STEPS - 1) * 1000


def test_size_and_speed_of_a_recording(tmp_path: Path) -> None:
    for name in ("crossing", "highway"):
        episode = Episode(coopsim.record(name, tmp_path / name, seed=7, max_cycles=STEPS))
        assert episode.frames == STEPS + 1
        simulated = step_ms(World(make_scenario(name), 7))
        played = step_ms(PlayedWorld(episode, recorded_scenario(episode)))
        size = episode.size_bytes / episode.frames
        print(f"\n{name}: {size:.0f} bytes a frame, {played:.2f} ms to play it, {simulated:.2f} ms to simulate it")


def test_cost_of_visibility(tmp_path: Path) -> None:
    path = coopsim.record("crossing", tmp_path / "run", seed=7, max_cycles=20)
    spent_ms = {}
    for exposed in (False, True):
        env = coopsim.parallel_env("crossing", playback=path, expose_ground_truth=exposed)
        policy = coopsim.make_policy("no_fusion")
        observations, _ = env.reset(seed=7)
        policy.reset(env.agent_specs, seed=7)
        began = time.perf_counter()
        while env.agents:
            observations, *_ = env.step(policy.act(observations))
        spent_ms[exposed] = (time.perf_counter() - began) / 20 * 1000
    extra = (spent_ms[True] - spent_ms[False]) / len(env.possible_agents)
    print(f"\nvisibility: {extra:.0f} ms per agent and frame, on top of {spent_ms[False]:.0f} ms for a whole step")
