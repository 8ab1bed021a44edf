"""Flat arrays of the receivers' detections in one episode and of the objects there, which any protocol can evaluate."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from coopsim.geometry.boxes import in_region
from coopsim.geometry.se3 import Floats
from coopsim.metrics.score import UNKNOWN
from coopsim.types import Detections, GroundTruth, Ints, Mask

_PLAIN = ("region_m", "frames", "messages", "sent_bytes", "ms")
_ABOUT = "about"


@dataclass(frozen=True, slots=True, eq=False)
class Perceived:
    """N detections and M objects in R frames, one frame of one receiver after another.

    Boxes are x, y, z, l, w, h, yaw (m, rad) in the true base frame of the frame's receiver.

    Attributes:
        found_start: (R + 1,) frame r has the detections found_start[r] to found_start[r + 1] - 1.
        found_box: (N, 7).
        found_score: (N,).
        found_label: (N,) `ObjectClass`.
        true_start: (R + 1,) the same of objects.
        true_box: (M, 7).
        true_label: (M,).
        true_counts: (M,) whether the object counts: in the region, and seen by some agent.
        true_seen_by: (M,) numbers into `coopsim.metrics.score.SEEN_BY`, or `UNKNOWN`.
        true_returns: (M, 2) LiDAR returns of all agents together, and of the agent with most; `UNKNOWN` in a recording
            without sweeps.
        region_m: half length and width of the evaluation region; infinite: no limit.
        frames: frames of the environment, each with several receivers.
        messages: broadcasts in the episode, each counted once.
        sent_bytes: their size, envelopes included.
        ms: milliseconds a frame of the environment, all agents together, by part.
    """

    found_start: Ints
    found_box: Floats
    found_score: Floats
    found_label: Ints
    true_start: Ints
    true_box: Floats
    true_label: Ints
    true_counts: Mask
    true_seen_by: Ints
    true_returns: Ints
    region_m: tuple[float, float] = (np.inf, np.inf)
    frames: int = 0
    messages: int = 0
    sent_bytes: int = 0
    ms: Mapping[str, float] = field(default_factory=dict)

    @classmethod
    def of(
        cls,
        found: Sequence[Detections],
        truth: Sequence[GroundTruth],
        region_m: tuple[float, float] | None = None,
        *,
        frames: int | None = None,
        messages: int = 0,
        sent_bytes: int = 0,
        ms: Mapping[str, float] | None = None,
    ) -> Perceived:
        """Join frames: per frame of a receiver its detections, and the truth around it."""
        return cls(
            _starts([len(each) for each in found]),
            _joined([each.boxes.array for each in found], (0, 7), np.float64),
            _joined([each.score for each in found], (0,), np.float64),
            _joined([each.label for each in found], (0,), np.int64),
            _starts([len(each) for each in truth]),
            _joined([each.boxes.array for each in truth], (0, 7), np.float64),
            _joined([each.label for each in truth], (0,), np.int64),
            _joined([_or_all(each.counts, len(each), True) for each in truth], (0,), np.bool_),
            _joined([_or_all(each.visible_to, len(each), UNKNOWN) for each in truth], (0,), np.int64),
            _joined([_sum_and_most(each) for each in truth], (0, 2), np.int64),
            (np.inf, np.inf) if region_m is None else region_m,
            len(found) if frames is None else frames,
            messages,
            sent_bytes,
            {} if ms is None else dict(ms),
        )

    @classmethod
    def from_arrays(cls, arrays: Mapping[str, NDArray[Any]]) -> Perceived:
        """Return the episode of `arrays`."""
        about = json.loads(arrays[_ABOUT].tobytes())
        columns: dict[str, Any] = {each.name: arrays[each.name] for each in fields(cls) if each.name not in _PLAIN}
        return cls(**columns, **about | {"region_m": tuple(about["region_m"])})

    def arrays(self) -> dict[str, NDArray[Any]]:
        """Return the episode as arrays by name, as a store keeps it."""
        columns: dict[str, Any] = {each.name: getattr(self, each.name) for each in fields(self)}
        about = json.dumps({name: columns.pop(name) for name in _PLAIN})
        return {**columns, _ABOUT: np.frombuffer(about.encode(), np.uint8)}

    @property
    def receiver_frames(self) -> int:
        """R, the number of frames of receivers."""
        return len(self.found_start) - 1

    @property
    def found_in_region(self) -> Mask:
        """Mask (N,) of the detections whose centre is in the region, as the truth's must be."""
        return in_region(self.found_box, self.region_m)

    def within(self, far_m: float) -> Perceived:
        """Return the part within a distance of the receiver, by centres over ground.

        Objects farther away do not count, and detections there are left out.
        """
        kept = np.hypot(self.found_box[:, 0], self.found_box[:, 1]) <= far_m
        near = np.hypot(self.true_box[:, 0], self.true_box[:, 1]) <= far_m
        return replace(
            self,
            found_start=np.append(0, np.cumsum(kept))[self.found_start],
            found_box=self.found_box[kept],
            found_score=self.found_score[kept],
            found_label=self.found_label[kept],
            true_counts=self.true_counts & near,
        )


def _starts(counts: Sequence[int]) -> Ints:
    return np.concatenate([[0], np.cumsum(counts, dtype=np.int64)]).astype(np.int64)


def _joined(parts: Sequence[NDArray[Any]], empty: tuple[int, ...], dtype: type) -> NDArray[Any]:
    return np.concatenate([np.zeros(empty, dtype), *parts]).astype(dtype, copy=False)


def _or_all(column: NDArray[Any] | None, count: int, value: int | bool) -> NDArray[Any]:
    return np.full(count, value) if column is None else column


def _sum_and_most(truth: GroundTruth) -> Ints:
    """Return the returns (N, 2) of all agents together, and of the agent with most."""
    if truth.returns is None or not truth.returns.shape[1]:
        return np.full((len(truth), 2), UNKNOWN, np.int64)
    return np.stack([truth.returns.sum(axis=1), truth.returns.max(axis=1)], axis=1)
