"""Codecs: content as payload bytes and back. Importing registers them in `coopsim.comms.codecs.codec.CODECS`.

Input is a typed content (`Detections`, `PointCloud`, `FeatureMap`, ...), output its bytes. Start with `codec.py`.
"""

from coopsim.comms.codecs import (
    cpm_codec,
    detection_codec,
    feature_codec,
    point_codec,
    query_codec,
    track_codec,
)

__all__ = [
    "cpm_codec",
    "detection_codec",
    "feature_codec",
    "point_codec",
    "query_codec",
    "track_codec",
]
