"""Estimates of the work that a benchmark or a detection measurement still has, without running it."""

from __future__ import annotations

import time
from collections import defaultdict
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from coopsim.bench.benchmark import check
from coopsim.bench.detect.detect_plan import DetectPlan
from coopsim.bench.engine.job import Job, run_job
from coopsim.bench.grid.grid import Grid
from coopsim.bench.isolated.isolation import Isolation
from coopsim.bench.store.fingerprint import Sources
from coopsim.bench.store.metric_spec import MetricSpec
from coopsim.bench.store.store import CELLS, Store
from coopsim.episode import Episode, Recorder
from coopsim.support.processes import cores

Kind = tuple[str, str]
"""Policy and environment, which decide the duration of a run."""

_TIMED_FRAMES = 5


@dataclass(frozen=True, slots=True)
class Estimate:
    """Work that is left.

    Attributes:
        runs: number of all runs.
        stored: number of those whose outcome is stored.
        left_s: estimated seconds of the others, for one worker.
        timed: number of short runs that were made for it.
    """

    runs: int
    stored: int
    left_s: float
    timed: int

    def text(self, unit: str, workers: int | None) -> str:
        """Describe the work; `unit` is the runs' noun in the plural, None workers are as many as cores."""
        at_once = workers or cores()
        hours = self.left_s / at_once / 3600
        basis = f"from {self.timed} short runs here" if self.timed else "from stored runs"
        left = f"{self.runs} {unit}, {self.stored} are stored, {self.runs - self.stored} to run"
        return left if self.runs == self.stored else f"{left}: about {hours:.2g} hours with {at_once} workers ({basis})"


def estimate_benchmark(grid: Grid, folder: Path, isolation: Isolation = Isolation()) -> Estimate:  # noqa: B008  (frozen)
    """Estimate the work of `benchmark`. Nothing is written.

    Seconds are those of stored cells of the same policy and scenario, or else of a few frames that are run now.

    Raises:
        CoopsimError: a name is unknown or a value is not accepted.
    """
    policies, metrics, sources = check(grid, isolation), MetricSpec.all(), Sources()
    jobs = [Job.of(cell, grid.options, policies[cell.policy], metrics, isolation, sources) for cell in grid.cells()]
    return _estimate(jobs, folder)


def estimate_detection(plan: DetectPlan, folder: Path | None) -> Estimate:
    """Estimate the work of `measure_detection`. Nothing is written.

    Raises:
        CoopsimError: a name is unknown or a value is not accepted.
    """
    plan.check()
    return _estimate(plan.jobs(), folder)


def _estimate(jobs: Sequence[Job], folder: Path | None) -> Estimate:
    store = None if folder is None or not (folder / CELLS).is_dir() else Store(folder)
    known, waiting = defaultdict[Kind, list[float]](list), list[Job]()
    for job in jobs:
        if store is None or not store.path_of(job.key).is_file():
            waiting.append(job)
        elif "seconds" in (told := store.circumstances(job.key)):
            known[_kind(job)].append(float(told["seconds"]))
    first = {_kind(job): job for job in reversed(waiting)}
    means = {kind: sum(each) / len(each) for kind, each in known.items()}
    found, timed = _complete(means, first, lambda kind: _seconds_of(first[kind]))
    return Estimate(len(jobs), len(jobs) - len(waiting), sum(found[_kind(job)] for job in waiting), timed)


def _complete(
    known: Mapping[Kind, float], wanted: Iterable[Kind], measure: Callable[[Kind], float]
) -> tuple[dict[Kind, float], int]:
    """Return seconds of every wanted kind, and how many were measured.

    Where many are unknown, each policy is measured in the first environment, and the slowest of them in each of the
    others: a policy's seconds are taken to grow from one environment to another as the slowest one's do. One whose car
    crashes early is quick, and says little of the others.
    """
    found = dict(known)
    unknown = [kind for kind in wanted if kind not in found]
    policies = list(dict.fromkeys(policy for policy, _ in unknown))
    environments = list(dict.fromkeys(environment for _, environment in unknown))
    if not unknown:
        return found, 0
    first = environments[0]
    found |= {(policy, first): measure((policy, first)) for policy in policies if (policy, first) not in known}
    slowest = max(policies, key=lambda policy: found[policy, first])
    rest = [(slowest, each) for each in environments[1:] if (slowest, each) not in known]
    found |= {kind: measure(kind) for kind in rest}
    measured = len(found) - len(known)
    for policy, environment in unknown:
        if (policy, environment) not in found:
            growth = found[slowest, environment] / max(found[slowest, first], 1e-9)
            found[policy, environment] = found[policy, first] * growth
    return found, measured


def _kind(job: Job) -> Kind:
    return job.cell.policy, job.cell.condition.scenario


class _Clock(Recorder):
    """Time at the end of each step."""

    def __init__(self) -> None:
        self.ends: list[float] = []

    def on_step(self, episode: Episode) -> None:
        self.ends.append(time.perf_counter())


def _seconds_of(job: Job) -> float:
    """Run the first frames of a job, and return the seconds of the whole; without a fixed length, run the whole."""
    frames = job.cell.frames
    if frames is None:
        return run_job(job).seconds
    clock = _Clock()
    short = replace(job, cell=replace(job.cell, frames=min(frames, _TIMED_FRAMES)))
    outcome, ends = run_job(short, [clock]), clock.ends
    frame_s = (ends[-1] - ends[0]) / (len(ends) - 1) if len(ends) > 1 else 0.0
    return outcome.seconds + frame_s * max(frames - len(ends), 0)
