"""Times of a LiDAR's sweeps of a busy crossing. Run by `make bench`.

Nothing here fails by time; the figures are printed. What is compared is measured in turns, as other work on the machine
slows both; the least time of each is what it takes undisturbed.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from functools import partial

import numpy as np
import pytest

from coopsim.geometry.se3 import SE3
from coopsim.sensors.lidar.expected_returns import ReturnsEstimator
from coopsim.sensors.lidar.lidar import Lidar, LidarConfig
from coopsim.sensors.lidar.patterns import PATTERNS
from coopsim.sensors.lidar.ray_grid import RayGrid
from coopsim.sensors.scene import RayScene, SceneGeometry, Triangles
from coopsim.sensors.weather import Weather
from coopsim.support.rng import stream
from coopsim.support.threads import run_all
from coopsim.world.scenario import make_scenario
from coopsim.world.world import World

DT_S = 0.1


def crossing() -> World:
    """30 vehicles, 8 people, 3 connected cars and 1 roadside unit, 2 s after the start."""
    world = World(make_scenario("crossing"), seed=0)
    for _ in range(20):
        world.step(DT_S)
    return world


def least_ms(*acts: Callable[[], object], times: int = 30) -> list[float]:
    """Return the least time of each of `acts`, which take turns."""
    for act in acts:
        act()  # the first call pays for loading and compiling
    spent = np.empty((times, len(acts)))
    for round_ in range(times):
        for k, act in enumerate(acts):
            began = time.perf_counter()
            act()
            spent[round_, k] = time.perf_counter() - began
    return (1e3 * spent.min(axis=0)).tolist()


def on_a_roof() -> tuple[World, SE3, Triangles]:
    """A world, the pose of a sensor over its first car, and its triangles."""
    world = crossing()
    body = world.agents()["cav_0"]
    pose = body.world_SE3_base.compose(LidarConfig().base_SE3_sensor(body.height_m))
    return world, pose, SceneGeometry(world.models, world.static).triangles(world.actors())


@pytest.mark.parametrize("name", list(PATTERNS))
def test_grid_against_embree(name: str) -> None:
    """All rays of a sweep of 1024 columns, once the triangles are placed; embree also builds its scene for a frame."""
    (_, pose, triangles), pattern = on_a_roof(), PATTERNS.get(name)
    grid, scene = RayGrid(pattern.elevation_rad, pattern.offset_rad, 1024), RayScene(triangles)
    rays = pose.rotate(pattern.directions(1024))
    embree_ms, build_ms, one_ms = least_ms(
        lambda: scene.cast(pose.translation, rays),
        lambda: RayScene(triangles).cast(pose.translation, rays[:1]),
        lambda: grid.cast(triangles, pose),
    )
    want, got = scene.cast(pose.translation, rays), grid.cast(triangles, pose)
    both = (want.face >= 0) & (got.face.ravel() >= 0)
    error_m = np.abs(want.range_m[both] - got.range_m.ravel()[both])
    print(f"\n{name} x 1024 in a scene of {len(triangles.faces)} triangles, {len(rays)} rays")
    print(f"  embree:     {embree_ms:6.2f} ms, and {build_ms:.2f} ms to build each frame's scene")
    print(
        f"  grid:       {one_ms:6.2f} ms: {embree_ms / one_ms:.1f} times as fast, {(embree_ms + build_ms) / one_ms:.1f}"
    )
    print("              with the scene's building (one sensor in the scene)")
    print(f"  hit or miss agree on {100 * ((want.face >= 0) == (got.face.ravel() >= 0)).mean():.3f} %, ", end="")
    print(f"ranges to {1e3 * error_m.max():.3f} mm")


def test_cost_of_rays() -> None:
    """From 16 thousand to a million rays."""
    _, pose, triangles = on_a_roof()
    print(f"\ngrid, {len(triangles.faces)} triangles")
    for beams, columns in ((16, 1024), (64, 1024), (128, 1024), (128, 2048), (128, 4096), (128, 8192)):
        grid = RayGrid(np.radians(np.linspace(10.0, -30.0, beams)), np.zeros(beams), columns)
        (cast_ms,) = least_ms(lambda grid=grid: grid.cast(triangles, pose))
        rays = beams * columns
        print(f"  {rays:8d} rays: {cast_ms:6.2f} ms, {1e6 * cast_ms / rays:5.1f} ns a ray")


@pytest.mark.parametrize("pattern", ["HDL-32E", "HDL-64E"])
def test_lidar_sweep(pattern: str) -> None:
    """One connected car's whole sweep of 1024 columns; the triangles are placed once a frame, for all sensors."""
    world, lidar = crossing(), Lidar(LidarConfig(pattern))
    geometry, actors, body = SceneGeometry(world.models, world.static), world.actors(), world.agents()["cav_0"]
    rng, scene = stream(0, "lidar", "cav_0"), RayScene(geometry.triangles(actors))

    def sweep() -> object:
        return lidar.sense(scene, body.world_SE3_base, body.height_m, body.actor_id, rng)

    place_ms, sweep_ms = least_ms(lambda: geometry.triangles(actors), sweep)
    print(f"\n{pattern} x 1024: scene update {place_ms:.2f} ms; sweep {sweep_ms:.2f} ms (rays, returns, points)")


