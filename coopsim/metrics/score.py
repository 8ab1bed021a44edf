"""The score that users read: values by name, for all classes together, each class, and each agent."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np
from tabulate import tabulate

from coopsim.checks import require_choice
from coopsim.errors import UnknownNameError
from coopsim.metrics.ab3dmot import RecallSweep, sweep_recall
from coopsim.metrics.clear import Clear, NumberedSequence
from coopsim.metrics.log import FlatLog, TrackLog
from coopsim.taxonomy import CLASS_NAMES

FalsePositives = Literal["count", "ignore"]

_TABLE = ("sAMOTA", "AMOTA", "AMOTP", "MOTA", "MOTP", "MT", "ML", "IDS", "FRAG", "FP", "FN", "GT")


@dataclass(frozen=True, slots=True, eq=False)
class Score:
    """Values by metric name; `score["MOTA"]` reads one.

    Ratios are per cent: sAMOTA, AMOTA and AMOTP over 40 levels of recall; MOTA, MOTP, recall, precision, MT and
    ML at the level with the best MOTA, as AB3DMOT's tables give them. The counts beside them (TP, FP, FN, GT, IDS,
    FRAG, objects) are those they were made from, at the same level. `all_tracks` has the same names without any cut
    by score: plain CLEAR.

    Attributes:
        values: by metric name.
        all_tracks: plain CLEAR of everything that was reported.
        false_positives: whether they are counted or ignored.
        classes: the same by class name.
        agents: the same by agent, where this is a mean over agents.
        sweep: CLEAR at every level of recall; None for a mean over agents.
    """

    values: Mapping[str, float]
    all_tracks: Mapping[str, float]
    false_positives: FalsePositives
    classes: Mapping[str, Score] = field(default_factory=dict)
    agents: Mapping[str, Score] = field(default_factory=dict)
    sweep: RecallSweep | None = None

    def __getitem__(self, name: str) -> float:
        if name not in self.values:
            raise UnknownNameError("metric", name, self.values)
        return self.values[name]

    @classmethod
    def mean(cls, agents: Mapping[str, Score]) -> Score:
        """The mean over agents of every value; of a class, over the agents that met it."""
        parts = list(agents.values())
        names = dict.fromkeys(name for part in parts for name in part.classes)
        classes = {name: _mean_of([part.classes[name] for part in parts if name in part.classes]) for name in names}
        mean = _mean_of(parts)
        return cls(mean.values, mean.all_tracks, mean.false_positives, classes, dict(agents))

    def table(self) -> str:
        """Aligned plain text: the whole, then each class, then each agent."""
        lines: list[tuple[str, Score]] = [("all", self), *self.classes.items(), *self.agents.items()]
        rows = [[name, *(f"{score[metric]:.1f}" for metric in _TABLE)] for name, score in lines]
        text = tabulate(rows, headers=["", *_TABLE], disable_numparse=True, colalign=["left", *["right"] * 12])
        ignored = "" if self.false_positives == "count" else "\nfalse positives are ignored"
        return text + ignored

    def to_dict(self) -> dict[str, Any]:
        """Ready for JSON: the values, and below them `all_tracks`, `classes` and `agents`."""
        parts: dict[str, Any] = {**self.values, "all_tracks": dict(self.all_tracks)}
        for name, children in (("classes", self.classes), ("agents", self.agents)):
            if children:
                parts[name] = {child: score.to_dict() for child, score in children.items()}
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
    flats = [log.flat() for log in logs]
    labels = sorted({int(label) for flat in flats for label in flat.labels})
    classes = {CLASS_NAMES[label]: _score([flat.only(label) for flat in flats], false_positives) for label in labels}
    # With a single class that nothing else was reported as, the whole is that class: no second sweep.
    reported = {int(label) for flat in flats for label in np.unique(flat.track_label)}
    whole = classes[CLASS_NAMES[labels[0]]] if len(labels) == 1 and reported <= set(labels) else None
    whole = whole or _score(flats, false_positives)
    values = {**whole.values, **(extra or {})}
    return Score(values, whole.all_tracks, false_positives, classes, sweep=whole.sweep)


def _score(flats: Sequence[FlatLog], false_positives: FalsePositives) -> Score:
    sequences = [NumberedSequence(*flat.numbered()) for flat in flats]
    sweep = sweep_recall(sequences, ignore_false_positives=false_positives == "ignore")
    averages = {"sAMOTA": sweep.samota, "AMOTA": sweep.amota, "AMOTP": sweep.amotp}
    values = {name: 100 * value for name, value in averages.items()} | _clear_values(sweep.best)
    return Score(values, _clear_values(sweep.all_tracks), false_positives, sweep=sweep)


def _clear_values(clear: Clear) -> dict[str, float]:
    objects = max(clear.objects, 1)
    return {
        "MOTA": 100 * clear.mota,
        "MOTP": 100 * clear.motp,
        "recall": 100 * clear.recall,
        "precision": 100 * clear.precision,
        "MT": 100 * clear.mostly_tracked / objects,
        "ML": 100 * clear.mostly_lost / objects,
        "IDS": clear.ids,
        "FRAG": clear.frag,
        "TP": clear.tp,
        "FP": clear.fp,
        "FN": clear.fn,
        "GT": clear.gt,
        "objects": clear.objects,
    }


def _mean_of(parts: Sequence[Score]) -> Score:
    def mean(pick: str) -> dict[str, float]:
        return {name: float(np.mean([getattr(part, pick)[name] for part in parts])) for name in getattr(parts[0], pick)}

    return Score(mean("values"), mean("all_tracks"), parts[0].false_positives)
