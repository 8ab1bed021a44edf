"""How many steps a second of one core learners get without LiDARs: one car among 20 vehicles, and 4, 12 and 42 agents.

`coopsim/drive-v1` is among them, at the crossing with 20 vehicles, and in a drawn town with its usual traffic.

Times are of the processor, not of the clock, so that other work on the machine counts less; the best of some turns is
printed, too. Nothing here fails by time.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

import coopsim
from coopsim.envs import DriveEnv
from coopsim.envs.wrappers import DrivingRows, Flatten
from coopsim.types import Tracks
from coopsim.wire.actions import pack_tracks

TURNS, STEPS = 5, 100

DRIVEN: dict[str, Any] = {"control": "acceleration", "lidar": None, "max_cycles": 10**6}
ALONE = DRIVEN | {"vehicles": 20, "connected_cars": 1, "rsus": 0, "reward": "safe_progress", "tracker": "no_fusion"}
SHARED = ALONE | {"connected_cars": 3, "rsus": 1, "tracker": "late_fusion"}
CROWDS: dict[str, tuple[str, dict[str, Any]]] = {
    "1 agent": ("crossing", {"vehicles": 20, "connected_cars": 1, "rsus": 0}),
    "4 agents": ("crossing", {"vehicles": 20, "connected_cars": 3, "rsus": 1}),
    "12 agents": ("crossing", {"vehicles": 20, "connected_cars": 11, "rsus": 1}),
    "42 agents": ("urban_grid", {"vehicles": 100, "connected_cars": 40, "rsus": 2}),
}
"""As many agents as are named, which report nothing; 42 in a place with room for them."""


def print_steps_per_s(what: str, step: Callable[[], None]) -> None:
    """Print the steps in a second of processor time, the median turn and the best."""
    for _ in range(20):  # load and compile
        step()
    spent_s = []
    for _ in range(TURNS):
        began = time.process_time()
        for _ in range(STEPS):
            step()
        spent_s.append((time.process_time() - began) / STEPS)
    print(f"{what:>46}: {1 / np.median(spent_s):6.0f} steps/s, best {1 / min(spent_s):6.0f}", flush=True)


def stepping_one(env: Any) -> Callable[[], None]:
    """Return a step of one car that accelerates and brakes at random."""
    rng = np.random.default_rng(0)
    env.reset(seed=0)
    return lambda: env.step(rng.uniform(-2.0, 2.0, 1).astype(np.float32))


def stepping_all(env: Any) -> Callable[[], None]:
    """Return a step of all agents that report nothing, and whose cars keep their speed."""
    env.reset(seed=0)
    nothing = {"tracks": pack_tracks(Tracks.empty())}
    actions = {
        name: nothing | ({} if spec.command is None else {spec.command: 0.0}) for name, spec in env.agent_specs.items()
    }
    return lambda: env.step(actions)


def test_one_car() -> None:
    print()
    for what, options in (("one connected car, no_fusion", ALONE), ("three that share, late_fusion", SHARED)):
        print_steps_per_s(what, stepping_one(coopsim.single_env("crossing", **options)))
        rows = Flatten(DrivingRows(coopsim.single_env("crossing", **options)))
        print_steps_per_s(f"{what}, DrivingRows", stepping_one(rows))


@pytest.mark.filterwarnings("ignore:there is room for")
def test_all_agents() -> None:
    print()
    for what, (place, crowd) in CROWDS.items():
        print_steps_per_s(what, stepping_all(coopsim.parallel_env(place, **DRIVEN | crowd)))


def stepping_route(env: DriveEnv) -> Callable[[], None]:
    """Return a step of a car that creeps along its route; when its drive is over, another one begins."""
    env.reset(seed=0)

    def step() -> None:
        speed = env.parallel.world.fleet.rows["speed"][env.parallel.world.row_of("cav_0")]
        *_, terminated, truncated, _ = env.step(np.float32([1.0 if speed < 2.0 else -1.0, 0.0]))
        if terminated or truncated:
            env.reset()

    return step


def test_routes() -> None:
    print()
    for what, options in (("crossing", {"vehicles": 20, "pedestrians": 0}), ("town", {"place_seed": 3})):
        print_steps_per_s(f"coopsim/drive-v1, {what}", stepping_route(DriveEnv(place=what, **options)))
