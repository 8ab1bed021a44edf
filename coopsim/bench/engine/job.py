"""Jobs, each of which runs one cell in any process, and their outcomes."""

from __future__ import annotations

import contextlib
import os
import platform
import re
import socket
import sys
import time
import traceback
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from datetime import UTC, datetime
from functools import cache
from typing import Any, ClassVar

import coopsim
from coopsim.bench.engine.result_of import result_of
from coopsim.bench.evaluate import evaluate
from coopsim.bench.grid.cell import Cell, CellResult, environment_options
from coopsim.bench.grid.policies import arithmetic_of, of_cell
from coopsim.bench.isolated.isolation import Isolation
from coopsim.bench.store.closure import RUN
from coopsim.bench.store.fingerprint import Sources, changed_parts, fingerprint, key_of
from coopsim.bench.store.metric_spec import MetricSpec, keep_named
from coopsim.bench.store.packages import package_versions
from coopsim.catalog import PolicySpec
from coopsim.episode import Recorder
from coopsim.support.processes import cores, processor_name

_ADDRESS = re.compile(r"\b0x[0-9a-f]{4,}")


@dataclass(frozen=True, slots=True, eq=False)
class Outcome:
    """The outcome of a job.

    Attributes:
        result: result, the same in every run.
        circumstances: data that differ between runs: seconds, machine, versions, and the end of a process that died.
        lost: True if the cell was not run for no fault of its own, as where its machine died: it is not stored.
        film: content of the film's file, if the run was filmed.
    """

    job: Job
    result: CellResult
    circumstances: Mapping[str, Any] = field(default_factory=dict)
    lost: bool = False
    film: bytes | None = None

    @property
    def seconds(self) -> float:
        """Wall time; 0 for a job whose worker died."""
        return float(self.circumstances.get("seconds", 0.0))

    @property
    def reason(self) -> str | None:
        """The cause of the failure in one line, with the end of its process if that died; None if it did not fail."""
        how = self.circumstances.get("died")
        return self.result.reason if how is None else f"{self.result.reason}: {how}"


@dataclass(frozen=True, slots=True, eq=False)
class Job:
    """A cell and everything that is needed to run it, as plain data.

    Attributes:
        options: options of its environment, besides the condition.
        decided_by: the cell's `fingerprint`.
        metrics: registered metrics of its result, besides the built-in ones.
        isolation: separation of the policy from the world.
        root: module from which all of a run is imported.
        noun: word for a run in messages.
        arrays: whether its result has arrays.
    """

    root: ClassVar[str] = RUN
    noun: ClassVar[str] = "cell"
    arrays: ClassVar[bool] = False

    cell: Cell
    options: Mapping[str, Any]
    policy: PolicySpec
    decided_by: str
    metrics: tuple[MetricSpec, ...] = ()
    isolation: Isolation = Isolation()

    @classmethod
    def of(
        cls,
        cell: Cell,
        options: Mapping[str, Any],
        policy: PolicySpec,
        metrics: tuple[MetricSpec, ...] = (),
        isolation: Isolation = Isolation(),  # noqa: B008  (frozen)
        sources: Sources | None = None,
    ) -> Job:
        """Make the job of a cell of a policy; `sources` as of `fingerprint`.

        Raises:
            InvalidValueError: the condition sets a parameter that the policy's text has, too.
        """
        policy = of_cell(policy, cell.condition, trusted=not (isolation.as_data() and policy.place))
        job = cls(cell, options, policy, "", metrics, isolation)
        return replace(job, decided_by=job.fingerprint(sources))

    def fingerprint(self, sources: Sources | None = None) -> str:
        """Return all that decides the outcome now, as text."""
        apart = self.isolation.as_data()
        return fingerprint(self.cell, self.inputs, self.policy, self.metrics, apart, sources, self.root)

    @property
    def inputs(self) -> Mapping[str, Any]:
        """The options, and what else decides the outcome."""
        return self.options

    @property
    def arithmetic(self) -> str:
        """The arithmetic of the cell's networks, see `arithmetic_of`."""
        trusted = not (self.isolation.as_data() and self.policy.place)
        settings = dict(self.cell.condition.settings)
        return arithmetic_of(self.policy, settings.get("detector", self.options.get("detector")), trusted=trusted)

    @property
    def key(self) -> str:
        """Key of the job's result in a store."""
        return key_of(self.decided_by)

    def run(self) -> Outcome:
        """Run the cell. It is lost if anything is not as it was when the job, and its key, were made."""
        before, sources = set(sys.modules), Sources()
        outcome = self.perform()
        try:
            now = self.fingerprint(sources)
        except Exception:  # its policy cannot be imported here, which is its outcome
            return outcome
        if changed := changed_parts(self.decided_by, now):
            return self.lost(f"{changed} changed since the command began, or differs here")
        if unknown := sources.uncounted(sys.modules.keys() - before):
            return self.lost(f"it loaded {', '.join(unknown)}, which its key does not count")
        return outcome

    def perform(self) -> Outcome:
        """Run the cell, see `run_job`."""
        return run_job(self)

    def measure(self, recorders: Sequence[Recorder] = ()) -> CellResult:
        """Measure the cell, and tell recorders of it. A user's policy may raise anything."""
        return _evaluate(self, recorders)

    def died(self, how: str) -> Outcome:
        """Return the outcome where the process died. `how` differs between engines, so it is not in the result."""
        return self._failed(f"the process that ran this {self.noun} died\n", how)

    def lost(self, how: str) -> Outcome:
        """Return the outcome where the cell was not run, for no fault of its own."""
        return self._failed(f"the {self.noun} was not run\n", how, lost=True)

    def _failed(self, traceback: str, how: str, *, lost: bool = False) -> Outcome:
        return Outcome(self, CellResult(self.cell, traceback=traceback), {"died": how}, lost)


