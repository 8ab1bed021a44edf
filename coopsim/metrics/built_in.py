"""The metrics that come along, in the order of `docs/reference/metrics.md`; ratios are per cent."""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from operator import attrgetter

import numpy as np

from coopsim.errors import CoopsimError
from coopsim.metrics.average_precision import AP_THRESHOLDS
from coopsim.metrics.clear import Clear, RecallSweep
from coopsim.metrics.deception import DECEPTION
from coopsim.metrics.driving import DRIVING
from coopsim.metrics.finding import FINDING
from coopsim.metrics.log_pool import LogPool
from coopsim.metrics.matching import NEAR_M
from coopsim.metrics.metric import METRICS, Metric, PoolMetric, SweepMetric

BYTES = "bytes_per_s"
"""Name of the metric of what an agent broadcasts."""


@dataclass(frozen=True)
class _SweepMetric(SweepMetric):
    of: Callable[[RecallSweep], float]
    meaning: str

    def of_sweep(self, sweep: RecallSweep) -> float:
        return self.of(sweep)


@dataclass(frozen=True)
class _ClearMetric(SweepMetric):
    """A ratio or count of CLEAR, at the level of recall with the best MOTA."""

    of: Callable[[Clear], float]
    meaning: str
    unit: str = "%"
    less_is_better: bool = False

    def of_sweep(self, sweep: RecallSweep) -> float:
        return self.of(sweep.best)


def _if_any(objects: int, value: float) -> float:
    """Return a value that is undefined, NaN, without objects."""
    return value if objects else math.nan


def _average(name: str, meaning: str) -> _SweepMetric:
    return _SweepMetric(lambda sweep: _if_any(sweep.all_tracks.gt, 100 * getattr(sweep, name)), meaning)


def _ratio(name: str, meaning: str) -> _ClearMetric:
    return _ClearMetric(lambda clear: _if_any(clear.gt, 100 * getattr(clear, name)), meaning)


def _share(name: str, meaning: str, less: bool = False) -> _ClearMetric:
    def share(clear: Clear) -> float:
        return _if_any(clear.gt, 100 * (getattr(clear, name) / max(clear.objects, 1)))

    return _ClearMetric(share, meaning, less_is_better=less)


def _count(name: str, meaning: str, less: bool = False) -> _ClearMetric:
    return _ClearMetric(attrgetter(name), meaning, "", less)


def _whole(name: str, meaning: str) -> PoolMetric:
    of = attrgetter(name)
    return PoolMetric(lambda pool: _if_any(pool.objects, 100 * of(pool)), meaning)


_RECALL_AVERAGES = {
    "sAMOTA": _average(
        "samota",
        "MOTA scaled by what is possible at each of 40 levels of recall, averaged (Weng 2020)",
    ),
    "AMOTA": _average("amota", "MOTA averaged over 40 levels of recall (Weng 2020)"),
    "AMOTP": _average("amotp", "mean 3D IoU of matches, averaged over 40 levels of recall"),
}

_CLEAR = {
    "MOTA": _ratio(
        "mota",
        "1 - (false positives + misses + identity switches) / ground truth, at the best level of recall",
    ),
    "MOTP": _ratio("motp", "mean 3D IoU of matches, at the same level"),
    "sMOTA": _ratio("smota", "MOTA in which a match counts its 3D IoU"),
    "MODA": _ratio("moda", "MOTA without identity switches"),
    "recall": _ratio("recall", "share of objects' boxes with a track, at the best level of recall"),
    "precision": _ratio("precision", "share of reported boxes with an object, at the same level"),
    "MT": _share("mostly_tracked", "objects tracked in > 80 % of their frames"),
    "PT": _share("partly_tracked", "objects tracked in 20-80 % of their frames"),
    "ML": _share("mostly_lost", "objects tracked in < 20 % of their frames", less=True),
    "IDS": _count("ids", "identity switches, at the same level", less=True),
    "FRAG": _count("frag", "interruptions of an object's track, at the same level", less=True),
    "TP": _count("tp", "matched boxes, at the same level"),
    "FP": _count("fp", "false positives, at the same level", less=True),
    "FN": _count("fn", "misses, at the same level", less=True),
    "GT": _count("gt", "objects' boxes"),
    "objects": _count("objects", "objects"),
}

_OVERLAP = {
    "HOTA": _whole("hota.hota", "root of detection times association accuracy, over 19 thresholds of IoU"),
    "DetA": _whole("hota.det_a", "share of boxes that are matched"),
    "AssA": _whole("hota.ass_a", "share of their lives that matched tracks have in common with their objects"),
    "LocA": _whole("hota.loc_a", "mean 3D IoU of matches, over 19 thresholds of IoU"),
    "IDF1": _whole("identity.f1", "F1 of boxes when each object has one right track"),
    "IDP": _whole("identity.precision", "precision of boxes when each object has one right track"),
    "IDR": _whole("identity.recall", "recall of boxes when each object has one right track"),
}

