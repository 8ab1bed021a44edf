"""How fast a LiDAR sweeps a busy crossing. Run by `make bench`.

Nothing here fails by time; the figures are printed.
"""

from __future__ import annotations

import time
from collections.abc import Callable

import numpy as np
import pytest

from coopsim.rng import stream
from coopsim.sensors.geometry import SceneGeometry
from coopsim.sensors.lidar import Lidar, LidarConfig
from coopsim.sensors.raycast import RayScene
from coopsim.world.scenario import make_scenario
from coopsim.world.world import World

DT_S = 0.1


def crossing() -> World:
    """30 vehicles, 8 people, 3 connected cars and 1 roadside unit, 2 s after the start."""
    world = World(make_scenario("crossing"), seed=0)
    for _ in range(20):
        world.step(DT_S)
    return world


def median_ms(act: Callable[[], object], times: int = 30) -> float:
    act()  # the first call pays for loading and compiling
    spent = []
    for _ in range(times):
        began = time.perf_counter()
        act()
        spent.append(time.perf_counter() - began)
    return 1e3 * float(np.median(spent))


@pytest.mark.parametrize("pattern", ["HDL-32E", "HDL-64E"])
def test_lidar_sweep(pattern: str) -> None:
    """One connected car's sweep of 1024 columns; the scene is updated once a frame, for all sensors together."""
    world, lidar = crossing(), Lidar(LidarConfig(pattern))
    geometry, actors, body = SceneGeometry(world.models, world.static), world.actors(), world.agents()["cav_0"]
    rng, directions = stream(0, "lidar", "cav_0"), lidar.config.beams.directions(lidar.config.columns)
    triangles = geometry.triangles(actors)
    scene = RayScene(triangles)
    origin = body.world_SE3_base.apply(np.array([0.0, 0.0, body.height_m + lidar.config.above_m]))

    def sweep() -> object:
        return lidar.sense(scene, body.world_SE3_base, body.height_m, body.actor_id, rng)

    place_ms = median_ms(lambda: geometry.triangles(actors))
    build_ms = median_ms(lambda: RayScene(triangles))
    cast_ms, sweep_ms = median_ms(lambda: scene.cast(origin, directions)), median_ms(sweep)
    print(f"\n{pattern} x {lidar.config.columns} in a scene of {len(triangles.faces)} triangles")
    print(f"  scene update: {place_ms + build_ms:5.2f} ms (triangles {place_ms:.2f}, ray scene {build_ms:.2f})")
    print(f"  cast:         {cast_ms:5.2f} ms, {len(directions) / cast_ms / 1e3:.1f} Mrays/s")
    print(f"  whole sweep:  {sweep_ms:5.2f} ms (cast, noise, drop-out, intensity, points)")
