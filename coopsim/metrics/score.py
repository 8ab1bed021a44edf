"""The score that users read: values by name for the whole, each class, superclass and band of distance, each agent."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from types import MappingProxyType
from typing import Any, Literal

import numpy as np
from tabulate import tabulate

from coopsim.errors import InvalidValueError, UnknownNameError
from coopsim.metrics.built_in import BUILT_IN, all_metrics, clear_values, custom_metrics
from coopsim.metrics.clear import RecallSweep
from coopsim.metrics.driving import DRIVING_SHOWN
from coopsim.metrics.log_pool import LogPool
from coopsim.metrics.metric import PRIMARY_METRIC, SweepMetric
from coopsim.metrics.track_log import FlatLog, TrackLog
from coopsim.support.checks import require_choice
from coopsim.types.taxonomy import Superclass

FalsePositives = Literal["count", "ignore"]

_TABLE = (PRIMARY_METRIC, "AMOTA", "AMOTP", "MOTA", "MOTP", "HOTA", "IDF1", "MT", "ML", "IDS", "FRAG", "FP", "FN", "GT")
_PARTS = ("classes", "superclasses", "bands")


@dataclass(frozen=True, slots=True, eq=False)
class Score:
    """Values by metric name; `score["MOTA"]` reads one.

    Ratios are per cent: sAMOTA, AMOTA and AMOTP over 40 levels of recall; MOTA, MOTP, sMOTA, MODA, recall, precision,
    MT, PT and ML at the level with the best MOTA, as in AB3DMOT's tables. The counts TP, FP, FN, GT, IDS, FRAG and
    objects belong to the same level. `all_tracks` has the same names without any cut by score: plain CLEAR. All other
    metrics (HOTA, IDF1, AP3D@0.5, AMOTA@2m, ...) are of everything that was reported and always count false positives;
    `docs/reference/metrics.md` explains each name. Registered metrics (`coopsim.metrics.metric.METRICS`) are among the
    values. Without any object every value but counts and rates is undefined: NaN.

    Attributes:
        values: values by metric name.
        all_tracks: plain CLEAR of everything that was reported.
        false_positives: "count" or "ignore", for CLEAR and AB3DMOT's averages.
        classes: the score of each class of which there was an object, by name.
        bands: the score of each band of distance from the reporting agent with an object in it, as "0-30 m".
        agents: the score of each agent, where this is a mean over agents.
        sweep: CLEAR at every level of recall; None for a mean over agents.
        superclasses: the score of each superclass ("Vehicle", "Pedestrian", "Truck") of which there was an object; in
            it, a track may be on an object of another class of the superclass.
        visibility: recall by which agents saw an object ("others only", ...), pooled; empty where that is not known.
    """

    values: Mapping[str, float]
    all_tracks: Mapping[str, float]
    false_positives: FalsePositives
    classes: Mapping[str, Score] = field(default_factory=dict)
    bands: Mapping[str, Score] = field(default_factory=dict)
    agents: Mapping[str, Score] = field(default_factory=dict)
    sweep: RecallSweep | None = None
    superclasses: Mapping[str, Score] = field(default_factory=dict)
    visibility: Mapping[str, GroupRecall] = field(default_factory=dict)

    def __getitem__(self, name: str) -> float:
        if name not in self.values:
            raise UnknownNameError("metric", name, self.values)
        return self.values[name]

    @classmethod
    def mean(cls, agents: Mapping[str, Score]) -> Score:
        """Average every value over the agents for which it is defined, so not over those that had no object near them.

        A class's, superclass's or band's is averaged over the agents that met it; counts are over all agents.
        """
        scores = list(agents.values())
        parts: dict[str, Any] = {name: _means([getattr(score, name) for score in scores]) for name in _PARTS}
        visibility = pooled(score.visibility for score in scores)
        return replace(_mean_of(scores), **parts, agents=dict(agents), visibility=visibility)

    def ignoring_false_positives(self) -> Score:
        """Return the score with false positives ignored, without a new matching; values that count them stay.

        Raises:
            InvalidValueError: it is the mean of a class or band, which keeps no levels of recall; ask the whole.
        """
        if self.agents:
            return Score.mean({name: score.ignoring_false_positives() for name, score in self.agents.items()})
        if self.sweep is None:
            raise InvalidValueError("the mean of a class or band keeps no levels of recall: ask the whole score")
        sweep = self.sweep.without_false_positives()
        changed = {
            name: metric.of_sweep(sweep) for name, metric in all_metrics().items() if isinstance(metric, SweepMetric)
        }
        return replace(
            self,
            values={name: changed.get(name, value) for name, value in self.values.items()},
            all_tracks=clear_values(sweep.all_tracks),
            false_positives="ignore",
            sweep=sweep,
            **{
                name: {child: score.ignoring_false_positives() for child, score in getattr(self, name).items()}
                for name in _PARTS
            },
        )

    def table(self) -> str:
        """Format aligned plain text: the whole, then each class, superclass of several classes, band and agent."""
        # A superclass of which there was one class is that class again.
        pools = {
            name: score
            for name, score in self.superclasses.items()
            if sum(cls.title in self.classes for cls in Superclass(name).classes) > 1
        }
        lines = [("all", self)]
        for part in (self.classes, pools, self.bands, self.agents):
            lines += part.items()
        added = {**{name: BUILT_IN[name] for name in DRIVING_SHOWN}, **custom_metrics()}
        forms = dict.fromkeys(_TABLE, ".1f") | {name: metric.form for name, metric in added.items()}
        forms = {name: form for name, form in forms.items() if name in self.values}
        rows = [
            [
                title,
                *(
                    "-" if math.isnan(value := score.values.get(name, math.nan)) else format(value, form)
                    for name, form in forms.items()
                ),
            ]
            for title, score in lines
        ]
        text = tabulate(rows, ["", *forms], disable_numparse=True, colalign=["left", *["right"] * len(forms)])
        ignored = "" if self.false_positives == "count" else "\nfalse positives are ignored"
        return text + ignored

    def to_dict(self) -> dict[str, Any]:
        """Return plain data for JSON: values, `all_tracks`, and the parts by class, band, agent, ... that there are.

        An undefined value is None.
        """
        content: dict[str, Any] = {**without_nan(self.values), "all_tracks": without_nan(self.all_tracks)}
        for name in (*_PARTS, "agents"):
            children: Mapping[str, Score] = getattr(self, name)
            if children:
                content[name] = {child: score.to_dict() for child, score in children.items()}
        if self.visibility:
            content["visibility"] = {name: group.as_dict() for name, group in self.visibility.items()}
        return content


def summarize(
    logs: Sequence[TrackLog],
    *,
    false_positives: FalsePositives = "count",
    bytes_per_s: float | None = None,
    records: Mapping[str, Sequence[Any]] = MappingProxyType({}),
) -> Score:
    """Score one agent over any number of sequences, pooled, by every registered metric.

    Args:
        logs: one per sequence.
        false_positives: "count", or "ignore": an unmatched track costs nothing. Published V2V4Real tables
            ignore them, because their script drops unmatched boxes that are low in an image which does not exist.
        bytes_per_s: broadcast by the agent per second; None: the score has no such value.
        records: further records of the agent by the recorder's name, one per sequence in which it kept any: "drives",
            "trust", "deceptions", and others that metrics read. Without them the score lacks those metrics.

    Raises:
        UnknownNameError: `false_positives` is neither "count" nor "ignore".
    """
    require_choice("false_positives", false_positives, ("count", "ignore"))
    pool = LogPool.of(logs, bytes_per_s, records)
    parts: dict[str, Any] = {
        name: {child: _score(part) for child, part in getattr(pool, name).items()} for name in _PARTS
    }
    score = replace(_score(pool, whole=True), **parts, visibility=recall_by_visibility(pool.logs))
    return score if false_positives == "count" else score.ignoring_false_positives()


def _score(pool: LogPool, whole: bool = False) -> Score:
    values = {name: metric.value(pool) for name, metric in all_metrics().items() if whole or not metric.whole_only}
    known = {
        name: value if isinstance(value, int) else float(value) for name, value in values.items() if value is not None
    }
    return Score(known, clear_values(pool.sweep.all_tracks), "count", sweep=pool.sweep)


def _means(parts: Sequence[Mapping[str, Score]]) -> dict[str, Score]:
    """Average each name's scores over the parts that have it."""
    names = dict.fromkeys(name for part in parts for name in part)
    return {name: _mean_of([part[name] for part in parts if name in part]) for name in names}


