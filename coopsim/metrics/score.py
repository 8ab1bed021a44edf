"""The score that users read: values by name, for everything, each class, each band of distance, and each agent."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Literal

import numpy as np
from tabulate import tabulate

from coopsim.errors import InvalidValueError, UnknownNameError
from coopsim.metrics.recall_averages import RecallSweep, sweep_recall
from coopsim.metrics.recall_by_visibility import GroupRecall, pooled, recall_by_visibility
from coopsim.metrics.track_log import FlatLog, TrackLog
from coopsim.metrics.values import AP_NAMES, average_values, clear_values, uncut_values
from coopsim.support.checks import require_choice
from coopsim.types.taxonomy import CLASS_NAMES, Superclass

FalsePositives = Literal["count", "ignore"]

BANDS_M: Mapping[str, tuple[float, float]] = {"0-30 m": (0, 30), "30-50 m": (30, 50), "50-100 m": (50, 100)}
"""Bands of distance from the reporting agent on the ground; the upper end belongs to the next."""

_TABLE = ("sAMOTA", "AMOTA", "AMOTP", "MOTA", "MOTP", "HOTA", "IDF1", "MT", "ML", "IDS", "FRAG", "FP", "FN", "GT")


@dataclass(frozen=True, slots=True, eq=False)
class Score:
    """Values by metric name; `score["MOTA"]` reads one.

    Ratios are per cent: sAMOTA, AMOTA and AMOTP over 40 levels of recall; MOTA, MOTP, sMOTA, MODA, recall, precision,
    MT, PT and ML at the level with the best MOTA, as AB3DMOT's tables give them. The counts beside them (TP, FP, FN,
    GT, IDS, FRAG, objects) are those they were made from, at the same level. `all_tracks` has the same names without
    any cut by score: plain CLEAR. All others (HOTA, IDF1, AP3D@0.5, AMOTA@2m, ...) are of everything that was reported
    and always count false positives; `docs/reference/metrics.md` has each name.

    Attributes:
        values: by metric name.
        all_tracks: plain CLEAR of everything that was reported.
        false_positives: whether CLEAR and AB3DMOT's averages count or ignore them.
        classes: the same by class name, for classes of which there was an object.
        bands: the same by distance from the reporting agent, as "0-30 m", where there was an object.
        agents: the same by agent, where this is a mean over agents.
        sweep: CLEAR at every level of recall; None for a mean over agents.
        superclasses: the same by superclass ("Vehicle", "Pedestrian", "Truck"), where there was an object; in it, a
            track may be on an object of another class.
        visibility: recall by who saw an object, as "others only", pooled over agents; empty where that is not known.
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
        """The mean over agents of every value; of a class or band, over the agents that met it."""
        parts = list(agents.values())
        classes, superclasses, bands = (
            _means([getattr(part, each) for part in parts]) for each in ("classes", "superclasses", "bands")
        )
        mean = _mean_of(parts)
        visibility = pooled(part.visibility for part in parts)
        mean = replace(mean, classes=classes, superclasses=superclasses, bands=bands, visibility=visibility)
        return replace(mean, agents=dict(agents))

    def ignoring_false_positives(self) -> Score:
        """The same with false positives ignored, which needs no new matching; values that always count them stay.

        Raises:
            InvalidValueError: it is the mean of a class or band, which keeps no levels of recall; ask the whole.
        """
        if self.agents:
            return Score.mean({name: score.ignoring_false_positives() for name, score in self.agents.items()})
        if self.sweep is None:
            raise InvalidValueError("the mean of a class or band keeps no levels of recall: ask the whole score")
        sweep = self.sweep.without_false_positives()
        return Score(
            {**self.values, **average_values(sweep), **clear_values(sweep.best)},
            clear_values(sweep.all_tracks),
            "ignore",
            {name: score.ignoring_false_positives() for name, score in self.classes.items()},
            {name: score.ignoring_false_positives() for name, score in self.bands.items()},
            sweep=sweep,
            superclasses={name: score.ignoring_false_positives() for name, score in self.superclasses.items()},
            visibility=self.visibility,
        )

    def table(self) -> str:
        """Aligned plain text: the whole, then each class, superclass of several classes, band and agent."""
        # A superclass of which there was one class is that class again.
        pooled = {
            name: score
            for name, score in self.superclasses.items()
            if sum(cls.title in self.classes for cls in Superclass(name).classes) > 1
        }
        parts = (self.classes, pooled, self.bands, self.agents)
        lines: list[tuple[str, Score]] = [("all", self), *(line for part in parts for line in part.items())]
        rows = [[name, *(f"{score[metric]:.1f}" for metric in _TABLE)] for name, score in lines]
        text = tabulate(rows, headers=["", *_TABLE], disable_numparse=True, colalign=["left", *["right"] * len(_TABLE)])
        ignored = "" if self.false_positives == "count" else "\nfalse positives are ignored"
        return text + ignored

    def to_dict(self) -> dict[str, Any]:
        """Ready for JSON: the values, and below them `all_tracks` and the parts by class, agent, ... that there are."""
        parts: dict[str, Any] = {**self.values, "all_tracks": dict(self.all_tracks)}
        for name in ("classes", "superclasses", "bands", "agents"):
            children: Mapping[str, Score] = getattr(self, name)
            if children:
                parts[name] = {child: score.to_dict() for child, score in children.items()}
        if self.visibility:
            parts["visibility"] = {name: group.as_dict() for name, group in self.visibility.items()}
        return parts


