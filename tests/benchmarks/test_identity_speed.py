"""How long it takes to crop and embed the boxes of one agent; nothing of it happens where nobody asks.

Run by `make bench`. Nothing here fails by time; the figures are printed.
"""

from __future__ import annotations

import time

import numpy as np
import pytest

pytest.importorskip("torch")

from coopsim.detection.identity_embedders import CropEmbedder
from coopsim.geometry.boxes import Boxes3D
from coopsim.learn.weights import make_network
from coopsim.nn.inference.encoders import folded
from coopsim.sensors.camera.camera import named_rig
from coopsim.sensors.camera.projection import best_crops
from coopsim.types import CameraImage, Detections, Odometry, SensorView


@pytest.mark.parametrize("rig", ["surround", "surround_6"])
def test_milliseconds_for_30_boxes(rig: str) -> None:
    rng = np.random.default_rng(0)
    cameras = {camera.name: camera.calibration(1.5) for camera in named_rig(rig)}
    images = {name: CameraImage(rng.integers(0, 256, (180, 320, 3)).astype(np.uint8)) for name in cameras}
    view = SensorView("cav_0", 0, Odometry(np.zeros(4)), images=images, cameras=cameras)
    away, way = rng.uniform(5, 22, 30), rng.uniform(-np.pi, np.pi, 30)
    boxes = Boxes3D.from_array(
        np.column_stack(
            [away * np.cos(way), away * np.sin(way), np.full(30, 0.9), np.tile([4.5, 1.9, 1.7], (30, 1)), way]
        )
    )
    found = Detections(boxes, np.full(30, 0.9), np.zeros(30, dtype=np.int64))
    net = make_network("picture_identity", {})
    embedder = CropEmbedder(folded(net), net.dim, net.config.edge_px, net.config.margin, 32.0, most_hidden=1.0)
    spent, cropping = [], []
    for _ in range(30):
        began = time.perf_counter()
        rows = embedder.embed(found, view)
        spent.append(time.perf_counter() - began)
        began = time.perf_counter()
        best_crops(cameras, boxes)
        cropping.append(time.perf_counter() - began)
    known = int(rows.any(axis=1).sum())
    assert known > 24
    print(f"\n{rig}: {known} boxes cropped and embedded in {1000 * np.median(spent):.1f} ms", end="")
    print(f" (fastest {1000 * min(spent):.1f}), of it where they are {1000 * np.median(cropping):.1f} ms")
