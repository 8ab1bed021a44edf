"""Tiny networks with cameras and what they look at."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
import torch
from small_cameras import AHEAD, BENT_CAMERA

from coopsim.learn.weights import make_network, save_weights
from coopsim.nn.camera.picture_batch import PictureView, SeenPicture
from coopsim.sensors.camera.camera import Camera
from coopsim.types import BevGrid

MAPS: dict[str, Any] = {"cell_m": 2.4, "channels": [4, 4, 4], "layers": [0, 0, 0], "features": 8}
TINY_PICTURES: dict[str, Any] = MAPS | {"width": 4, "picture_features": 4, "depth_bins": 4, "farthest_m": 30.0}
TINY_BOTH: dict[str, Any] = {"pictures": TINY_PICTURES, "experts": 2}
GRID = BevGrid((-19.2, 19.2), (-19.2, 19.2), 2.4)


def tiny_points(path: Path, seed: int = 0, **changes: Any) -> Path:
    """Write the weights of a detector of points beside which the tiny networks can be trained. Return their path."""
    net = make_network("detector", MAPS | {"pillar_features": 6} | changes, seed)
    save_weights(path, net, {"kind": "detector", "config": asdict(net.config)})
    return path


def tiny_view(*cameras: Camera, seed: int = 0, grid: BevGrid = GRID, points_m: np.ndarray | None = None) -> PictureView:
    """Return random pictures of the cameras of an agent; of two if none is given."""
    rng = np.random.default_rng(seed)
    pictures = [
        SeenPicture(rng.integers(0, 256, (*each.intrinsics.size, 3), dtype=np.uint8), each.calibration(1.5))
        for each in cameras or (AHEAD, BENT_CAMERA)
    ]
    return PictureView(pictures, np.array([0.4, -0.3, 0.5]), grid, points_m=points_m)


def shake(net: torch.nn.Module, seed: int = 0) -> None:
    """Give all parameters random values, as after some training: a fresh network may hide what it depends on."""
    draws = torch.Generator().manual_seed(seed)
    with torch.no_grad():
        for each in net.parameters():
            fan = each[0].numel() if each.ndim > 1 else 1
            each.add_(0.3 / fan**0.5 * torch.randn(each.shape, generator=draws))