def summarize(
    logs: Sequence[TrackLog],
    *,
    false_positives: FalsePositives = "count",
    extra: Mapping[str, float] | None = None,
) -> Score:
    """The score of one agent over any number of sequences, pooled.

    Args:
        logs: one per sequence.
        false_positives: "count", or "ignore": an unmatched track costs nothing. Published V2V4Real tables
            ignore them, because their script drops unmatched boxes that are low in an image which does not exist.
        extra: further values to carry along, such as bytes per second.

    Raises:
        UnknownNameError: `false_positives` is neither.
    """
    require_choice("false_positives", false_positives, ("count", "ignore"))
    pools = [log.flat() for log in logs]
    flats = [pool.by_class() for pool in pools]
    labels = sorted({int(label) for flat in flats for label in flat.labels})
    classes = {CLASS_NAMES[label]: _score([flat.only(label) for flat in flats]) for label in labels}
    reported = {int(label) for flat in flats for label in np.unique(flat.track_label)}

    def score_of(parts: Sequence[FlatLog], wanted: Sequence[int]) -> Score:
        # With a single class that nothing else was reported as, the pool is that class: no second sweep.
        present = set(labels).intersection(wanted)
        if len(present) == 1 and reported.intersection(wanted) <= present:
            return classes[CLASS_NAMES[present.pop()]]
        return _score(parts)

    whole = score_of(flats, range(len(CLASS_NAMES)))
    superclasses = {
        each.title: score_of([pool.only(*each.classes) for pool in pools], each.classes)
        for each in Superclass
        if set(labels).intersection(each.classes)
    }
    bands = {name: _score([flat.within(*band) for flat in flats]) for name, band in BANDS_M.items()}
    score = replace(
        whole,
        values={**whole.values, **_mean_precisions(classes), **(extra or {})},
        classes=classes,
        superclasses=superclasses,
        bands={name: band for name, band in bands.items() if band["GT"]},
        visibility=recall_by_visibility(flats),
    )
    return score if false_positives == "count" else score.ignoring_false_positives()


def _score(flats: Sequence[FlatLog]) -> Score:
    sequences = [flat.numbered(flat.iou_3d, flat.match_iou) for flat in flats]
    sweep = sweep_recall(sequences)
    values = average_values(sweep) | clear_values(sweep.best) | uncut_values(flats, sequences)
    return Score(values, clear_values(sweep.all_tracks), "count", sweep=sweep)


def _mean_precisions(classes: Mapping[str, Score]) -> dict[str, float]:
    """Mean over classes of each average precision."""
    return {f"m{name}": _mean([score[name] for score in classes.values()]) for name in AP_NAMES}


def _means(parts: Sequence[Mapping[str, Score]]) -> dict[str, Score]:
    """The mean of each name's scores, over the parts that have it."""
    names = dict.fromkeys(name for part in parts for name in part)
    return {name: _mean_of([part[name] for part in parts if name in part]) for name in names}


def _mean_of(parts: Sequence[Score]) -> Score:
    values = {name: _mean([part.values[name] for part in parts]) for name in parts[0].values}
    all_tracks = {name: _mean([part.all_tracks[name] for part in parts]) for name in parts[0].all_tracks}
    return Score(values, all_tracks, parts[0].false_positives)


def _mean(values: Sequence[float]) -> float:
    return float(np.mean(values)) if values else 0.0
