"""Draw images of roadside cameras by day, dusk and night, in fog and rain, wide and labelled, to cameras.png."""

import sys
from typing import Any

import numpy as np

import coopsim
from coopsim.sensors.camera.camera import Camera
from coopsim.sensors.camera.intrinsics import Intrinsics
from coopsim.sensors.camera.picture import MODES, NO_CLASS
from coopsim.sensors.weather import Weather
from coopsim.types import CameraImage
from coopsim.viz.palette import BACKGROUND, track_color
from coopsim.viz.portrait import contact_sheet

AGENT, SEED = "rsu_0", 5


def look(camera: Camera, **options: Any) -> CameraImage:
    """Return the camera's image at an episode's start."""
    options = {"detail": "full", "camera_modes": MODES, "expose_ground_truth": True} | options
    env = coopsim.parallel_env("crossing", cameras={AGENT: [camera]}, **options)
    env.reset(seed=SEED)
    picture = env.photograph()[AGENT][camera.name]
    env.close()
    return picture


def colored(values: Any, background: int) -> Any:
    """Colour each value differently."""
    names, row = np.unique(values, return_inverse=True)
    colors = [BACKGROUND if name == background else track_color(name) for name in names.tolist()]
    return np.array(colors, dtype=np.uint8)[row]


TELE = Camera("tele", Intrinsics.from_fov(320, 180, np.radians(45.0)), yaw_rad=-0.5, pitch_rad=0.1)
BARREL = (-0.25, 0.08, 0.0, 0.0, 0.0)
WIDE = Camera("wide", Intrinsics.from_fov(320, 180, np.radians(100.0), BARREL), pitch_rad=0.2)

day = look(TELE)
near = np.where(day.depth > 0, 1 - np.minimum(day.depth / 60.0, 1.0), 0.0)
pictures = [
    ("day", day.rgb),
    ("dusk", look(TELE, time_of_day="dusk").rgb),
    ("night", look(TELE, time_of_day="night").rgb),
    ("fog, visibility 60 m", look(TELE, weather=Weather(fog_visibility_m=60.0)).rgb),
    ("rain, 20 mm/h", look(TELE, weather=Weather(rain_mm_h=20.0)).rgb),
    ("wide lens, k1 = -0.25", look(WIDE).rgb),
    ("depth, to 60 m", np.repeat((255 * near).astype(np.uint8)[..., None], 3, axis=-1)),
    ("instance", colored(day.instance, 0)),
    ("semantic", colored(day.semantic, NO_CLASS)),
]
path = sys.argv[1] if len(sys.argv) > 1 else "cameras.png"
contact_sheet(pictures, columns=3).save(path, optimize=True)
print(f"{len(pictures)} pictures in {path}")
