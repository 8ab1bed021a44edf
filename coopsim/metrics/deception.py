"""Metrics of attacks' success: claimed objects that are tracked, and denied ones that are not. None without a lie."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence

from coopsim.metrics.deception_log import Deception, DeceptionLog
from coopsim.metrics.metric import Metric, PoolMetric, mean_of_known

_RECORDER = "deceptions"


def _metric(of: Callable[[Sequence[DeceptionLog]], float], meaning: str, unit: str = "%", less: bool = True) -> Metric:
    """Return the metric that a function computes from the logs of lies."""
    return PoolMetric(
        lambda pool: of(pool.records[_RECORDER]), meaning, unit, ".1f", less, whole_only=True, recorders=(_RECORDER,)
    )


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
    "ghosts_believed": _metric(
        _of_ghosts(lambda each: 100.0 * (each.believed > 0)), "claimed objects on which there ever is a track"
    ),
    "ghost_frames": _metric(_ghost_frames, "frames of claimed objects with a track on them"),
    "ghost_delay": _metric(
        _of_ghosts(lambda each: each.first if math.isfinite(each.first) else math.nan),
        "frames from the first claim of an object to the first track on it, where there is one",
        "frames",
        less=False,
    ),
    "ghost_life": _metric(
        _of_ghosts(lambda each: each.longest or math.nan),
        "frames in succession with a track on a claimed object, where there is one",
        "frames",
    ),
    "denied_lost": _metric(_hidden, "true objects denied by a lie on which there is no track"),
}
"""The metrics of attacks' success by name, in the order of tables."""
