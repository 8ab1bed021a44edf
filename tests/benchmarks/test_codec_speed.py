"""How fast codecs are, and what they make of the same content: bytes, and milliseconds there and back.

Run by `make bench`. Nothing here fails by time; the figures are printed.
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from typing import Any

import numpy as np
from codec_samples import some_detections, some_perception, some_queries, some_tracks

import coopsim
from coopsim.comms.codecs.codec import Codec, decoder
from coopsim.comms.codecs.feature_codec import FeaturesCodec, SparseFeaturesCodec
from coopsim.comms.codecs.point_codec import PointsCodec, VoxelsCodec
from coopsim.comms.codecs.query_codec import QueriesCodec
from coopsim.sensors.lidar.lidar import LidarConfig
from coopsim.types import BevGrid, FeatureMap, PointCloud

ROUNDS = 15


def swept(count: int = 50_000) -> PointCloud:
    """Points of one turn of a LiDAR in the crossing."""
    env = coopsim.parallel_env("crossing", lidar=LidarConfig("HDL-64E", columns=3600), max_cycles=1)
    observations, _ = env.reset(seed=0)
    rows = observations["cav_0"]["sweeps"]["lidar"]
    kept = np.linspace(0, len(rows) - 1, count).astype(int)
    return PointCloud(rows[kept, :3], rows[kept, 3])


def one_map() -> FeatureMap:
    """Features as networks with normalised layers have them."""
    rng = np.random.default_rng(0)
    values = np.maximum(rng.normal(size=(64, 96, 352)), 0).astype(np.float32)
    return FeatureMap(values, BevGrid((-70.4, 70.4), (-19.2, 19.2), 0.4), rng.random((96, 352), dtype=np.float32))


def cases() -> Iterator[tuple[str, Codec[Any], Any, int]]:
    """What is sent, by which codec, and of how many parts it is."""
    for name in ("detections", "compact"):
        yield f"100 objects, {name}", decoder(name), some_detections(100), 100
    yield "100 objects, compact, sure", decoder("compact"), some_detections(100, sure=True), 100
    yield "100 objects, cpm with velocity", decoder("cpm"), some_perception(100), 100
    yield "100 objects, tracks", decoder("tracks"), some_tracks(100), 100
    for number in ("float16", "int8"):
        yield f"100 queries of 256, {number}", QueriesCodec(number), some_queries(100, width=256), 100
    cloud = swept()
    for number in ("float32", "float16", "int16"):
        yield f"50,000 points, {number}", PointsCodec(number), cloud, len(cloud)
    for voxel_m in (0.1, 0.2, 0.4):
        yield f"50,000 points, voxels of {voxel_m} m", VoxelsCodec(voxel_m), cloud, len(cloud)
    features = one_map()
    for number in ("float32", "float16", "int8"):
        yield f"features 64 x 96 x 352, {number}", FeaturesCodec(number), features, features.values.size
    for number in ("float16", "int8"):
        sparse = SparseFeaturesCodec(338, number=number)
        yield f"features, surest 1%, {number}", sparse, features, features.values.size


def fastest_ms(call: Any, *args: Any) -> float:
    """Of the core's time, so that whoever shares it does not count."""
    spent = []
    for _ in range(ROUNDS):
        start = time.thread_time()
        call(*args)
        spent.append(time.thread_time() - start)
    return 1e3 * min(spent)


def test_there_and_back() -> None:
    print(f"\n{'':42} {'bytes':>9} {'each':>7} {'encode ms':>10} {'decode ms':>10}")
    for what, codec, content, count in cases():
        payload = codec.encode(content)
        there, back = fastest_ms(codec.encode, content), fastest_ms(codec.decode, payload)
        print(f"{what:42} {len(payload):9} {len(payload) / count:7.2f} {there:10.2f} {back:10.2f}")
        assert codec.encode(codec.decode(payload))
