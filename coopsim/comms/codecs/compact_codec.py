"""Detections in centimetres: half the bytes of float32, and a coarse covariance where the detector states one."""

from __future__ import annotations

import math
import struct

import numpy as np

from coopsim.comms.codecs.codec import CODECS, pack_rows, unpack_rows
from coopsim.comms.codecs.detection_codec import VELOCITY_ROW, PlainDetections, velocities_in, velocity_rows
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
_SPREAD_FOLLOWS, _VELOCITY_FOLLOWS = 1, 2


@CODECS.register("compact")
class CompactDetectionsCodec(PlainDetections):
    """A box, its score and its label in 17 bytes, its uncertainty in 8 more, and its velocity in 4 more.

    | bytes | what | step | range |
    |---|---|---|---|
    | 2 | number of objects | | 0..65,535 |
    | 17 each: 3 x int16 | centre | 1 cm | within 327.67 m of the sender |
    | 3 x uint16 | length, width, height | 1 cm | 1 cm to 655.35 m |
    | uint16 | heading | 2 pi / 65,536 | all |
    | float16 | score | 2^-11 of itself | within 65,504 |
    | uint8 | label | | `ObjectClass` |
    | 1 | what follows: 1 for uncertainties, 2 for velocities, 3 for both, 0 for neither | | |
    | 8 each: 7 x uint8 | standard deviations of x, y, z, l, w, h, yaw | 5.6 % | 1 mm (mrad) to 1 km (krad) |
    | int8 | correlation of x and y | 1/127 | within 126/127 |
    | 4 each: 2 x int16 | velocity over ground along x and y | 1 cm/s | within 327.67 m/s; -32,768: unknown |

    Values out of range are refused, because a box in a wrong place is worse than none; only standard deviations and
    correlations saturate, and a velocity out of range counts as unknown. Other correlations, and embeddings, are not
    sent. At most 65,535 objects are decoded.
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
        velocity = velocity_rows(content.velocity)
        flags = (_SPREAD_FOLLOWS if content.covariance is not None else 0) | (_VELOCITY_FOLLOWS if velocity else 0)
        return pack_rows(rows, "detections") + _FLAGS.pack(flags) + spread + velocity

    def decode(self, payload: bytes) -> Detections:
        rows, rest = unpack_rows(payload, _ROW, "detections")
        flags = rest[0] if rest else -1
        spread_bytes = len(rows) * _SPREAD.itemsize * bool(flags & _SPREAD_FOLLOWS)
        velocity_bytes = len(rows) * VELOCITY_ROW.itemsize * bool(flags & _VELOCITY_FOLLOWS)
        if flags not in range(4) or len(rest) != _FLAGS.size + spread_bytes + velocity_bytes:
            raise CodecError(f"{len(payload)} bytes are not {len(rows)} compact detections")
        score = rows["score"].astype(np.float64)
        good = np.isfinite(score) & (rows["size"] > 0).all(axis=1) & (rows["label"] < len(CLASS_NAMES))
        if not good.all():
            raise CodecError(f"detection {int(np.argmin(good))} is invalid: accepted are {self.accepted}")
        boxes = Boxes3D(rows["center"] * _STEP_M, rows["size"] * _STEP_M, wrap_angle(rows["yaw"] * _STEP_RAD))
        spread, velocity = rest[_FLAGS.size : _FLAGS.size + spread_bytes], rest[_FLAGS.size + spread_bytes :]
        return Detections(
            boxes,
            score,
            rows["label"],
            _covariance(np.frombuffer(spread, dtype=_SPREAD)) if flags & _SPREAD_FOLLOWS else None,
            velocity=velocities_in(velocity, len(rows)) if flags & _VELOCITY_FOLLOWS else None,
        )


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