def test_sweeps_of_a_frame() -> None:
    """Those of 4 agents, 64 x 1024 each, one after another and by two threads, as the environment has them made."""
    world, lidar = crossing(), Lidar(LidarConfig("HDL-64E"))
    scene = RayScene(SceneGeometry(world.models, world.static).triangles(world.actors()))
    acts = [
        partial(lidar.sense, scene, body.world_SE3_base, body.height_m, body.actor_id, stream(0, "lidar", name))
        for name, body in world.agents().items()
    ]
    one_ms, two_ms = least_ms(lambda: run_all(acts, 1), lambda: run_all(acts, 2))
    print(
        f"\n{len(acts)} agents' sweeps: {one_ms:.2f} ms; 2 threads {two_ms:.2f} ms, {one_ms / two_ms:.2f} times as fast"
    )


def test_cost_of_physics() -> None:
    """What each option adds to a whole sweep of 64 x 1024."""
    world = crossing()
    geometry, body = SceneGeometry(world.models, world.static), world.agents()["cav_0"]
    scene, rng = RayScene(geometry.triangles(world.actors())), stream(0, "lidar", "cav_0")
    lidars = {
        "as it is": Lidar(LidarConfig("HDL-64E")),
        "no noise, no drop-out": Lidar(LidarConfig("HDL-64E", range_noise_m=0.0, dropout_energy=0.0)),
        "wet surfaces": Lidar(LidarConfig("HDL-64E"), Weather(wetness=1.0)),
        "rain": Lidar(LidarConfig("HDL-64E"), Weather(rain_mm_h=10.0)),
        "fog": Lidar(LidarConfig("HDL-64E"), Weather(fog_visibility_m=80.0)),
        "diverging beams": Lidar(LidarConfig("HDL-64E", divergence_rad=0.003)),
        "turn takes time": Lidar(LidarConfig("HDL-64E", turn_s=0.1)),
        "by embree": Lidar(LidarConfig("HDL-64E", backend="embree")),
    }
    acts = [
        lambda lidar=lidar: lidar.sense(scene, body.world_SE3_base, body.height_m, body.actor_id, rng)
        for lidar in lidars.values()
    ]
    print("\nHDL-64E x 1024, whole sweeps")
    for name, spent_ms in zip(lidars, least_ms(*acts), strict=True):
        print(f"  {name:22s} {spent_ms:6.2f} ms")


def test_without_a_lidar() -> None:
    """Lines of sight to all actors from all agents, instead of sweeps."""
    world = crossing()
    beams, actors, bodies = PATTERNS.get("HDL-32E"), world.actors(), world.agents()
    sight = ReturnsEstimator(world.static, beams, 1024, 120.0)
    above = np.array([0.0, 0.0, 2.0])

    def look() -> object:
        origins = np.array([body.world_SE3_base.apply(above) for body in bodies.values()])
        return sight.expected_returns(origins, actors, [body.actor_id for body in bodies.values()])

    print(
        f"\nno LiDAR: {least_ms(look)[0]:.2f} ms for the lines of sight of {len(bodies)} agents to {len(actors)} actors"
    )
