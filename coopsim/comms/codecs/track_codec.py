"""The codec for tracks with their covariance. All numbers are little-endian."""

from __future__ import annotations

import numpy as np

from coopsim.comms.codecs.codec import CODECS, Codec, pack_rows, unpack_rows
from coopsim.errors import CodecError
from coopsim.geometry.boxes import Boxes3D
from coopsim.support.arrays import as_numbers
from coopsim.types import Mask, Tracks
from coopsim.types.taxonomy import CLASS_NAMES
from coopsim.types.track_estimates import PLANAR, TrackEstimates

VARIANCES = (1e-6, 1e7)
"""The least and the largest eigenvalue of a covariance, m^2 and (m/s)^2: no position is known better than to a
millimetre, the velocity of a new track has 1e6, and within these limits no later step runs into rounding."""

_UPPER = np.triu_indices(PLANAR)

_ROW = np.dtype(
    [
        ("id", "<u4"),
        ("box", "<f4", (7,)),
        ("velocity", "<f4", (2,)),
        ("score", "<f4"),
        ("label", "u1"),
        ("covariance", "<f4", (len(_UPPER[0]),)),
    ]
)


@CODECS.register("tracks")
class TracksCodec(Codec[TrackEstimates]):
    """Id (uint32), box (seven float32), velocity (two), score (one), label (one byte), and the upper triangle of the
    covariance of x, y, vx, vy (ten float32): 85 bytes an object, 2 for their number.

    Real numbers come back within 6e-8 of themselves, relative. Half precision would save 20 bytes, but it ends at
    65504, and the velocity of a new track has a variance of 1e6. Decoded are at most 65,535 tracks.
    """

    content = "tracks"
    RELATIVE_ERROR = 2.0**-24
    limit_bytes = 64 * 2**20

    def encode(self, content: TrackEstimates) -> bytes:
        """Return the payload; raise `CodecError` for too many tracks, or for one that `sendable` excludes."""
        if not (good := sendable(content)).all():
            raise CodecError(f"track {int(np.argmin(good))} cannot be sent: {_ACCEPTED}")
        rows = np.empty(len(content), dtype=_ROW)
        tracks = content.tracks
        rows["id"], rows["box"], rows["velocity"] = tracks.id, tracks.boxes.array, tracks.velocity
        rows["score"], rows["label"] = tracks.score, tracks.label
        rows["covariance"] = content.covariance[:, *_UPPER]
        return pack_rows(rows, "tracks")

    def decode(self, payload: bytes) -> TrackEstimates:
        rows, rest = unpack_rows(payload, _ROW, "tracks")
        if rest:
            raise CodecError(f"{len(payload)} bytes are not a whole number of tracks")
        if len(np.unique(rows["id"])) < len(rows):
            raise CodecError("track ids must be unique within a message")
        tracks = Tracks(rows["id"], Boxes3D.from_array(rows["box"]), rows["velocity"], rows["score"], rows["label"])
        covariance = np.empty((len(rows), PLANAR, PLANAR))
        upper = as_numbers(rows["covariance"], np.float64, "covariance")
        covariance[:, *_UPPER] = covariance[:, *_UPPER[::-1]] = upper
        content = TrackEstimates(tracks, covariance)
        if not (good := sendable(content)).all():
            raise CodecError(f"track {int(np.argmin(good))} is invalid: {_ACCEPTED}")
        return content


_ACCEPTED = (
    f"accepted are ids in 0..{2**32 - 1}, labels in 0..{len(CLASS_NAMES) - 1}, finite float32, sizes > 0 and "
    f"covariances with eigenvalues in [{VARIANCES[0]:g}, {VARIANCES[1]:g}]"
)


def sendable(content: TrackEstimates) -> Mask:
    """Return the mask (N,) of tracks that a message can carry: in range, finite in float32, of usable covariance."""
    tracks = content.tracks
    numbers = np.column_stack([tracks.boxes.array, tracks.velocity, tracks.score, content.covariance[:, *_UPPER]])
    with np.errstate(over="ignore", under="ignore"):
        rounded = numbers.astype(np.float32)
    good = np.asarray(np.isfinite(rounded).all(axis=1) & (rounded[:, 3:6] > 0).all(axis=1))
    good &= (tracks.id >= 0) & (tracks.id < 2**32) & (tracks.label >= 0) & (tracks.label < len(CLASS_NAMES))
    sent = content.covariance[good].astype(np.float32).astype(np.float64)
    variances = np.linalg.eigvalsh(sent, UPLO="U")
    good[good] = (variances[:, 0] >= VARIANCES[0]) & (variances[:, -1] <= VARIANCES[1])
    return good
