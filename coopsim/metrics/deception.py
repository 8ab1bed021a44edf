"""Metrics of attacks' success: claimed objects that are tracked, and denied ones that are not. None without a lie."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

from coopsim.metrics.deception_log import Deception, DeceptionLog
from coopsim.metrics.log_pool import LogPool
from coopsim.metrics.metric import Metric, mean_of_known


@dataclass(frozen=True)
class _DeceptionMetric(Metric):
    of: Callable[[Sequence[DeceptionLog]], float]
    meaning: str
    unit: str = "%"
    form: str = ".1f"
    less_is_better: bool = True
    whole_only: bool = True

    def value(self, pool: LogPool) -> float | None:
        return self.of(pool.deceptions) if pool.deceptions else None


def _of_ghosts(of: Callable[[Deception], float]) -> Callable[[Sequence[DeceptionLog]], float]:
    """Return the mean of a number over claimed objects, without those where it is NaN."""

    def mean(logs: Sequence[DeceptionLog]) -> float:
        return mean_of_known(of(each) for log in logs for each in log.ghosts.values())

    return mean


def _ghost_frames(logs: Sequence[DeceptionLog]) -> float:
    claimed = sum(each.claimed for log in logs for each in log.ghosts.values())
    believed = sum(each.believed for log in logs for each in log.ghosts.values())
    return 100.0 * believed / claimed if claimed else math.nan


def _hidden(logs: Sequence[DeceptionLog]) -> float:
    denied = sum(log.denied for log in logs)
    return 100.0 * sum(log.hidden for log in logs) / denied if denied else math.nan


DECEPTION: Mapping[str, Metric] = {
    "ghosts_believed": _DeceptionMetric(
        _of_ghosts(lambda each: 100.0 * (each.believed > 0)), "claimed objects on which there ever is a track"
    ),
    "ghost_frames": _DeceptionMetric(_ghost_frames, "frames of claimed objects with a track on them"),
    "ghost_delay": _DeceptionMetric(
        _of_ghosts(lambda each: each.first if math.isfinite(each.first) else math.nan),
        "frames from the first claim of an object to the first track on it, where there is one",
        "frames",
        less_is_better=False,
    ),
    "ghost_life": _DeceptionMetric(
        _of_ghosts(lambda each: each.longest or math.nan),
        "frames in succession with a track on a claimed object, where there is one",
        "frames",
    ),
    "denied_lost": _DeceptionMetric(_hidden, "true objects denied by a lie on which there is no track"),
}
"""The metrics of attacks' success by name, in the order of tables."""
