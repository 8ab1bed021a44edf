"""Codecs of detections: in float32 with embeddings, or in centimetres with a coarse covariance."""

from __future__ import annotations

import math
import struct
from abc import abstractmethod
from typing import ClassVar, TypeVar

import numpy as np
from numpy.typing import NDArray

from coopsim.comms.codecs.codec import CODECS, MOST_ROWS, Codec, encode_prefix, pack_rows, unpack_rows
from coopsim.errors import CodecError
from coopsim.geometry.boxes import Boxes3D
from coopsim.geometry.se3 import Floats, wrap_angle
from coopsim.support.kernels import njit
from coopsim.types import Detections, Ints, Mask, PoseEstimate
from coopsim.types.taxonomy import CLASS_NAMES
from coopsim.types.valid_detections import normalize_embeddings

T = TypeVar("T")

OBJECT_ROW = np.dtype([("box", "<f4", (7,)), ("score", "<f4"), ("label", "u1")])
"""A detected object in 33 bytes."""


def valid_objects(boxes: Boxes3D, score: Floats, label: Ints) -> Mask:
    """Return the mask (N,) of objects that an `OBJECT_ROW` can hold: finite, of positive size, of a known class."""
    good: Mask = _valid_rows(boxes.array, np.ascontiguousarray(score), np.ascontiguousarray(label), len(CLASS_NAMES))
    return good


@njit(cache=True, nogil=True)
def _valid_rows(boxes: Floats, score: Floats, label: Ints, classes: int) -> Mask:
    good = (label >= 0) & (label < classes)
    for i in range(len(boxes)):
        good[i] &= np.isfinite(np.float32(score[i]))
        for j in range(7):
            number = np.float32(boxes[i, j])
            good[i] &= np.isfinite(number) and (number > 0 or not 3 <= j < 6)
    return good


def object_rows(boxes: Boxes3D, score: Floats, label: Ints) -> NDArray[np.void]:
    """Return objects as `OBJECT_ROW`s; they must be valid."""
    rows = np.empty(len(boxes), dtype=OBJECT_ROW)
    rows["box"], rows["score"], rows["label"] = boxes.array, score, label
    return rows


def require_objects(rows: NDArray[np.void], what: str) -> None:
    """Raise `CodecError`, naming the first, for `OBJECT_ROW`s that `object_rows` does not make."""
    if len(rows) and int(rows["label"].max()) >= len(CLASS_NAMES):
        raise CodecError(f"{what} label {int(rows['label'].max())} is not in 0..{len(CLASS_NAMES) - 1}")
    good = np.isfinite(rows["box"]).all(axis=1) & np.isfinite(rows["score"]) & (rows["box"][:, 3:6] > 0).all(axis=1)
    if not good.all():
        raise CodecError(f"{what} {int(np.argmin(good))} is invalid: numbers must be finite and sizes > 0")


VELOCITY_ROW = np.dtype(("<i2", (2,)))
"""A velocity over ground along x and y, in cm/s."""

_UNKNOWN = -(2**15)
_VELOCITIES_FOLLOW = b"\0\0"


def velocity_rows(velocity: Floats | None) -> bytes:
    """Return velocities (N, 2) m/s as `VELOCITY_ROW`s; nothing if all are unknown.

    Unknown ones, and those beyond 327.67 m/s, which nothing on a road has, are sent as -32,768 in both places.
    """
    if velocity is None:
        return b""
    stated: Mask = np.asarray(np.isfinite(velocity).all(axis=1))
    steps = np.rint(100 * np.where(stated[:, None], velocity, 0.0))
    known: Mask = stated & np.asarray((np.abs(steps) < -_UNKNOWN).all(axis=1))
    return np.where(known[:, None], steps, _UNKNOWN).astype(VELOCITY_ROW.base).tobytes() if known.any() else b""


def velocities_in(block: bytes, count: int) -> Floats:
    """Return the velocities (N, 2) m/s of `velocity_rows`, NaN where unknown.

    Raises:
        CodecError: the bytes are not a velocity for each of `count` objects.
    """
    if not count or len(block) != count * VELOCITY_ROW.itemsize:
        raise CodecError(f"{len(block)} bytes are not the velocities of {count} detections")
    steps = np.frombuffer(block, dtype=VELOCITY_ROW.base).reshape(count, 2)
    return np.where((steps == _UNKNOWN).any(axis=1, keepdims=True), np.nan, steps * 0.01)


