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

PENALTIES: Mapping[str, float] = {PERSON: 0.5, RIDER: 0.6, VEHICLE: 0.6, "": 0.65}
"""Factors of the driving score by who was hit, "" is a wall: those of the CARLA leaderboard (1.0 and 2.0), which
Bench2Drive, V2Xverse and MDrive take over (`statistics_manager.py` of each). CARLA counts riders as vehicles."""

RED_LIGHT = 0.7
"""Factor of the driving score for each red light that is run; the same source."""

TTC_S = 0.95
"""Time to collision from which on there is no danger: nuPlan's `time_to_collision_within_bound`. NAVSIM looks 0.9 s
ahead."""

AGAINST_M = (2.0, 6.0)
"""Metres against the traffic in a second below which driving direction is kept, and from which on it is broken: those
of nuPlan's `driving_direction_compliance`."""

WEIGHTS = (5.0, 5.0, 2.0, 2.0)
"""Weights of progress, time to collision, lane keeping and comfort in EPDMS: NAVSIM's `PDMScorerConfig` (v2), which has
2 more for the difference of two successive plans."""


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


def _rate(of: Callable[[DriveEvents], bool], meaning: str, less: bool = True) -> Metric:
    return _metric(lambda events: 100.0 * of(events), meaning, less=less, yes_no=True)


def _seconds(of: Callable[[DriveEvents], float], meaning: str, less: bool = False) -> Metric:
    return _metric(of, meaning, "s", ".2f", less)


def _lead(moment: str) -> Callable[[DriveEvents], float]:
    return lambda events: events.moments.lead_s(getattr(events.moments, moment))


def _hit(party: str, events: DriveEvents) -> bool:
    return events.crash is not None and events.crash.party == party


def _progress(events: DriveEvents) -> float:
    """Return the distance driven, per cent of that at the legal speed; NaN where the legal speed is 0."""
    return 100 * events.way_m / events.legal_m if events.legal_m > 0 else math.nan


def _completion(events: DriveEvents) -> float:
    """Return the share of the way to the goal in per cent; without a goal the progress, at most 100."""
    known = 100 * events.rules.completion
    return min(_progress(events), 100.0) if math.isnan(known) else known


def _driving_score(events: DriveEvents) -> float:
    """Return the completion on its own lanes, times penalties of a crash, unless the car stood, and of red lights."""
    crash, rules = events.crash, events.rules
    hit = PENALTIES[crash.party] if crash is not None and crash.moved else 1.0
    return _completion(events) * (1 - rules.off_lanes) * hit * RED_LIGHT**rules.red_lights


def _success(events: DriveEvents) -> float:
    """Return 100 for a goal that is reached without an infraction, else 0; NaN without a goal."""
    rules = events.rules
    if math.isnan(rules.completion):
        return math.nan
    return 100.0 * (rules.arrived and events.crash is None and not rules.red_lights and rules.off_lanes == 0)


def _no_fault(events: DriveEvents) -> float:
    """Return 100 without a crash by its own fault, 50 for one with a wall, else 0."""
    crash = events.crash
    return 100.0 if crash is None or not crash.at_fault else 50.0 * (crash.label < 0)


def _direction(events: DriveEvents) -> float:
    most, broken = AGAINST_M
    return 100.0 if events.rules.against_m < most else 50.0 * (events.rules.against_m < broken)


def _in_time(events: DriveEvents) -> float:
    return 100.0 * (events.ttc_ahead_s >= TTC_S)


def _lane_kept(events: DriveEvents) -> float:
    return 100 * (1 - events.rules.beside)


def _comfort(events: DriveEvents) -> float:
    return 100 * (1 - events.discomfort)


def _epdms(events: DriveEvents) -> float:
    """Return the product of what multiplies and the weighted mean of the rest, per cent."""
    factors = (_no_fault(events), _direction(events), *(100.0 * kept for kept in _kept(events)))
    parts = (_completion(events), _in_time(events), _lane_kept(events), _comfort(events))
    mean = sum(weight * part for weight, part in zip(WEIGHTS, parts, strict=True)) / sum(WEIGHTS)
    return math.prod(each / 100 for each in factors) * mean


def _kept(events: DriveEvents) -> tuple[bool, bool]:
    """Return whether the car stayed in the drivable area, and whether it ran no red light."""
    return not events.rules.off_area, not events.rules.red_lights


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
        lambda events: 100 * events.discomfort, "share of time outside of nuPlan's bounds of comfort"
    ),
    "driving_score": _metric(
        _driving_score, "way to the goal, or progress, times CARLA's penalties for crashes and red lights", less=False
    ),
    "route_completion": _metric(
        lambda events: 100 * events.rules.completion, "share of the way to the goal that was driven", less=False
    ),
    "success": _metric(
        _success,
        "drives that reach their goal without crash, red light, and leaving the lanes of their direction",
        less=False,
        yes_no=True,
    ),
    "red_lights": _metric(lambda events: events.rules.red_lights, "red lights that the driven car ran", "", ".2f"),
    "no_fault": _metric(_no_fault, "EPDMS: no crash by its own fault; 50 for one with a wall", less=False),
    "in_drivable_area": _rate(lambda events: _kept(events)[0], "EPDMS: drives within the drivable area", less=False),
    "right_direction": _metric(_direction, "EPDMS: driving direction is kept", less=False),
    "lights_obeyed": _rate(lambda events: _kept(events)[1], "EPDMS: drives without a red light run", less=False),
    "ttc_in_bound": _rate(
        lambda events: events.ttc_ahead_s >= TTC_S,
        f"EPDMS: drives whose time to collision with what is not behind stays above {TTC_S:g} s",
        False,
    ),
    "lane_kept": _metric(_lane_kept, "EPDMS: share of time in the lane's middle", less=False),
    "comfort": _metric(_comfort, "EPDMS: share of time within nuPlan's bounds of comfort", less=False),
    "epdms": _metric(
        _epdms, "product of EPDMS's multipliers with the mean of its progress, time, lane and comfort", less=False
    ),
}
"""The metrics of driving by name, in the order of tables."""

DRIVING_SHOWN = ("crash", "impact_speed", "min_ttc", "lead_time", "hard_brakes", "phantom_brakes", "driving_score")
"""Names of those in narrow tables."""
