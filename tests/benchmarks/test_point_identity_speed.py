"""How long it takes to embed the boxes of one agent by the points in them.

Run by `make bench`. Nothing here fails by time; the figures are printed.
"""

from __future__ import annotations

import time

import numpy as np
import pytest

pytest.importorskip("torch")

from coopsim.learn.weights import make_network
from coopsim.nn.identity.point_encoder import PointEmbedder


@pytest.mark.parametrize("size", ["small", "paper"])
def test_milliseconds_for_30_boxes_in_60_000_points(size: str) -> None:
    rng = np.random.default_rng(0)
    away, way = rng.uniform(5, 40, 30), rng.uniform(-np.pi, np.pi, 30)
    middle = np.column_stack([away * np.cos(way), away * np.sin(way), np.full(30, 0.9)])
    boxes = np.column_stack([middle, np.tile([4.5, 1.9, 1.7], (30, 1)), np.zeros(30)])
    ground = np.column_stack([rng.uniform(-60, 60, (57_000, 2)), np.zeros(57_000)])
    on_cars = (middle[:, None] + rng.uniform(-0.5, 0.5, (30, 100, 3)) * [4.5, 1.9, 1.7]).reshape(-1, 3)
    xyz = rng.permutation(np.concatenate([ground, on_cars]))
    points = np.column_stack([xyz, rng.random(len(xyz))]).astype(np.float32)
    looks, spent = PointEmbedder(make_network("point_identity", {"size": size}).eval().requires_grad_(False)), []
    for _ in range(30):
        began = time.perf_counter()
        rows = looks.of(points, boxes)
        spent.append(time.perf_counter() - began)
    assert rows.any(axis=1).all()
    print(f"\n{size}: 30 boxes embedded in {1000 * np.median(spent):.1f} ms (fastest {1000 * min(spent):.1f})")
