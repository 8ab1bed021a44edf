"""The conformance check of a metric."""

from __future__ import annotations

import math
from contextlib import closing

import numpy as np

from coopsim.catalog import make_policy, parallel_env
from coopsim.episode import RECORDERS, run_episode
from coopsim.geometry.boxes import Boxes3D
from coopsim.metrics.drive_log import DriveFrame, DriveLog
from coopsim.metrics.evaluator import Evaluator
from coopsim.metrics.log_pool import LogPool
from coopsim.metrics.metric import METRICS, Metric
from coopsim.testing.harness import SMALL
from coopsim.types import NS_PER_S, GroundTruth, Tracks
from coopsim.types.driving import CarState, Route

_FRAMES = 12


def check_metric(metric: str | Metric | type[Metric]) -> None:
    """Check that a metric keeps what scores, tables and reports rely on.

    It must be described in one line; give a number or None for any log, an empty one included, with a drive beside it,
    and for each agent of a small episode with the recorders that it names; give the same value again, whatever numbers
    identify objects and tracks; leave the logs as they are; and not call tracks that are all false better than tracks
    that are all right.

    Args:
        metric: a registered name, a class or an object.

    Raises:
        AssertionError: a check failed; the message names it.
        UnknownNameError: no metric of that name is registered, or no recorder of a name that it names.
    """
    entry = METRICS.get(metric) if isinstance(metric, str) else metric
    made = entry() if isinstance(entry, type) else entry
    name = metric if isinstance(metric, str) else type(made).__name__
    assert isinstance(made, Metric), f"{name} must be a coopsim.metrics.Metric, got {made!r}"
    assert made.meaning and "\n" not in made.meaning, f"{name}: `meaning` must be one line, got {made.meaning!r}"
    assert format(12.345, made.form), f"{name}: `form` must be a format of numbers, got {made.form!r}"
    for pool in _small_episode(made.recorders):
        _number(made, name, pool)
    right = _value(made, name, _log(shift_m=0.0))
    again = _value(made, name, _log(shift_m=0.0))
    assert _close(right, again), f"{name} must give the same value for the same log"
    renamed = _value(made, name, _log(shift_m=0.0, first_id=1000), first_id=1000)
    assert _close(right, renamed), f"{name} must not depend on the numbers of ids, got {right} and {renamed}"
    for log in (Evaluator(), _log(objects=0), _log(tracks=0)):
        _value(made, name, log)
    right, false = (_value(made, name, _log(shift_m=shift_m, gaps=False)) for shift_m in (0.0, 20.0))
    if right is not None and false is not None and not (math.isnan(right) or math.isnan(false)):
        better = false < right if made.less_is_better else false > right
        direction = "less" if made.less_is_better else "more"
        assert not better, (
            f"{name} says that {direction} is better, and gives {right} for perfect tracks but {false} for false ones"
        )


def _value(metric: Metric, name: str, evaluator: Evaluator, first_id: int = 1) -> float | None:
    pool = LogPool.of([evaluator.log], bytes_per_s=100.0, records={"drives": [_drive(first_id)]})
    before = LogPool.of([evaluator.log])
    value = _number(metric, name, pool)
    for log, untouched in zip(pool.logs, before.logs, strict=True):
        for column in untouched.__dataclass_fields__:
            same = np.array_equal(getattr(log, column), getattr(untouched, column))
            assert same, f"{name} must leave the logs as they are, and changed {column}"
    return value


def _number(metric: Metric, name: str, pool: LogPool) -> float | None:
    value = metric.value(pool)
    assert value is None or isinstance(value, (int, float, np.number)), (
        f"{name} must be a number or None, got {value!r}"
    )
    return None if value is None else float(value)


def _small_episode(recorders: tuple[str, ...]) -> list[LogPool]:
    """Run a small episode with these recorders, and return the pool of each agent; none if they are the library's."""
    kept = {name: RECORDERS.get(name)() for name in recorders}
    if all(type(recorder).__module__.startswith("coopsim.") for recorder in kept.values()):
        return []
    policy = make_policy("late_fusion")
    with closing(parallel_env("crossing", **{**SMALL, "lidar": None, "max_cycles": 4, "uplink": policy})) as env:
        run_episode(env, policy, tuple(kept.values()), seed=3)
        records = {name: recorder.records() for name, recorder in kept.items()}
        return [
            LogPool.of([log], records={name: [each[agent]] for name, each in records.items() if agent in each})
            for agent, log in env.logs.items()
        ]


def _log(shift_m: float = 0.0, first_id: int = 1, objects: int = 3, tracks: int = 3, gaps: bool = True) -> Evaluator:
    """Score objects in a row, and as many tracks shifted by `shift_m`; with gaps, both are absent at times."""
    evaluator = Evaluator()
    for frame in range(_FRAMES):
        present = [k for k in range(3) if (frame + 2 * k) % 5 or not gaps]
        there, found = present[:objects], present[:tracks]
        truth = GroundTruth(np.array(there, dtype=np.int64) + first_id, _row(there, frame, 0.0), _labels(there))
        count = len(found)
        evaluator.update(
            truth,
            Tracks(
                np.array(found, dtype=np.int64) + 7 * first_id,
                _row(found, frame, shift_m),
                np.zeros((count, 2)),
                np.linspace(0.4, 0.9, count),
                _labels(found),
            ),
        )
    return evaluator


def _drive(first_id: int) -> DriveLog:
    """Drive on a straight road towards a standing car, which is tracked from the third frame on, and brake."""
    log, speed, x = DriveLog(), 10.0, 0.0
    ways = np.arange(50.0)
    route = Route(np.column_stack([ways, 0.0 * ways]), 1.0, np.full(50, 14.0), np.zeros(50, np.int64))
    for frame in range(_FRAMES):
        box, label = Boxes3D.from_array([[40.0 - x, 0.0, 0.8, 4.5, 1.9, 1.6, 0.0]]), np.zeros(1, np.int64)
        acceleration = -4.0 if frame >= _FRAMES // 2 else 0.0
        truth = GroundTruth(np.array([first_id]), box, label, label, np.zeros((1, 2)))
        tracks = Tracks(np.array([7 * first_id]), box, np.zeros((1, 2)), np.ones(1), label)
        car = CarState(speed, acceleration, 4.5, 1.9, False, route)
        pose = np.array([x, 0.0, 0.0])
        reported = tracks if frame > 1 else Tracks.empty()
        log.append(DriveFrame(frame * NS_PER_S // 10, pose, car, truth, reported, acceleration, (first_id,)))
        x, speed = x + 0.1 * speed, speed + 0.1 * acceleration
    return log


def _row(members: list[int], frame: int, shift_m: float) -> Boxes3D:
    rows = np.array([[10.0 * k + frame, shift_m, 0.8, 4.5, 1.9, 1.6, 0.0] for k in members])
    return Boxes3D.from_array(rows.reshape(-1, 7))


def _labels(members: list[int]) -> np.ndarray[tuple[int], np.dtype[np.int64]]:
    """Return classes: two cars and a pedestrian."""
    return np.array([7 if k == 2 else 0 for k in members], dtype=np.int64)


def _close(a: float | None, b: float | None) -> bool:
    if a is None or b is None:
        return a is b
    return math.isclose(a, b, rel_tol=1e-9, abs_tol=1e-9) or (math.isnan(a) and math.isnan(b))
