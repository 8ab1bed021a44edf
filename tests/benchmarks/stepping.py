"""Environments to be timed, and how: without a policy, so that what is timed is the environment."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from multiprocessing import get_context
from typing import Any

import numpy as np
import psutil
from test_traffic_speed import long_highway

import coopsim
from coopsim.envs import CooperativeEnv
from coopsim.envs.options import CommonOptions
from coopsim.envs.simulated.simulation import Simulation
from coopsim.envs.simulated.simulation_options import SimulationOptions
from coopsim.sensors.lidar.lidar import LidarConfig
from coopsim.sensors.lidar.patterns import BeamPattern
from coopsim.types import Tracks
from coopsim.wire.actions import pack_tracks
from coopsim.world.population import Population
from coopsim.world.scenario import SameScenario, Scenario

BUSY = {"vehicles": 44, "pedestrians": 26}
"""As many vehicles as the crossing has room for, and people to make it 70 actors."""

DENSE = "HDL-64E"  # by 1024 columns


@dataclass(frozen=True, slots=True)
class StepTimes:
    """How long steps took, ms: half of them less than `median_ms`; undisturbed, `least_ms`."""

    median_ms: float
    least_ms: float

    def __str__(self) -> str:
        return (
            f"{1e3 / self.median_ms:6.1f} steps/s ({self.median_ms:6.2f} ms, median); "
            f"undisturbed {1e3 / self.least_ms:6.1f} ({self.least_ms:6.2f} ms)"
        )


def at_crossing(agents: int = 4, **options: Any) -> CooperativeEnv:
    """One roadside unit and otherwise cars."""
    chosen = {"detector": "simulated", "connected_cars": agents - 1, **BUSY, **options}
    return coopsim.parallel_env("crossing", max_cycles=10**6, **chosen)


def on_highway(vehicles: int, **options: Any) -> CooperativeEnv:
    """4 cars in the middle of so many vehicles are connected; there is room for all."""
    layout = long_highway(vehicles)
    middle_m = np.median([slot.along_m for slot in layout.slots])
    inner = sorted(range(len(layout.slots)), key=lambda k: abs(layout.slots[k].along_m - middle_m))
    layout = replace(layout, connected_order=tuple(inner))
    population = Population(vehicles=vehicles, pedestrians=0, connected_cars=4, rsus=0)
    scenario = Scenario("long", layout, population)
    chosen = SimulationOptions(max_cycles=10**6, **{"detector": "simulated", **options})
    source = Simulation("long", SameScenario(scenario), chosen)
    return CooperativeEnv(source, CommonOptions())


def rays_of(beams: int, columns: int) -> LidarConfig:
    """A LiDAR of beams that are evenly spread."""
    return LidarConfig(BeamPattern("even", np.radians(np.linspace(10.0, -30.0, beams))), columns)


class Stepper:
    """Steps an environment whose agents report nothing and drive as they like."""

    def __init__(self, env: CooperativeEnv, warm_up: int = 5) -> None:
        self._env = env
        self._seen, _ = env.reset(seed=0)
        self._idle = {name: {"tracks": pack_tracks(Tracks.empty())} for name in env.agents}
        for _ in range(warm_up):  # the first steps pay for loading and compiling
            self.step()

    def step(self) -> None:
        """One step; what is observed is kept until the next, as a policy would."""
        self._seen, *_ = self._env.step(self._idle)


def step_times(envs: Mapping[str, CooperativeEnv], steps: int) -> dict[str, StepTimes]:
    """Of environments that take turns, as other work on the machine slows them all."""
    steppers = {name: Stepper(env) for name, env in envs.items()}
    spent_ms: dict[str, list[float]] = {name: [] for name in envs}
    for _ in range(steps):
        for name, stepper in steppers.items():
            began = time.perf_counter()
            stepper.step()
            spent_ms[name].append(1e3 * (time.perf_counter() - began))
    return {name: StepTimes(float(np.median(spent)), min(spent)) for name, spent in spent_ms.items()}


def most_memory_mb(make: Callable[..., CooperativeEnv], *args: Any, **options: Any) -> float:
    """The largest resident memory of a fresh process after each of 15 steps, numba and all."""
    with ProcessPoolExecutor(1, get_context("spawn")) as alone:
        return alone.submit(_most_memory_mb, make, args, options).result()


def _most_memory_mb(make: Callable[..., CooperativeEnv], args: tuple[Any, ...], options: dict[str, Any]) -> float:
    stepper, process, most = Stepper(make(*args, **options), warm_up=0), psutil.Process(), 0
    for _ in range(15):
        stepper.step()
        most = max(most, process.memory_info().rss)
    return most / 2**20
