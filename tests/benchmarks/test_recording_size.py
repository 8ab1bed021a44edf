"""How large a recording is, how fast it plays, what visibility costs. By `make bench`; nothing fails by time."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Any

import numpy as np
from stepping import Stepper

import coopsim
from coopsim.envs.simulated.record_episode import recorded_scenario
from coopsim.world.recording.episode_file import Episode
from coopsim.world.recording.recorded_world import PlayedWorld
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


def test_cost_of_visibility() -> None:
    """By the rays of an HDL-32E, and by the pixels of four 320 x 180 cameras, on each of 4 agents."""
    modes = ("rgb", "instance")
    env = coopsim.parallel_env("crossing", cameras="surround", camera_modes=modes, expose_ground_truth=True)
    stepper = Stepper(env)
    spent_ms: dict[str, list[float]] = {"visibility": [], "pixel_visibility": []}
    for _ in range(20):
        stepper.step()
        for kind, spent in spent_ms.items():
            began = time.perf_counter()
            getattr(env.episode.frame.probe, kind)()
            spent.append((time.perf_counter() - began) * 1000 / len(env.possible_agents))
    for kind, spent in spent_ms.items():
        print(f"\n{kind}: {np.median(spent):.0f} ms per agent and frame, at least {min(spent):.0f}")
