"""Lamps of traffic lights in pictures: the one that shines, whatever the light of day."""

from __future__ import annotations

import numpy as np
import pytest

from coopsim.geometry.boxes import Boxes3D
from coopsim.geometry.se3 import SE3
from coopsim.sensors.camera.camera import Camera
from coopsim.sensors.camera.daylight import DAYLIGHTS, Illumination
from coopsim.sensors.camera.intrinsics import Intrinsics
from coopsim.sensors.camera.picture import FramePainter
from coopsim.sensors.camera.renderers import RaycastRenderer
from coopsim.sensors.scene import SceneGeometry
from coopsim.world.snapshot import Actors, StaticPart

RED, GREEN, DARK = (255, 0, 0), (0, 255, 0), (50, 50, 50)
NOBODY = Actors(
    *(np.zeros(0, int), Boxes3D.from_array(np.zeros((0, 7)))),
    np.zeros((0, 2)),
    *[np.zeros(0, int)] * 2,
    np.zeros((0, 3), np.uint8),
)


def wall(y_m: tuple[float, float], lamp: tuple[int, str, tuple[int, int, int]]) -> StaticPart:
    """Return a square 5 m ahead that looks back."""
    (low, high), x = y_m, 5.0
    corners = np.array([[x, high, -2.0], [x, low, -2.0], [x, low, 2.0], [x, high, 2.0]])
    return StaticPart("lamp", corners, np.array([[0, 1, 2], [0, 2, 3]]), DARK, 0.1, closed=False, lamp=lamp)


def picture(lights: str, time_of_day: str) -> tuple[list[int], list[int]]:
    """Return the colours of the left and right half of a picture of a red lamp (left) and a green one."""
    static = [wall((0.0, 3.0), (1, "r", RED)), wall((-3.0, 0.0), (1, "G", GREEN))]
    triangles = SceneGeometry([], static).triangles(NOBODY, lights=lights)
    renderer, painter = RaycastRenderer(), FramePainter(Illumination(DAYLIGHTS.get(time_of_day)), ["rgb"])
    renderer.update(triangles)
    painter.update(NOBODY, triangles)
    ahead = SE3(np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]]), np.zeros(3))
    camera = Camera("front", Intrinsics.from_fov(8, 4, np.radians(40.0)))
    rgb = painter.paint(renderer.see(camera, ahead, None), camera.intrinsics).rgb
    assert rgb is not None
    return rgb[2, 1].tolist(), rgb[2, 6].tolist()


@pytest.mark.parametrize("time_of_day", ["day", "night"])
def test_the_lamp_of_the_state_shines(time_of_day: str) -> None:
    for lights, shining in (("Gr", 0), ("rG", 1), ("rg", 1), ("Gy", None), ("", None)):
        shown = picture(lights, time_of_day)
        for place, color in enumerate((RED, GREEN)):
            assert (shown[place] == list(color)) == (shining == place)
            assert shining == place or max(shown[place]) < 70
