"""Content for every registered codec, to try all of them on."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from coopsim.comms.codecs.cpm_codec import CollectivePerception
from coopsim.geometry.boxes import Boxes3D
from coopsim.types import BevGrid, Detections, FeatureMap, InstanceQueries, PointCloud, Tracks
from coopsim.types.track_estimates import TrackEstimates


def some_detections(count: int, seed: int = 0, *, sure: bool = False) -> Detections:
    """Within every codec's range; with covariances if `sure`."""
    rng = np.random.default_rng(seed)
    rows = rng.uniform(-150, 150, (count, 7))
    rows[:, 3:6] = rng.uniform(0.3, 12, (count, 3))
    found = Detections(Boxes3D.from_array(rows), rng.random(count), rng.integers(0, 9, count))
    return replace(found, covariance=some_covariances(count, seed)) if sure else found


def some_covariances(count: int, seed: int = 0) -> np.ndarray[Any, Any]:
    """(N, 7, 7), positive definite."""
    rng = np.random.default_rng(seed)
    axes = np.linalg.qr(rng.normal(size=(count, 7, 7)))[0]
    covariance = axes * (10.0 ** rng.uniform(-3, 3, (count, 1, 7))) @ axes.transpose(0, 2, 1)
    return (covariance + covariance.transpose(0, 2, 1)) / 2


def some_tracks(count: int, seed: int = 0) -> TrackEstimates:
    rng, found = np.random.default_rng(seed), some_detections(count, seed)
    velocity = rng.normal(0, 15, (count, 2))
    tracks = Tracks(np.arange(count), found.boxes, velocity, found.score, found.label)
    return TrackEstimates(tracks, np.tile(np.diag([0.3, 0.2, 4.0, 5.0]), (count, 1, 1)))


def some_points(count: int, seed: int = 0, extent_m: float = 100.0) -> PointCloud:
    rng = np.random.default_rng(seed)
    xyz = rng.uniform(-extent_m, extent_m, (count, 3)) * [1, 1, 0.03]
    return PointCloud(xyz.astype(np.float32), rng.random(count, dtype=np.float32))


def some_grid(rows: int, columns: int) -> BevGrid:
    return BevGrid((-0.4 * columns, 0.0), (3.7, 3.7 + 0.4 * rows), 0.4)


def some_features(shape: tuple[int, int, int] = (4, 6, 9), seed: int = 0) -> FeatureMap:
    rng = np.random.default_rng(seed)
    values = rng.normal(size=shape) * 10.0 ** rng.uniform(-3, 3, (shape[0], 1, 1))
    return FeatureMap(values.astype(np.float32), some_grid(*shape[1:]), rng.random(shape[1:], dtype=np.float32))


def some_queries(count: int, seed: int = 0, width: int = 16) -> InstanceQueries:
    rng, found = np.random.default_rng(seed), some_detections(count, seed)
    feature = rng.normal(size=(count, width)).astype(np.float32)
    return InstanceQueries(feature, found.boxes, found.score, found.label)


def some_perception(count: int, seed: int = 0) -> CollectivePerception:
    rng = np.random.default_rng(seed)
    velocity = some_velocities(rng, count)
    position = rng.uniform(-500, 500, 3)
    found = replace(some_detections(count, seed), velocity=velocity)
    return CollectivePerception(7, 12_345_678_901, position, found)


def some_velocities(rng: np.random.Generator, count: int) -> np.ndarray[Any, Any]:
    """(N, 2) m/s; a third of them unknown."""
    velocity = rng.normal(0, 15, (count, 2))
    velocity[::3] = np.nan
    return velocity


SAMPLES: dict[str, Callable[[int], Any]] = {
    "detections": some_detections,
    "compact": lambda count: some_detections(count, sure=True),
    "cpm": some_perception,
    "tracks": some_tracks,
    "points": some_points,
    "voxels": some_points,
    "features": lambda count: some_features((count, 5, 7)),
    "sparse_features": lambda count: some_features((count, 5, 7)),
    "queries": some_queries,
}
"""By codec: content with so many objects, points or channels."""