class SharesDetections(Codec[T]):
    """A codec for detections. Policies that need detections run with any of them."""

    content: ClassVar[str] = "detections"
    most_objects: ClassVar[int] = MOST_ROWS

    def sendable(self, found: Detections) -> Mask:
        """Return the mask (N,) of detections that one message can carry: those in range, and of too many the surest."""
        good = self.in_range(found)
        if np.count_nonzero(good) > self.most_objects:
            surest = np.argsort(np.where(good, -found.score, np.inf), kind="stable")[: self.most_objects]
            good = np.isin(np.arange(len(found)), surest)
        return good

    @abstractmethod
    def in_range(self, found: Detections) -> Mask:
        """Return the mask (N,) of detections that the codec can carry within its error bounds."""

    @abstractmethod
    def content_of(self, found: Detections, sender: str, time_ns: int, pose: PoseEstimate) -> T:
        """Return the content for detections in the base frame of `sender`, at a time and an estimated pose."""

    @abstractmethod
    def detections_in(self, content: T, pose: PoseEstimate) -> Detections:
        """Return the detections in the content of a message sent from `pose`, in the sender's base frame."""


class PlainDetections(SharesDetections[Detections]):
    """A codec whose content is a `Detections` object.

    Attributes:
        accepted: the range in words, for error messages.
    """

    accepted: ClassVar[str]

    def content_of(self, found: Detections, sender: str, time_ns: int, pose: PoseEstimate) -> Detections:
        return found

    def detections_in(self, content: Detections, pose: PoseEstimate) -> Detections:
        return content

    def encode_within(self, content: Detections, budget_bytes: int) -> bytes:
        """Return the payload of as many leading rows as a budget holds: put the most useful first."""
        return encode_prefix(lambda count: self.encode(content[:count]), len(content), budget_bytes)

    def require_in_range(self, found: Detections) -> None:
        """Raise `CodecError`, naming the first, for detections that cannot be sent."""
        if not (good := self.in_range(found)).all():
            raise CodecError(f"detection {int(np.argmin(good))} cannot be sent: accepted are {self.accepted}")


@CODECS.register("detections")
class DetectionsCodec(PlainDetections):
    """Boxes (seven float32), score (float32) and label (one byte): 33 bytes an object, 2 for their number.

    Where any of them has a velocity, two zeros follow and 4 bytes for each object (see `velocity_rows`). Where any has
    an embedding, 2 bytes follow for the width, and 2 for each element of each object: the embedding at length 1 as
    float16, zeros for none. Covariances are not sent. Decoded are at most 65,535 objects, and 4,194,304 elements of
    embeddings.
    """

    RELATIVE_ERROR = 2.0**-24
    limit_bytes = 64 * 2**20
    accepted = f"finite float32, sizes > 0 and labels in 0..{len(CLASS_NAMES) - 1}"

    _WIDEST = 4096  # bounds the tables of embeddings that receivers keep
    _MOST_ELEMENTS = 2**22

    def in_range(self, found: Detections) -> Mask:
        return valid_objects(found.boxes, found.score, found.label)

    def encode(self, content: Detections) -> bytes:
        self.require_in_range(content)
        rows = object_rows(content.boxes, content.score, content.label)
        velocity = velocity_rows(content.velocity)
        moving = _VELOCITIES_FOLLOW + velocity if velocity else b""
        return pack_rows(rows, "detections") + moving + self._encode_embeddings(content)

    def decode(self, payload: bytes) -> Detections:
        rows, rest = unpack_rows(payload, OBJECT_ROW, "detections")
        require_objects(rows, "detection")
        velocity = None
        if rest.startswith(_VELOCITIES_FOLLOW):
            last = len(_VELOCITIES_FOLLOW) + len(rows) * VELOCITY_ROW.itemsize
            velocity, rest = velocities_in(rest[len(_VELOCITIES_FOLLOW) : last], len(rows)), rest[last:]
        embedding = self._decode_embeddings(rest, len(rows))
        boxes = Boxes3D.from_array(rows["box"])
        return Detections(boxes, rows["score"], rows["label"], embedding=embedding, velocity=velocity)

    def _encode_embeddings(self, content: Detections) -> bytes:
        if content.embedding is None:
            return b""
        unit, present = normalize_embeddings(content.embedding)
        if not present.any():
            return b""
        if unit.shape[1] > self._WIDEST:
            raise CodecError(f"an embedding has at most {self._WIDEST} elements, got {unit.shape[1]}")
        if unit.size > self._MOST_ELEMENTS:
            raise CodecError(f"one message carries at most {self._MOST_ELEMENTS} elements, got {unit.size}")
        return struct.pack("<H", unit.shape[1]) + unit.astype("<f2").tobytes()

    def _decode_embeddings(self, block: bytes, count: int) -> Floats | None:
        if not block:
            return None
        width = struct.unpack_from("<H", block)[0] if len(block) >= 2 else 0
        fits = 1 <= width <= self._WIDEST and count * width <= self._MOST_ELEMENTS
        if not (count and fits and len(block) == 2 + 2 * count * width):
            raise CodecError(f"{len(block)} bytes after {count} detections are not an embedding for each")
        values = np.frombuffer(block, dtype="<f2", offset=2).reshape(count, width).astype(np.float64)
        if not np.isfinite(values).all():
            raise CodecError("the embeddings of detections must be finite")
        return values


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
