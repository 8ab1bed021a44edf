"""The logs that one score is computed from, with the intermediate results that several metrics share."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import cached_property
from types import MappingProxyType
from typing import Any, TypeVar

import numpy as np

from coopsim.metrics.average_precision import AP_THRESHOLDS, average_precision
from coopsim.metrics.clear import NearSweep, RecallSweep, sweep_near, sweep_recall
from coopsim.metrics.hota_idf1 import Hota, Identity, count_hota, count_identity
from coopsim.metrics.matching import NumberedSequence
from coopsim.metrics.track_log import FlatLog, TrackLog
from coopsim.types.taxonomy import CLASS_NAMES, Superclass

T = TypeVar("T")

BANDS_M: Mapping[str, tuple[float, float]] = {"0-30 m": (0, 30), "30-50 m": (30, 50), "50-100 m": (50, 100)}
"""Bands of distance from the reporting agent on the ground; the upper end belongs to the next band."""


class _Records(dict[str, tuple[Any, ...]]):
    """Records by the recorder's name; none of a recorder that kept nothing."""

    def __missing__(self, name: str) -> tuple[Any, ...]:
        return ()


class LogPool:
    """Pool of one agent's logs over any number of sequences. Everything is computed on first use, and kept.

    Args:
        logs: one per sequence, with the pairs of an object and a track of one class.
        superclass_logs: logs with the pairs of one superclass; None: those of `logs`.
        bytes_per_s: bytes that the agent broadcasts per second; None: not known.
        records: further records of the agent by the recorder's name, one per sequence in which it kept any. Of another
            name there are none: `pool.records["drives"]` is empty where no car was driven.
    """

    def __init__(
        self,
        logs: Iterable[FlatLog],
        superclass_logs: Iterable[FlatLog] | None = None,
        bytes_per_s: float | None = None,
        records: Mapping[str, Sequence[Any]] = MappingProxyType({}),
    ) -> None:
        self.logs: Sequence[FlatLog] = tuple(logs)
        self.superclass_logs = self.logs if superclass_logs is None else tuple(superclass_logs)
        self.bytes_per_s = bytes_per_s
        self.records: Mapping[str, Sequence[Any]] = _Records({name: tuple(each) for name, each in records.items()})
        self._shared: dict[Callable[[LogPool], Any], Any] = {}

    @classmethod
    def of(
        cls,
        logs: Iterable[TrackLog],
        bytes_per_s: float | None = None,
        records: Mapping[str, Sequence[Any]] = MappingProxyType({}),
    ) -> LogPool:
        """Pool the logs of evaluators, and further records."""
        pools = [log.flat() for log in logs]
        return cls([pool.by_class() for pool in pools], pools, bytes_per_s, records)

    def shared(self, compute: Callable[[LogPool], T]) -> T:
        """Return what a function computes from this pool, once for all the metrics that ask for it."""
        if compute not in self._shared:
            self._shared[compute] = compute(self)
        found: T = self._shared[compute]
        return found

    @cached_property
    def objects(self) -> int:
        """Number of ground-truth boxes, over all frames."""
        return sum(len(log.truth_id) for log in self.logs)

    @cached_property
    def reported(self) -> int:
        """Number of reported boxes, over all frames."""
        return sum(len(log.track_id) for log in self.logs)

    @cached_property
    def matchable(self) -> list[NumberedSequence]:
        """The sequences with the pairs whose 3D IoU reaches `match_iou`."""
        return [log.numbered(log.iou_3d, log.match_iou) for log in self.logs]

    @cached_property
    def sweep(self) -> RecallSweep:
        """CLEAR at every level of recall."""
        return sweep_recall(self.matchable)

    @cached_property
    def identity(self) -> Identity:
        """Identity counts of pairs that `match_iou` allows."""
        return count_identity(self.matchable)

    @cached_property
    def hota(self) -> Hota:
        """HOTA's counts by 3D IoU."""
        return count_hota([log.numbered(log.iou_3d) for log in self.logs])

    @cached_property
    def hota_near(self) -> Hota:
        """HOTA's counts by distance on the ground."""
        return count_hota(self._near)

    @cached_property
    def near_sweep(self) -> NearSweep:
        """Averages over recall in the manner of nuScenes, by distance on the ground."""
        return sweep_near(self._near)

    @cached_property
    def average_precisions(self) -> dict[tuple[str, float], float]:
        """Average precision in per cent, by view ("3D" or "BEV") and threshold of IoU."""
        overlaps = {"3D": [log.iou_3d for log in self.logs], "BEV": [log.iou_bev for log in self.logs]}
        return {
            (view, threshold): 100
            * average_precision(
                [(log.numbered(iou, threshold), log.score) for log, iou in zip(self.logs, overlap, strict=True)]
            )
            for view, overlap in overlaps.items()
            for threshold in AP_THRESHOLDS
        }

    @cached_property
    def classes(self) -> dict[str, LogPool]:
        """The part of each class of which there was an object, by the class's name."""
        labels = sorted(self._labels)
        if len(labels) == 1 and self._reported_labels <= self._labels:
            return {CLASS_NAMES[labels[0]]: self}
        return {CLASS_NAMES[label]: LogPool(log.only(label) for log in self.logs) for label in labels}

    @cached_property
    def superclasses(self) -> dict[str, LogPool]:
        """The part of each superclass of which there was an object; its tracks may be of any of its classes."""
        parts = {}
        for superclass in Superclass:
            members = {int(each) for each in superclass.classes}
            present = self._labels & members
            if len(present) == 1 and self._reported_labels & members <= present:
                parts[superclass.title] = self.classes[CLASS_NAMES[min(present)]]
            elif present:
                parts[superclass.title] = LogPool(log.only(*members) for log in self.superclass_logs)
        return parts

    @cached_property
    def bands(self) -> dict[str, LogPool]:
        """The part of each band of distance in which there was an object."""
        parts = {name: LogPool(log.within(*band) for log in self.logs) for name, band in BANDS_M.items()}
        return {name: part for name, part in parts.items() if part.objects}

    @cached_property
    def _near(self) -> list[NumberedSequence]:
        return [log.numbered(log.nearness) for log in self.logs]

    @cached_property
    def _labels(self) -> set[int]:
        return {int(label) for log in self.logs for label in log.labels}

    @cached_property
    def _reported_labels(self) -> set[int]:
        return {int(label) for log in self.logs for label in np.unique(log.track_label)}
