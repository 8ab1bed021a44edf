"""Instance queries, as query-based cooperation sends them: a feature vector and a reference box for each object.

As in QUEST (Fan et al., ICRA 2024) and CoopTrack (ICCV 2025): a few hundred bytes an object instead of a whole feature
map. Receivers align and fuse them.
"""

from __future__ import annotations

import struct

import numpy as np

from coopsim.comms.codecs.codec import CODECS, MOST_ROWS, encode_prefix, unpack_head
from coopsim.comms.codecs.detection_codec import OBJECT_ROW, object_rows, require_objects, valid_objects
from coopsim.comms.codecs.feature_codec import (
    MOST_VALUES,
    FeatureCodec,
    feature_number,
    features_size,
    pack_features,
    unpack_features,
)
from coopsim.errors import CodecError
from coopsim.geometry.boxes import Boxes3D
from coopsim.types import InstanceQueries

_HEAD = struct.Struct("<BHHI")
"""Kind of number, number of queries, length of a feature vector, number of the network."""


@CODECS.register("queries")
class QueriesCodec(FeatureCodec[InstanceQueries]):
    """9 bytes of head (number, K and D as uint16, space as uint32), K objects in 33 bytes each as in `DetectionsCodec`,
    and their features query by query, as float32, float16, or int8 with a scale a query.

    Objects come back within 2^-24 of themselves; the error of features is as in `FeaturesCodec`, by query
    instead of by channel. Decoded are at most 65,535 queries, and 16,777,216 values.

    Args:
        number: "float32", "float16" or "int8".
    """

    content = "queries"
    limit_bytes = 128 * 2**20

    def encode(self, content: InstanceQueries) -> bytes:
        count, width = content.feature.shape
        if max(count, width) > MOST_ROWS or content.feature.size > MOST_VALUES:
            raise CodecError(f"one message carries at most {MOST_VALUES} features, got {count} x {width}")
        good = valid_objects(content.boxes, content.score, content.label)
        if not good.all():
            raise CodecError(f"query {int(np.argmin(good))} cannot be sent: it must be finite and have a size")
        rows = object_rows(content.boxes, content.score, content.label)
        head = _HEAD.pack(self._first_byte, count, width, content.space)
        return head + rows.tobytes() + pack_features(content.feature, self._number)

    def encode_within(self, content: InstanceQueries, budget_bytes: int) -> bytes:
        surest = np.argsort(-content.score, kind="stable")
        return encode_prefix(lambda count: self.encode(content[np.sort(surest[:count])]), len(content), budget_bytes)

    def decode(self, payload: bytes) -> InstanceQueries:
        first_byte, count, width, space = unpack_head(payload, _HEAD, "queries")
        if count * width > MOST_VALUES:
            raise CodecError(f"{len(payload)} bytes announce {count} x {width} features")
        kind, start = feature_number(first_byte), _HEAD.size + count * OBJECT_ROW.itemsize
        if len(payload) != start + features_size((count, width), kind):
            raise CodecError(f"{len(payload)} bytes are not {count} queries of {width} {kind} features")
        rows = np.frombuffer(payload, OBJECT_ROW, count, _HEAD.size)
        require_objects(rows, "query")
        feature = unpack_features(payload[start:], (count, width), kind)
        return InstanceQueries(feature, Boxes3D.from_array(rows["box"]), rows["score"], rows["label"], space)
