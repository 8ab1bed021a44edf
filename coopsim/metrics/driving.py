"""Metrics of driving: crashes, near misses, perception in time, brakes, progress. None where no car was driven.

Each is a mean over the drives of the pool for which it is defined: one per episode and driven car. Definitions are in
`drive_events.py`, sources in `docs/reference/metrics.md`.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from functools import partial

from coopsim.metrics.drive_events import LONGEST_S, PERSON, RIDER, VEHICLE, DriveEvents, find_events
from coopsim.metrics.log_pool import LogPool
from coopsim.metrics.metric import Metric, PoolMetric, mean_of_known

PENALTIES: Mapping[str, float] = {PERSON: 0.5, RIDER: 0.6, VEHICLE: 0.6, "": 0.6}
"""Factors of the driving score by who was hit: those of the CARLA leaderboard (1.0 and 2.0), which V2Xverse takes over.
CARLA counts riders as vehicles."""


_RECORDER = "drives"


def drive_events(pool: LogPool) -> tuple[DriveEvents, ...]:
    """Return crashes, brakes and near misses of each drive; `pool.shared(drive_events)` finds them once for all."""
    return tuple(find_events(log.drive) for log in pool.records[_RECORDER])


def _metric(
    of: Callable[[DriveEvents], float],
    meaning: str,
    unit: str = "%",
    form: str = ".1f",
    less: bool = True,
    yes_no: bool = False,
) -> Metric:
    """Return the metric that is the mean of a number of each drive, where it is known."""

    def mean(pool: LogPool) -> float:
        return mean_of_known(map(of, pool.shared(drive_events)))

    return PoolMetric(mean, meaning, unit, form, less, whole_only=True, yes_no=yes_no, recorders=(_RECORDER,))


def _rate(of: Callable[[DriveEvents], bool], meaning: str) -> Metric:
    return _metric(lambda events: 100.0 * of(events), meaning, yes_no=True)


def _seconds(of: Callable[[DriveEvents], float], meaning: str, less: bool = False) -> Metric:
    return _metric(of, meaning, "s", ".2f", less)


def _lead(moment: str) -> Callable[[DriveEvents], float]:
    return lambda events: events.moments.lead_s(getattr(events.moments, moment))


def _hit(party: str, events: DriveEvents) -> bool:
    return events.crash is not None and events.crash.party == party


def _progress(events: DriveEvents) -> float:
    """Return the distance driven, per cent of that at the legal speed; NaN where the legal speed is 0."""
    return 100 * events.way_m / events.legal_m if events.legal_m > 0 else math.nan


def _driving_score(events: DriveEvents) -> float:
    """Return the progress, at most 100, times the penalty of a crash; a car that stood is not punished."""
    crash = events.crash
    return min(_progress(events), 100.0) * (PENALTIES[crash.party] if crash is not None and crash.moved else 1.0)


DRIVING: Mapping[str, Metric] = {
    "crash": _rate(lambda events: events.crash is not None, "episodes in which the driven car crashed"),
    "crash_at_fault": _rate(
        lambda events: events.crash is not None and events.crash.at_fault,
        "episodes in which the driven car drove into another body",
    ),
    "crash_by_log": _rate(
        lambda events: events.crash is not None and events.crash.by_log,
        "episodes in which a road user that follows a log, and cannot see the driven car, drove into it",
    ),
    "crash_person": _rate(partial(_hit, PERSON), "episodes with a crash with a pedestrian or a child"),
    "crash_rider": _rate(partial(_hit, RIDER), "episodes with a crash with a motorcycle, bicycle or scooter"),
    "crash_vehicle": _rate(partial(_hit, VEHICLE), "episodes with a crash with a car, van, truck or bus"),
    "impact_speed": _metric(
        lambda events: math.nan if events.crash is None else events.crash.speed_m_s,
        "speed relative to the body that was hit, over crashes",
        "m/s",
    ),
    "min_ttc": _seconds(lambda events: events.min_ttc_s, f"least time to collision, at most {LONGEST_S:g}"),
    "pet": _seconds(lambda events: events.pet_s, f"least post-encroachment time, at most {LONGEST_S:g}"),
    "lead_time": _seconds(_lead("confirmed"), "from the first track on the conflicting object to the conflict"),
    "lead_time_seen": _seconds(_lead("seen"), "from the car's own first returns of that object to the conflict"),
    "lead_time_braked": _seconds(_lead("braked"), "from the car's first brake to the conflict"),
    "hard_brakes": _metric(lambda events: len(events.hard_s), "brakes below -3 m/s²", "", ".2f"),
    "phantom_brakes": _metric(
        lambda events: len(events.phantom_s),
        "brakes below -0.25 g without an object in its way that the car knows",
        "",
        ".2f",
    ),
    "progress": _metric(_progress, "distance driven, of that at the legal speed", less=False),
    "time_lost": _seconds(lambda events: events.lost_s, "time lost by driving below the legal speed", less=True),
    "discomfort": _metric(
        lambda events: 100 * events.discomfort, "share of time with accelerations outside of nuPlan's bounds of comfort"
    ),
    "driving_score": _metric(_driving_score, "progress times CARLA's penalties for crashes", less=False),
}
"""The metrics of driving by name, in the order of tables."""

DRIVING_SHOWN = ("crash", "impact_speed", "min_ttc", "lead_time", "hard_brakes", "phantom_brakes", "driving_score")
"""Names of those in narrow tables."""
