"""How long drawing a town takes, and a step in it beside a step at the crossing.

Run by `make bench`. Nothing here fails by time; the figures are printed as they come.
"""

from __future__ import annotations

import time
from dataclasses import replace

import numpy as np
import pytest
import trimesh
from stepping import step_times

from coopsim.envs import CooperativeEnv
from coopsim.envs.options import CommonOptions
from coopsim.envs.simulated.simulation import Simulation
from coopsim.envs.simulated.simulation_options import SimulationOptions
from coopsim.sensors.scene import SceneGeometry
from coopsim.world.scenario import SameScenario, Scenario, make_scenario
from coopsim.world.snapshot import StaticPart
from coopsim.world.towns.town import draw_place
from coopsim.world.world import World

NUMBERS = {"vehicles": 30, "truck_share": 0.1, "pedestrians": 8, "connected_cars": 4, "rsus": 0} | dict.fromkeys(
    ("vans", "buses", "motorcycles", "bicycles", "scooters", "children", "parked"), 0
)


def test_time_to_draw() -> None:
    """The description with its furniture, the place, its layout and meshes; then what rays need; 60 places.

    It is processor time: drawing uses one core, and other work on the machine counts little.
    """
    spent_ms = []
    for place in range(1_000_000, 1_000_061):
        began = time.process_time()
        drawn = make_scenario(draw_place(place), detail="full")
        made = time.process_time()
        SceneGeometry(drawn.models, drawn.static)
        spent_ms.append(1e3 * np.diff([began, made, time.process_time()]))
    steps = np.array(spent_ms[1:])  # the first pays for loading and compiling
    print()
    for name, times in zip(("place and meshes", "geometry for rays"), steps.T, strict=True):
        print(f"{name:>18}: {_times(times)}", flush=True)
    print(f"{'all':>18}: {_times(steps.sum(axis=1))}")


@pytest.mark.parametrize("place", [0, 1, 2, 3])
def test_step_beside_the_crossing(place: int) -> None:
    """The same numbers of actors, of rays, and of triangles: those of the sparser scenery are cut into four."""
    town, crossing = (make_scenario(each, detail="full", **NUMBERS) for each in (draw_place(place), "crossing"))
    counts = [_triangles(scenario) for scenario in (town, crossing)]
    most = max(counts)
    envs = {name: _env(_cut(scenario, most)) for name, scenario in (("town", town), ("crossing", crossing))}
    times = step_times(envs, 60)
    ratio = times["town"].median_ms / times["crossing"].median_ms
    print(f"\nplace {place}: {counts[0]} triangles, the crossing {counts[1]}, both cut to about {most}")
    for name, each in times.items():
        print(f"  {name:>8}: {each}")
    print(f"  a step of the town takes {ratio:.2f} times as long as one of the crossing", flush=True)


def _env(scenario: Scenario) -> CooperativeEnv:
    source = Simulation("speed", SameScenario(scenario), SimulationOptions(max_cycles=10**6, threads=1))
    return CooperativeEnv(source, CommonOptions())


def _triangles(scenario: Scenario) -> int:
    """Return the number of triangles of scenery and actors at the start of an episode."""
    world = World(scenario, 0)
    return len(SceneGeometry(world.models, world.static).triangles(world.actors()).faces)


def _cut(scenario: Scenario, most: int) -> Scenario:
    """Cut all triangles of part after part into four, those with the largest first, until there are about `most`."""
    missing = most - _triangles(scenario)
    parts = list(scenario.layout.static)
    while True:
        fitting = [k for k, part in enumerate(parts) if 3 * len(part.faces) <= missing]
        if not fitting:
            break
        k = max(fitting, key=lambda k: _mean_area(parts[k]))
        missing -= 3 * len(parts[k].faces)
        vertices, faces = trimesh.remesh.subdivide(parts[k].vertices, parts[k].faces)
        parts[k] = replace(parts[k], vertices=vertices, faces=faces)
    layout = replace(scenario.layout, static=tuple(parts))
    return Scenario(scenario.name, layout, scenario.population, scenario.detail)


def _mean_area(part: StaticPart) -> float:
    corners = part.vertices[part.faces]
    sides = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    return float(np.linalg.norm(sides, axis=1).mean()) / 2


def _times(times_ms: np.ndarray) -> str:
    most = f"{times_ms.max():6.1f} ms (most)"
    return f"{np.median(times_ms):6.1f} ms (median), {np.quantile(times_ms, 0.95):6.1f} ms (95 %), {most}"