def run_job(job: Job, recorders: Sequence[Recorder] = ()) -> Outcome:
    """Run a cell, and tell recorders of it. An exception becomes its result."""
    _warm_up(job)
    started = time.perf_counter()
    try:
        result = job.measure(recorders)
    except Exception as error:  # a user's policy may raise anything, and the other cells go on
        result = CellResult(job.cell, traceback=traceback_of(error))
    seconds = time.perf_counter() - started
    return Outcome(job, result, {"seconds": seconds, "ended": _now(), **circumstances()})


def _now() -> str:
    return datetime.now(UTC).isoformat(timespec="seconds")


def _evaluate(job: Job, recorders: Sequence[Recorder]) -> CellResult:
    cell = job.cell
    options = environment_options(cell, job.options)
    for metric in job.metrics:
        metric.load()
    seed = job.isolation.seed(cell.seed)
    with job.isolation.policy(job.policy) as policy:
        evaluation = evaluate(policy, cell.condition.scenario, seed=seed, recorders=recorders, **options)
    result = result_of(cell, evaluation, job.arithmetic)
    return replace(
        result,
        place_seed=job.isolation.told_place(seed, result.place_seed),
        values=keep_named(result.values, job.metrics),
        agents={name: keep_named(values, job.metrics) for name, values in result.agents.items()},
    )


def traceback_of(error: Exception) -> str:
    """Format a traceback without what differs between runs: our callers, and addresses of objects."""
    text = "".join(traceback.format_exception(error)).encode(errors="backslashreplace").decode()  # as names of files
    return _ADDRESS.sub("0x...", text)


_warm = False


def _warm_up(job: Job) -> None:
    """Compile before a clock runs: once in a process, by the first frames of its first job.

    They run in this process. A policy's own cannot keep what it compiles, so for its sake there are more frames, in
    which late messages arrive. In place of a user's policy that is not imported here runs one of ours.
    """
    global _warm
    if _warm:
        return
    _warm = True
    apart = job.isolation.limit_s is not None
    policy = PolicySpec.parse("late_fusion(delayed=replay)") if apart and job.policy.place else job.policy
    cell, here = replace(job.cell, frames=12 if apart else 3), replace(job.isolation, limit_s=None)
    with contextlib.suppress(Exception):  # the cell itself will report it
        replace(job, cell=cell, policy=policy, isolation=here).measure()


@cache
def circumstances() -> dict[str, Any]:
    """Return data of this process that differ between runs: versions, machine and process id."""
    return {
        "versions": {
            "coopsim": coopsim.__version__,
            "python": platform.python_version(),
            **package_versions(),
        },
        "platform": platform.platform(),
        "processor": f"{processor_name()}, {cores()} cores",
        "worker": f"{socket.gethostname()}:{os.getpid()}",
    }
