"""The codecs, one module each. Importing this registers them in `coopsim.comms.codecs.codec.CODECS`."""

from coopsim.comms.codecs import (
    compact_detections,
    cpm,
    detections,
    features,
    points,
    queries,
    sparse_features,
    tracks,
    voxels,
)

__all__ = [
    "compact_detections",
    "cpm",
    "detections",
    "features",
    "points",
    "queries",
    "sparse_features",
    "tracks",
    "voxels",
]
