"""Detections in centimetres: half the bytes of float32, and a coarse covariance where the detector states one."""

from __future__ import annotations

import math
import struct

import numpy as np

from coopsim.comms.codecs.codec import CODECS, pack_rows, unpack_rows
from coopsim.comms.codecs.detection_codec import PlainDetections
from coopsim.errors import CodecError
from coopsim.geometry.boxes import Boxes3D
from coopsim.geometry.se3 import Floats, wrap_angle
from coopsim.types import Detections, Mask
from coopsim.types.taxonomy import CLASS_NAMES

_STEP_M = 0.01
_STEP_RAD = 2 * math.pi / 2**16
_SIGMAS = (1e-3, 1e3)
_MOST_RHO = 126

_ROW = np.dtype([("center", "<i2", (3,)), ("size", "<u2", (3,)), ("yaw", "<u2"), ("score", "<f2"), ("label", "u1")])
_SPREAD = np.dtype([("sigma", "u1", (7,)), ("rho", "i1")])
_FLAGS = struct.Struct("<B")


@CODECS.register("compact")
class CompactDetectionsCodec(PlainDetections):
    """A box, its score and its label in 17 bytes, and its uncertainty in 8 more.

    | bytes | what | step | range |
    |---|---|---|---|
    | 2 | number of objects | | 0..65,535 |
    | 17 each: 3 x int16 | centre | 1 cm | within 327.67 m of the sender |
    | 3 x uint16 | length, width, height | 1 cm | 1 cm to 655.35 m |
    | uint16 | heading | 2 pi / 65,536 | all |
    | float16 | score | 2^-11 of itself | within 65,504 |
    | uint8 | label | | `ObjectClass` |
    | 1 | whether uncertainties follow: 0 or 1 | | |
    | 8 each: 7 x uint8 | standard deviations of x, y, z, l, w, h, yaw | 5.6 % | 1 mm (mrad) to 1 km (krad) |
    | int8 | correlation of x and y | 1/127 | within 126/127 |

    Values out of range are refused, because a box in a wrong place is worse than none; only standard deviations and
    correlations saturate. Other correlations, and embeddings, are not sent. At most 65,535 objects are decoded.
    """

    CENTER_ERROR_M = SIZE_ERROR_M = _STEP_M / 2
    YAW_ERROR_RAD = _STEP_RAD / 2
    SCORE_ERROR = 2.0**-11
    """Relative; 2^-25 for scores below 2^-14."""
    SIGMA_ERROR = math.expm1(math.log(_SIGMAS[1] / _SIGMAS[0]) / 255 / 2)
    """Relative, within the range."""
    RHO_ERROR = 1 / 127

    limit_bytes = 64 * 2**20
    accepted = (
        f"finite centres within 327.67 m, sizes from 0.01 to 655.35 m, scores within 65504, labels in "
        f"0..{len(CLASS_NAMES) - 1} and variances >= 0"
    )

    def in_range(self, found: Detections) -> Mask:
        boxes, score = found.boxes, found.score
        with np.errstate(over="ignore"):
            center, size = np.rint(boxes.center / _STEP_M), np.rint(boxes.size / _STEP_M)
        good = np.asarray((np.abs(center) <= 0x7FFF).all(axis=1))
        good &= ((size >= 1) & (size <= 0xFFFF)).all(axis=1) & np.isfinite(boxes.yaw)
        good &= (np.abs(score) <= float(np.finfo(np.float16).max)) & (found.label >= 0)
        good &= found.label < len(CLASS_NAMES)
        if found.covariance is not None:
            variance = np.diagonal(found.covariance, axis1=1, axis2=2)
            good &= np.isfinite(found.covariance).all(axis=(1, 2)) & (variance >= 0).all(axis=1)
        return good

    def encode(self, content: Detections) -> bytes:
        self.require_in_range(content)
        rows = np.empty(len(content), dtype=_ROW)
        rows["center"] = np.rint(content.boxes.center / _STEP_M)
        rows["size"] = np.rint(content.boxes.size / _STEP_M)
        rows["yaw"] = np.rint(wrap_angle(content.boxes.yaw) / _STEP_RAD).astype(np.int64) % 2**16
        rows["score"], rows["label"] = content.score, content.label
        spread = b"" if content.covariance is None else _spread(content.covariance)
        return pack_rows(rows, "detections") + _FLAGS.pack(content.covariance is not None) + spread

    def decode(self, payload: bytes) -> Detections:
        rows, rest = unpack_rows(payload, _ROW, "detections")
        stated = rest[:1] == b"\x01"
        if rest[:1] not in (b"\x00", b"\x01") or len(rest) != _FLAGS.size + stated * len(rows) * _SPREAD.itemsize:
            raise CodecError(f"{len(payload)} bytes are not {len(rows)} compact detections")
        score = rows["score"].astype(np.float64)
        good = np.isfinite(score) & (rows["size"] > 0).all(axis=1) & (rows["label"] < len(CLASS_NAMES))
        if not good.all():
            raise CodecError(f"detection {int(np.argmin(good))} is invalid: accepted are {self.accepted}")
        boxes = Boxes3D(rows["center"] * _STEP_M, rows["size"] * _STEP_M, wrap_angle(rows["yaw"] * _STEP_RAD))
        spread = np.frombuffer(rest, dtype=_SPREAD, offset=_FLAGS.size) if stated else None
        return Detections(boxes, score, rows["label"], None if spread is None else _covariance(spread))


def _spread(covariance: Floats) -> bytes:
    """Return standard deviations, and the correlation of x and y, of covariances (N, 7, 7) as `_SPREAD` rows."""
    least, most = _SIGMAS
    sigma = np.sqrt(np.diagonal(covariance, axis1=1, axis2=2))
    rows = np.empty(len(covariance), dtype=_SPREAD)
    rows["sigma"] = np.rint(255 * np.log(np.clip(sigma, least, most) / least) / math.log(most / least))
    both = sigma[:, 0] * sigma[:, 1]
    rho = np.divide(covariance[:, 0, 1], both, out=np.zeros(len(both)), where=both > 0)
    rows["rho"] = np.clip(np.rint(127 * np.clip(rho, -1, 1)), -_MOST_RHO, _MOST_RHO)
    return rows.tobytes()


def _covariance(rows: np.ndarray[tuple[int], np.dtype[np.void]]) -> Floats:
    """Return covariances (N, 7, 7), always positive definite, of `_SPREAD` rows."""
    least, most = _SIGMAS
    sigma = least * (most / least) ** (rows["sigma"] / 255)
    covariance = np.zeros((len(rows), 7, 7))
    covariance[:, np.arange(7), np.arange(7)] = sigma**2
    rho = np.clip(rows["rho"], -_MOST_RHO, _MOST_RHO) / 127
    covariance[:, 0, 1] = covariance[:, 1, 0] = rho * sigma[:, 0] * sigma[:, 1]
    return covariance
