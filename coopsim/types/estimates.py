"""Objects as estimated and as they are: detections, tracks, ground truth."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from coopsim.geometry.boxes import Boxes3D
from coopsim.geometry.se3 import SE3, Floats, SE3Batch
from coopsim.support.arrays import freeze, frozen, require_finite, sealed, unchecked
from coopsim.types.taxonomy import CLASS_NAMES, are_sound, require_identified
from coopsim.types.units import Ints, Mask


@dataclass(frozen=True, slots=True, eq=False)
class Detections:
    """N detected objects in one frame of reference.

    Attributes:
        boxes: N boxes.
        score: (N,) confidence; larger is surer. Simulated scores lie in [0, 1], recorded ones need not.
        label: (N,) int, an `ObjectClass`.
        covariance: (N, 7, 7) of x, y, z, l, w, h, yaw; None: the detector states none.
        embedding: (N, D) appearance, or None. A row that is not finite, or all zeros, means that it is unknown.
        seen_by: (N, A) which of A agents detected each object, where several agents' detections were merged, or None.
        velocity: (N, 2) m/s over ground, in the axes of the frame; a row of NaN is unknown. None: all are unknown.
    """

    boxes: Boxes3D
    score: Floats
    label: Ints
    covariance: Floats | None = None
    embedding: Floats | None = None
    seen_by: Mask | None = None
    velocity: Floats | None = None

    def __post_init__(self) -> None:
        count = len(self.boxes)
        object.__setattr__(self, "score", frozen(self.score, (count,), np.float64, "score"))
        object.__setattr__(self, "label", frozen(self.label, (count,), np.int64, "label"))
        if self.covariance is not None:
            covariance = frozen(self.covariance, (count, 7, 7), np.float64, "covariance")
            object.__setattr__(self, "covariance", covariance)
        if self.embedding is not None:
            embedding = frozen(self.embedding, (count, None), np.float64, "embedding")
            object.__setattr__(self, "embedding", embedding)
        if self.seen_by is not None:
            object.__setattr__(self, "seen_by", frozen(self.seen_by, (count, None), np.bool_, "seen_by"))
        if self.velocity is not None:
            object.__setattr__(self, "velocity", frozen(self.velocity, (count, 2), np.float64, "velocity"))

    @classmethod
    def trusted(
        cls,
        boxes: Boxes3D,
        score: Floats,
        label: Ints,
        covariance: Floats | None = None,
        embedding: Floats | None = None,
        seen_by: Mask | None = None,
        velocity: Floats | None = None,
    ) -> Detections:
        """Make detections without a check, of new or read-only arrays that are known to have shape and type."""
        detections = object.__new__(cls)
        object.__setattr__(detections, "boxes", boxes)
        object.__setattr__(detections, "score", sealed(score))
        object.__setattr__(detections, "label", sealed(label))
        object.__setattr__(detections, "covariance", covariance if covariance is None else sealed(covariance))
        object.__setattr__(detections, "embedding", embedding if embedding is None else sealed(embedding))
        object.__setattr__(detections, "seen_by", seen_by if seen_by is None else sealed(seen_by))
        object.__setattr__(detections, "velocity", velocity if velocity is None else sealed(velocity))
        return detections

    @classmethod
    def empty(cls) -> Detections:
        """Return no detections."""
        return cls(Boxes3D.empty(), np.zeros(0), np.zeros(0, dtype=np.int64))

    @classmethod
    def concatenate(cls, parts: Iterable[Detections]) -> Detections:
        """Concatenate detections in order.

        Covariances stay only where every non-empty part has them. Embeddings stay if any part has them, with NaN for
        the detections of parts without embeddings, or with embeddings of another length than the first part's.
        Velocities stay if any part has them, with NaN for the others.
        `seen_by` is dropped: the parts need not count the same agents.
        """
        full = [part for part in parts if len(part.score)]
        if not full:
            return cls.empty()
        if len(full) == 1:
            return replace(full[0], seen_by=None)
        counts = [len(part) for part in full]
        covariances = [part.covariance for part in full if part.covariance is not None]
        return cls.trusted(
            Boxes3D.concatenate(part.boxes for part in full),
            np.concatenate([part.score for part in full]),
            np.concatenate([part.label for part in full]),
            np.concatenate(covariances) if len(covariances) == len(full) else None,
            _joined([part.embedding for part in full], counts),
            velocity=_joined([part.velocity for part in full], counts),
        )

    def __len__(self) -> int:
        return len(self.boxes)

    def __getitem__(self, index: slice | NDArray[Any]) -> Detections:
        return Detections.trusted(
            self.boxes[index],
            self.score[index],
            self.label[index],
            None if self.covariance is None else self.covariance[index],
            None if self.embedding is None else self.embedding[index],
            None if self.seen_by is None else self.seen_by[index],
            None if self.velocity is None else self.velocity[index],
        )

    def transform(self, dst_SE3_src: SE3) -> Detections:
        """Move the detections from frame src to frame dst (gravity-aligned)."""
        return self._moved(self.boxes.transform(dst_SE3_src), dst_SE3_src.rotation)

    def transform_each(self, transforms: SE3Batch, number: Ints) -> Detections:
        """Move each detection by the transform of its number (N,), as `transform` does."""
        return self._moved(self.boxes.transform_each(transforms, number), transforms.rotation[number])

    def _moved(self, boxes: Boxes3D, rotation: Floats) -> Detections:
        """Return the detections with moved boxes, turned by a rotation (3, 3), or each by its own (N, 3, 3)."""
        covariance, velocity = self.covariance, self.velocity
        if covariance is not None:
            covariance = _turned(covariance, rotation)
        if velocity is not None:
            velocity = (rotation[..., :2, :2] @ velocity[:, :, None])[:, :, 0]
        return Detections.trusted(
            boxes, self.score, self.label, covariance, self.embedding, self.seen_by, velocity=velocity
        )


def _turned(covariance: Floats, rotation: Floats) -> Floats:
    """Return covariances (N, 7, 7) of boxes that are turned, all (3, 3) or each by its own (N, 3, 3)."""
    jacobian = np.zeros((*rotation.shape[:-2], 7, 7))
    jacobian[..., np.arange(7), np.arange(7)] = 1.0
    jacobian[..., :3, :3] = rotation
    turned: Floats = jacobian @ covariance @ jacobian.swapaxes(-1, -2)
    return turned


def diagonals(variance: Floats) -> Floats:
    """Return covariances (N, 7, 7) of boxes whose numbers err each by itself, with variances (N, 7)."""
    covariance: Floats = np.zeros((*variance.shape, variance.shape[1]))
    covariance[:, np.arange(7), np.arange(7)] = variance
    return covariance


def _joined(columns: Sequence[Floats | None], counts: Sequence[int]) -> Floats | None:
    """Join a column (N, D) of parts as `Detections.concatenate` says: None if no part has it.

    Parts without it, or with another width than the first that has it, get NaN.
    """
    width = next((column.shape[1] for column in columns if column is not None), None)
    if width is None:
        return None
    return np.concatenate(
        [
            column if column is not None and column.shape[1] == width else np.full((count, width), np.nan)
            for column, count in zip(columns, counts, strict=True)
        ]
    )


@dataclass(frozen=True, slots=True, eq=False)
class Tracks:
    """N tracked objects in one frame of reference.

    Attributes:
        id: (N,) int, unique within a frame and constant over an object's life.
        boxes: N boxes.
        velocity: (N, 2) m/s over ground, in the axes of the frame.
        score: (N,) confidence, any finite number; larger is surer. Metrics rank tracks by their mean score, and boxes
            by their own: trackers of recorded detections have the scores of these, which need not lie in [0, 1].
        label: (N,) int, an `ObjectClass`.
    """

    id: Ints
    boxes: Boxes3D
    velocity: Floats
    score: Floats
    label: Ints

    def __post_init__(self) -> None:
        count = len(self.boxes)
        object.__setattr__(self, "id", frozen(self.id, (count,), np.int64, "id"))
        object.__setattr__(self, "velocity", frozen(self.velocity, (count, 2), np.float64, "velocity"))
        object.__setattr__(self, "score", frozen(self.score, (count,), np.float64, "score"))
        object.__setattr__(self, "label", frozen(self.label, (count,), np.int64, "label"))

    @classmethod
    def trusted(cls, ids: Ints, boxes: Boxes3D, velocity: Floats, score: Floats, label: Ints) -> Tracks:
        """Make tracks without a check, of new or read-only arrays that are known to have shape and type."""
        tracks = object.__new__(cls)
        object.__setattr__(tracks, "id", sealed(ids))
        object.__setattr__(tracks, "boxes", boxes)
        object.__setattr__(tracks, "velocity", sealed(velocity))
        object.__setattr__(tracks, "score", sealed(score))
        object.__setattr__(tracks, "label", sealed(label))
        return tracks

    @classmethod
    def empty(cls) -> Tracks:
        """Return no tracks."""
        none = np.zeros(0, dtype=np.int64)
        return cls(none, Boxes3D.empty(), np.zeros((0, 2)), np.zeros(0), none)

    def __len__(self) -> int:
        return len(self.boxes)

    def __getitem__(self, index: slice | NDArray[Any]) -> Tracks:
        boxes, columns = self.boxes[index], (self.velocity[index], self.score[index], self.label[index])
        return Tracks.trusted(self.id[index], boxes, *columns)

    def transform(self, dst_SE3_src: SE3) -> Tracks:
        """Move the tracks from frame src to frame dst (gravity-aligned)."""
        velocity = dst_SE3_src.rotate_planar(self.velocity)
        return Tracks.trusted(self.id, self.boxes.transform(dst_SE3_src), velocity, self.score, self.label)

    def validate(self) -> None:
        """Raise `InvalidValueError` if a value is not finite, a size not positive, or an id not unique."""
        if not len(self):
            return
        require_finite(self.velocity, "track velocity")
        require_finite(self.score, "track score")
        _require_sound(self.boxes, self.id, self.label, "track")


@dataclass(frozen=True, slots=True, eq=False)
class GroundTruth:
    """The objects around one agent in one frame, as they are.

    Attributes:
        id: (N,) int, unique within the frame and constant over an object's life.
        boxes: N boxes, in the frame in which tracks are reported.
        label: (N,) int, an `ObjectClass`.
        visible_to: (N,) int, numbers into `coopsim.metrics.score.SEEN_BY`; None: unknown.
        velocity: (N, 2) m/s over ground, in the axes of the boxes; None: unknown.
        returns: (N, A) number of LiDAR returns that each of A agents has from each object; None: unknown.
        in_region: (N,) whether the object is in the evaluation region; None: all are.
        counts: (N,) whether the object counts in the score; a track on one that does not neither helps nor harms.
            None: all count.
    """

    id: Ints
    boxes: Boxes3D
    label: Ints
    visible_to: Ints | None = None
    velocity: Floats | None = None
    returns: Ints | None = None
    in_region: Mask | None = None
    counts: Mask | None = None

    def __post_init__(self) -> None:
        count = len(self.boxes)
        known = {name: ((count, *shape), dtype) for name, (shape, dtype) in _KNOWN_TRUTH.items()}
        freeze(self, id=((count,), np.int64), label=((count,), np.int64), **known)

    @classmethod
    def trusted(
        cls,
        ids: Ints,
        boxes: Boxes3D,
        label: Ints,
        visible_to: Ints | None = None,
        velocity: Floats | None = None,
        returns: Ints | None = None,
        in_region: Mask | None = None,
        counts: Mask | None = None,
    ) -> GroundTruth:
        """Make ground truth without a check, of new or read-only arrays that are known to have shape and type."""
        known = zip(_KNOWN_TRUTH, (visible_to, velocity, returns, in_region, counts), strict=True)
        return unchecked(cls, boxes=boxes, id=ids, label=label, **dict(known))

    @classmethod
    def empty(cls) -> GroundTruth:
        """Return no objects."""
        none = np.zeros(0, dtype=np.int64)
        return cls(none, Boxes3D.empty(), none)

    def __len__(self) -> int:
        return len(self.boxes)

    @property
    def counted(self) -> GroundTruth:
        """The objects that count in the score: `id`, `boxes`, `label` and `visible_to` of them."""
        if self.counts is None:
            return self
        visible_to = None if self.visible_to is None else self.visible_to[self.counts]
        return GroundTruth.trusted(self.id[self.counts], self.boxes[self.counts], self.label[self.counts], visible_to)

    def validate(self) -> None:
        """Raise `InvalidValueError` if a box is not finite, a size not positive, or an id not unique."""
        _require_sound(self.boxes, self.id, self.label, "object")


def _require_sound(boxes: Boxes3D, ids: Ints, label: Ints, what: str) -> None:
    """Raise `InvalidValueError` unless the boxes (N,) are valid, the ids (N,) unique, and the labels (N,) classes."""
    if not are_sound(boxes.array, np.ascontiguousarray(ids), np.ascontiguousarray(label), len(CLASS_NAMES)):
        boxes.validate(f"{what}s")
        require_identified(ids, label, what)


_KNOWN_TRUTH: dict[str, tuple[tuple[int | None, ...], Any]] = {
    "visible_to": ((), np.int64),
    "velocity": ((2,), np.float64),
    "returns": ((None,), np.int64),
    "in_region": ((), np.bool_),
    "counts": ((), np.bool_),
}
"""Shape behind the first axis, and type, of the columns of `GroundTruth` that need not be known."""
