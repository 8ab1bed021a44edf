"""Draw all kinds of street furniture on a sheet, and a furnished street, for docs/reference/furniture.md.

python scripts/draw_furniture.py docs/reference
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from coopsim.geometry.boxes import Boxes3D
from coopsim.geometry.se3 import SE3, Floats
from coopsim.sensors.camera.camera import Camera
from coopsim.sensors.camera.daylight import DAYLIGHTS, Illumination
from coopsim.sensors.camera.intrinsics import Intrinsics
from coopsim.sensors.camera.picture import FramePainter
from coopsim.sensors.camera.renderers import RaycastRenderer
from coopsim.sensors.scene import static_triangles
from coopsim.viz.portrait import contact_sheet
from coopsim.world.furniture.furnish import furnishing_parts
from coopsim.world.furniture.kinds import KINDS
from coopsim.world.places.layout import flat_part, rectangle
from coopsim.world.scenario import make_scenario
from coopsim.world.snapshot import Actors, StaticPart

SMOOTHING = 2
NONE = np.zeros(0, np.int64)
NOBODY = Actors(
    NONE, Boxes3D.from_array(np.zeros((0, 7))), np.zeros((0, 2)), NONE, NONE, np.zeros((0, 3), dtype=np.uint8)
)
GROUND = flat_part("ground", [rectangle((-500.0, 500.0), (-500.0, 500.0))], 0.0, (160, 164, 160), 0.3)


def axes_towards(yaw_deg: float, down_deg: float) -> Floats:
    """Return the axes (3, 3) of a camera that looks in a direction."""
    yaw, down = np.radians([yaw_deg, down_deg])
    ahead = np.array([np.cos(yaw) * np.cos(down), np.sin(yaw) * np.cos(down), -np.sin(down)])
    right = np.array([np.sin(yaw), -np.cos(yaw), 0.0])
    return np.column_stack([right, np.cross(ahead, right), ahead])


def photograph(
    parts: list[StaticPart], world_SE3_camera: SE3, fov_deg: float, size_px: tuple[int, int]
) -> NDArray[np.uint8]:
    """Return a picture (H, W, 3) of meshes."""
    width, height = size_px
    lens = Intrinsics.from_fov(width * SMOOTHING, height * SMOOTHING, np.radians(fov_deg))
    triangles = static_triangles(parts)
    renderer, painter = RaycastRenderer(), FramePainter(Illumination(DAYLIGHTS.get("day")), ["rgb"])
    renderer.update(triangles)
    painter.update(NOBODY, triangles)
    rgb = painter.paint(renderer.see(Camera("camera", lens), world_SE3_camera, None), lens).rgb
    assert rgb is not None, "asked for above"
    fine = rgb.reshape(height, SMOOTHING, width, SMOOTHING, 3)
    return fine.mean(axis=(1, 3)).astype(np.uint8)  # type: ignore[no-any-return]


def portrait(kind: str) -> tuple[str, NDArray[np.uint8]]:
    """Return a kind's caption and its picture, from its front left."""
    step_m = KINDS[kind].step_m
    where: dict[str, Any] = {"at": [0.0, 0.0], "heading_deg": 0.0}
    if step_m:
        where = {"along": [[0.0, 0.0], [max(step_m, 6.0), 0.0]]}
    parts = furnishing_parts([{"kind": kind, **where}])
    points = np.concatenate([part.vertices for part in parts])
    low, high = points.min(axis=0), points.max(axis=0)
    axes = axes_towards(215.0, 12.0)
    away_m = np.linalg.norm(high - low) / 2 / np.sin(np.radians(11.5))
    pose = SE3(axes, (low + high) / 2 - away_m * axes[:, 2])
    faces = sum(len(part.faces) for part in parts)
    return f"{kind}: {faces} triangles", photograph([GROUND, *parts], pose, 30.0, (200, 150))


def street(name: str, spot: tuple[float, float, float], yaw_deg: float, down_deg: float) -> NDArray[np.uint8]:
    """Return a picture of a scenario in full detail, without actors."""
    pose = SE3(axes_towards(yaw_deg, down_deg), np.array(spot))
    return photograph(list(make_scenario(name, detail="full").static), pose, 75.0, (500, 300))


if __name__ == "__main__":
    folder = Path(sys.argv[1] if len(sys.argv) > 1 else ".")
    contact_sheet([portrait(kind) for kind in KINDS], columns=5).save(folder / "furniture.png", optimize=True)
    streets = [
        street("parking_street", (30.0, 2.0, 6.0), 180.0, 10.0),
        street("urban_grid", (-60.0, 98.0, 1.8), 0.0, 3.0),
    ]
    Image.fromarray(np.hstack(streets)).save(folder / "furnished_streets.png", optimize=True)
    print(f"{len(KINDS)} kinds, {len(streets)} streets in {folder}")
