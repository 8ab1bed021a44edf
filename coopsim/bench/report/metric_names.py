"""What metrics mean, and in which less is better; `docs/reference/metrics.md` has all of them."""

from __future__ import annotations

from collections.abc import Mapping

BYTES, BYTES_SHOWN = "bytes_per_s", "bytes/s"
"""One metric, as results and as tables name it."""

METRICS: Mapping[str, str] = {
    "sAMOTA": "MOTA scaled by what is possible at each of 40 levels of recall, averaged (Weng 2020)",
    "AMOTA": "MOTA averaged over 40 levels of recall (Weng 2020)",
    "AMOTP": "mean 3D IoU of matches, averaged over 40 levels of recall",
    "MOTA": "1 - (false positives + misses + identity switches) / ground truth, at the best level of recall",
    "MOTP": "mean 3D IoU of matches, at the same level",
    "HOTA": "root of detection times association accuracy, over 19 thresholds of IoU",
    "DetA": "share of boxes that are matched",
    "AssA": "share of their lives that matched tracks have in common with their objects",
    "IDF1": "F1 of boxes when each object has one right track",
    "recall": "share of objects' boxes with a track, at the best level of recall",
    "precision": "share of reported boxes with an object, at the same level",
    "IDS": "identity switches, at the same level",
    "FP": "false positives, at the same level",
    "FN": "misses, at the same level",
    "mAP3D@0.5": "mean average precision at 3D IoU 0.5",
    BYTES: "what an agent broadcasts per second, envelope included",
}
"""Metrics that reports show, and what each means."""

LESS_IS_BETTER = frozenset({"IDS", "FRAG", "FP", "FN", "ML", "AMOTP@2m", BYTES, BYTES_SHOWN})


def shown(metric: str) -> str:
    """A metric's name in tables."""
    return BYTES_SHOWN if metric == BYTES else metric
