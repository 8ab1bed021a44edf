"""Plug in your own codec: encode and decode. This one writes a detection in 6 bytes: where, what, and how sure."""

import numpy as np

import coopsim
from coopsim.comms.codecs.codec import CODECS, pack_rows, unpack_rows
from coopsim.comms.codecs.detection_codec import PlainDetections
from coopsim.errors import CodecError
from coopsim.geometry.boxes import Boxes3D
from coopsim.testing import check_codec
from coopsim.types import Detections, Mask

ROW = np.dtype([("xy_dm", "<i2", (2,)), ("score", "u1"), ("label", "u1")])
VEHICLES_M, RIDERS_M = [[4.5, 1.8, 1.5], [5.5, 2, 2.2], [8, 2.5, 3], [12, 2.5, 3]], [[1.8, 0.7, 1.7]] * 3
SIZE_M = np.array(VEHICLES_M + RIDERS_M + [[0.6, 0.6, 1.7]] * 2)


@CODECS.register("places")
class PlacesCodec(PlainDetections):
    """Places to a decimetre, scores to 1/255 and classes; every box has the size of its class and looks ahead."""

    limit_bytes = 64 * 2**20
    accepted = "places within 3276.7 m and scores in [0, 1]"

    def in_range(self, found: Detections) -> Mask:
        near = (np.abs(found.boxes.center[:, :2]) <= 3276.7).all(axis=1)
        return near & (found.score >= 0) & (found.score <= 1) & (found.label >= 0) & (found.label < len(SIZE_M))

    def encode(self, content: Detections) -> bytes:
        self.require_in_range(content)
        rows = np.empty(len(content), ROW)
        rows["xy_dm"] = np.rint(10 * content.boxes.center[:, :2])
        rows["score"], rows["label"] = np.rint(255 * content.score), content.label
        return pack_rows(rows, "places")

    def decode(self, payload: bytes) -> Detections:
        rows, rest = unpack_rows(payload, ROW, "places")
        if rest or (rows["label"] >= len(SIZE_M)).any() or (np.abs(rows["xy_dm"].astype(int)) > 32767).any():
            raise CodecError(f"{len(payload)} bytes are no places")
        size = SIZE_M[rows["label"]]
        center = np.column_stack([rows["xy_dm"] / 10, size[:, 2] / 2])
        return Detections(Boxes3D(center, size, np.zeros(len(rows))), rows["score"] / 255, rows["label"])


box = Boxes3D.from_array([[10, -3, 0.8, 4.5, 1.9, 1.6, 0.1], [-50.2, 30, 0.8, 0.5, 0.5, 1.7, 2]])
check_codec("places", [Detections.empty(), Detections(box, np.array([0.3, 0.9]), np.array([0, 7]))])
for codec in ("detections", "compact", "places"):
    score = coopsim.evaluate("late_fusion", "highway", seed=1, max_cycles=50, lidar=None, codec=codec).score
    print(f"{codec:>10}: MOTA {score['MOTA']:.1f} %, {score['bytes_per_s']:.0f} bytes/s per agent")