_NEAR = {
    "HOTA": _whole("hota_near.hota", "HOTA with matches by distance on the ground"),
    "DetA": _whole("hota_near.det_a", "DetA with matches by distance on the ground"),
    "AssA": _whole("hota_near.ass_a", "AssA with matches by distance on the ground"),
    "LocA": _whole("hota_near.loc_a", "LocA with matches by distance on the ground"),
    "AMOTA": _whole("near_sweep.amota", "nuScenes' AMOTA: matches are centres less than 2 m apart"),
    "AMOTP": PoolMetric(
        lambda pool: _if_any(pool.objects, pool.near_sweep.amotp),
        "nuScenes' AMOTP: mean distance of matches",
        "m",
        ".2f",
        less_is_better=True,
    ),
}


def _precisions() -> dict[str, Metric]:
    """Average precision of each view and threshold, then the means over classes, then those over superclasses."""
    kinds = [(view, threshold) for view in ("3D", "BEV") for threshold in AP_THRESHOLDS]
    one: dict[str, Metric] = {}
    classes: dict[str, Metric] = {}
    superclasses: dict[str, Metric] = {}
    for view, threshold in kinds:
        where = f"at {view} IoU {threshold:g}"
        kind = view, threshold
        one[f"AP{view}@{threshold:g}"] = PoolMetric(partial(_precision, kind), f"average precision {where}")
        classes[f"mAP{view}@{threshold:g}"] = PoolMetric(
            partial(_mean_precision, kind, "classes"),
            f"mean average precision {where}, over classes",
            whole_only=True,
        )
        superclasses[f"mAP{view}_superclass@{threshold:g}"] = PoolMetric(
            partial(_mean_precision, kind, "superclasses"),
            f"mean average precision {where}, over superclasses (DINO-CoDT, eq. 11)",
            whole_only=True,
        )
    return {**one, **classes, **superclasses}


def _precision(kind: tuple[str, float], pool: LogPool) -> float:
    return _if_any(pool.objects, pool.average_precisions[kind])


def _mean_precision(kind: tuple[str, float], parts: str, pool: LogPool) -> float:
    values = [part.average_precisions[kind] for part in getattr(pool, parts).values()]
    return float(np.mean(values)) if values else math.nan


BUILT_IN: Mapping[str, Metric] = {
    **_RECALL_AVERAGES,
    **_CLEAR,
    **_OVERLAP,
    **{f"{name}@{NEAR_M:g}m": metric for name, metric in _NEAR.items()},
    **_precisions(),
    BYTES: PoolMetric(
        attrgetter("bytes_per_s"),
        "what an agent broadcasts, envelope included",
        "bytes/s",
        ".0f",
        less_is_better=True,
        whole_only=True,
    ),
    **DRIVING,
    **FINDING,
    **DECEPTION,
}

for _name, _metric in BUILT_IN.items():
    METRICS.register(_name)(_metric)


def clear_values(clear: Clear) -> dict[str, float]:
    """Return CLEAR's ratios and counts by name, at one operating point."""
    return {name: metric.of(clear) for name, metric in _CLEAR.items()}


def all_metrics() -> dict[str, Metric]:
    """Return every metric by name: the built-in ones in order, then those that users and packages have registered."""
    return {**BUILT_IN, **custom_metrics()}


def custom_metrics() -> dict[str, Metric]:
    """Return the metrics by name that users and packages have registered, sorted.

    A metric whose package cannot be imported is left out, with one warning that names the package.
    """
    found = {}
    for name in METRICS.names():
        if name in BUILT_IN or name in _left_out:
            continue
        try:
            entry = METRICS.get(name)
        except CoopsimError as error:
            _left_out.add(name)
            warnings.warn(f"metric {name!r} is left out: {error}", stacklevel=2)
            continue
        found[name] = entry() if isinstance(entry, type) else entry
    return found


_left_out: set[str] = set()
"""Names of metrics whose packages could not be imported in this process."""


def recorders_read() -> tuple[str, ...]:
    """Return the names of the recorders that registered metrics read."""
    return tuple(dict.fromkeys(name for metric in all_metrics().values() for name in metric.recorders))


def less_is_better(name: str) -> bool:
    """Return whether smaller values of a metric are better; False for a metric that is not registered."""
    metric = all_metrics().get(name)
    return metric is not None and metric.less_is_better


def is_yes_no(name: str) -> bool:
    """Return whether a metric says yes or no of each episode; False for a metric that is not registered."""
    metric = all_metrics().get(name)
    return metric is not None and metric.yes_no
