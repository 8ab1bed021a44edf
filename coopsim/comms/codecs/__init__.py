"""The codecs, one module each. Importing this registers them in `coopsim.comms.codecs.codec.CODECS`."""

from coopsim.comms.codecs import (
    compact_codec,
    cpm_codec,
    detection_codec,
    feature_codec,
    point_codec,
    query_codec,
    sparse_feature_codec,
    track_codec,
    voxel_codec,
)

__all__ = [
    "compact_codec",
    "cpm_codec",
    "detection_codec",
    "feature_codec",
    "point_codec",
    "query_codec",
    "sparse_feature_codec",
    "track_codec",
    "voxel_codec",
]