def _mean_of(scores: Sequence[Score]) -> Score:
    values, all_tracks = ([getattr(score, name) for score in scores] for name in ("values", "all_tracks"))
    return Score(_mean_values(values), _mean_values(all_tracks), scores[0].false_positives)


def _mean_values(parts: Sequence[Mapping[str, float]]) -> dict[str, float]:
    """Average each name's values over the parts that have it; NaN where it is NaN in all of them."""
    known: dict[str, list[float]] = {name: [] for part in parts for name in part}
    for part in parts:
        for name, value in part.items():
            if not math.isnan(value):
                known[name].append(value)
    return {name: float(np.mean(values)) if values else math.nan for name, values in known.items()}


def without_nan(values: Mapping[str, float]) -> dict[str, float | None]:
    """Return values with None for NaN, which JSON does not have."""
    return {name: None if math.isnan(value) else value for name, value in values.items()}


SEEN_BY = ("me", "others only", "nobody")
"""Which agents got LiDAR returns from an object in a frame; `GroundTruth.visible_to` holds indices into it."""

UNKNOWN = -1
"""Stands where it is not known which agents saw an object, as in a replay."""


@dataclass(frozen=True, slots=True)
class GroupRecall:
    """Recall of the objects' boxes that the same agents saw.

    Attributes:
        tp: boxes with a matched track, whatever its score.
        gt: boxes.
        all_gt: boxes of all groups together.
    """

    tp: int
    gt: int
    all_gt: int

    @property
    def recall(self) -> float:
        """Per cent of the group's boxes with a matched track; NaN without boxes."""
        return 100 * self.tp / self.gt if self.gt else float("nan")

    @property
    def share(self) -> float:
        """Per cent of all boxes that are in the group; NaN without boxes."""
        return 100 * self.gt / self.all_gt if self.all_gt else float("nan")

    @property
    def gain(self) -> float:
        """Percentage points that the group adds to the recall of all boxes: share times recall."""
        return 100 * self.tp / self.all_gt if self.all_gt else float("nan")

    def as_dict(self) -> dict[str, float]:
        """Return the values by name, without those that are NaN."""
        values = {"share": self.share, "recall": self.recall, "gain": self.gain, "TP": self.tp, "GT": self.gt}
        return {name: value for name, value in values.items() if not np.isnan(value)}


