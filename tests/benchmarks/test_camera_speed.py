"""Times of cameras' pictures of a busy crossing, by every renderer. Run by `make bench`.

Nothing here fails by time; the figures are printed.
"""

from __future__ import annotations

import time
from dataclasses import replace

import numpy as np
import pytest

from coopsim.errors import MissingDependencyError
from coopsim.sensors.camera.camera import agent_rigs
from coopsim.sensors.camera.daylight import DAYLIGHTS, Illumination
from coopsim.sensors.camera.intrinsics import NO_DISTORTION, Intrinsics
from coopsim.sensors.camera.picture import CameraRig
from coopsim.sensors.camera.renderers import make_renderer
from coopsim.sensors.scene import SceneGeometry
from coopsim.sensors.weather import Weather
from coopsim.world.scenario import make_scenario
from coopsim.world.world import World

BUDGET_MS = 120.0
LENSES = {"pinhole": NO_DISTORTION, "barrel": (-0.25, 0.08, 0.001, -0.002, 0.0)}
FRAMES = 20


@pytest.mark.parametrize("lens", LENSES)
@pytest.mark.parametrize("fog_visibility_m", [np.inf, 80.0])
@pytest.mark.parametrize("renderer", ["opengl", "raycast", "pyrender"])
def test_camera_frame(renderer: str, lens: str, fog_visibility_m: float) -> None:
    """Four 320 x 180 cameras with colour, depth and instance on each of 3 cars and 1 roadside unit; traffic moves."""
    world = World(make_scenario("crossing"), seed=0)
    intrinsics = Intrinsics.from_fov(distortion=LENSES[lens])
    named = agent_rigs("surround", {name: body.kind for name, body in world.agents().items()})
    rigs = {name: [replace(camera, intrinsics=intrinsics) for camera in rig] for name, rig in named.items()}
    light = Illumination(DAYLIGHTS.get("day"), Weather(fog_visibility_m=fog_visibility_m))
    try:
        rig = CameraRig(rigs, make_renderer(renderer), modes=("rgb", "depth", "instance"), illumination=light)
    except MissingDependencyError as error:
        pytest.skip(str(error))
    geometry, spent = SceneGeometry(world.models, world.static), []
    for _ in range(FRAMES + 1):
        world.step(0.1)
        actors, bodies = world.actors(), world.agents()
        began = time.perf_counter()
        rig.render(geometry.triangles(actors), actors, bodies)
        spent.append(time.perf_counter() - began)
    rig.close()
    agent_ms, least_ms = (1e3 * float(of(spent[1:])) / len(rigs) for of in (np.median, np.min))  # first: compiles
    air = "clear air" if fog_visibility_m == np.inf else "fog"
    print(
        f"\n{renderer}, {lens}, {air}: {agent_ms:.1f} ms an agent and frame, at least {least_ms:.1f} "
        f"(budget {BUDGET_MS:.0f} ms)"
    )