def recall_by_visibility(logs: Sequence[FlatLog]) -> dict[str, GroupRecall]:
    """Compute the recall of each group in `SEEN_BY`; empty where it is not known which agents saw what.

    Args:
        logs: with the pairs of one class. Tracks are matched once, to all objects together.
    """
    tp, gt = np.zeros(len(SEEN_BY), dtype=np.int64), np.zeros(len(SEEN_BY), dtype=np.int64)
    for log in logs:
        hit = log.matches.track_of >= 0
        known = log.truth_seen_by != UNKNOWN
        gt += np.bincount(log.truth_seen_by[known], minlength=len(SEEN_BY))
        tp += np.bincount(log.truth_seen_by[known & hit], minlength=len(SEEN_BY))
    if not gt.any():
        return {}
    return {name: GroupRecall(int(tp[k]), int(gt[k]), int(gt.sum())) for k, name in enumerate(SEEN_BY)}


def pooled(parts: Iterable[Mapping[str, GroupRecall]]) -> dict[str, GroupRecall]:
    """Add up the groups of several agents."""
    known = [part for part in parts if part]
    return {
        name: GroupRecall(*(sum(getattr(part[name], count) for part in known) for count in ("tp", "gt", "all_gt")))
        for name in (SEEN_BY if known else ())
    }
