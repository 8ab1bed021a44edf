"""Jobs, each of which runs one cell in any process, and their outcomes."""

from __future__ import annotations

import contextlib
import importlib
import os
import platform
import re
import socket
import sys
import time
import traceback
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from functools import cache
from typing import Any, ClassVar

import numpy as np

import coopsim
from coopsim.bench.evaluate import Evaluation, evaluate
from coopsim.bench.grid.cell import Cell, CellResult, environment_options
from coopsim.bench.grid.policies import arithmetic_of, of_cell
from coopsim.bench.isolated.isolation import Isolation
from coopsim.bench.store.closure import RUN
from coopsim.bench.store.fingerprint import Sources, changed_parts, fingerprint, key_of, package_versions
from coopsim.catalog import PolicySpec
from coopsim.episode import Recorder
from coopsim.errors import InvalidValueError
from coopsim.metrics.built_in import BUILT_IN, custom_metrics
from coopsim.metrics.metric import METRICS
from coopsim.support.checks import require_count
from coopsim.support.user_code import SOURCE, load_source

_ADDRESS = re.compile(r"\b0x[0-9a-f]{4,}")


@dataclass(frozen=True, slots=True, eq=False)
class Outcome:
    """The outcome of a job.

    Attributes:
        result: result, the same in every run.
        circumstances: data that differ between runs: seconds, machine, versions, and the end of a process that died.
        lost: True if the cell was not run for no fault of its own, as where its machine died: it is not stored.
    """

    job: Job
    result: CellResult
    circumstances: Mapping[str, Any] = field(default_factory=dict)
    lost: bool = False

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
        outcome = run_job(self)
        try:
            now = self.fingerprint(sources)
        except Exception:  # its policy cannot be imported here, which is its outcome
            return outcome
        if changed := changed_parts(self.decided_by, now):
            return self.lost(f"{changed} changed since the command began, or differs here")
        if unknown := sources.uncounted(sys.modules.keys() - before):
            return self.lost(f"it loaded {', '.join(unknown)}, which its key does not count")
        return outcome

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
    return Outcome(job, result, {"seconds": seconds, **circumstances()})


def result_of(cell: Cell, evaluation: Evaluation, arithmetic: str) -> CellResult:
    """Return the evaluation of a cell as its result.

    Raises:
        InvalidValueError: the policy's `counts` are no integers of 64 bits by name, or its `method` is no text.
    """
    score = evaluation.score
    if not isinstance(evaluation.method, str):
        raise InvalidValueError(f"method must be a text, got {evaluation.method!r}")
    return CellResult(
        cell,
        values=_as_floats(score.values),
        agents={name: _as_floats(agent.values) for name, agent in score.agents.items()},
        rewards=np.asarray(evaluation.rewards, np.float64),
        messages=asdict(evaluation.messages),
        place_seed=evaluation.place_seed,
        counts=_as_counts(evaluation.counts),
        method=evaluation.method,
        arithmetic=arithmetic,
        bound=evaluation.bound,
    )


def _as_floats(values: Mapping[str, float]) -> dict[str, float]:
    return {name: float(value) for name, value in values.items()}


def _as_counts(counts: Mapping[str, int]) -> dict[str, int]:
    for name, count in counts.items():
        if not isinstance(name, str):
            raise InvalidValueError(f"counts must be by name, got {name!r}")
        require_count(-(2**63), 2**63 - 1, **{f"counts[{name!r}]": count})
    return {name: int(count) for name, count in counts.items()}


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
        "worker": f"{socket.gethostname()}:{os.getpid()}",
    }


@dataclass(frozen=True, slots=True)
class MetricSpec:
    """Source of a metric that a user or a package registered.

    Attributes:
        name: registered name.
        module: name of the module that registers it.
        path: path of the module's file, if it is not importable because it came with a policy (`file.py:Class`).
        source: text of that file; None for an importable module.
    """

    name: str
    module: str
    path: str | None = None
    source: str | None = None

    @classmethod
    def all(cls) -> tuple[MetricSpec, ...]:
        """Describe every registered metric that is not built in.

        Raises:
            InvalidValueError: a script itself registers a metric, which other processes cannot import.
        """
        specs = []
        for name, metric in custom_metrics().items():
            module = type(metric).__module__
            if module == "__main__":
                raise InvalidValueError(
                    f"metric {name!r} must be registered in a module, or in the file of a policy, for a benchmark's "
                    "processes to load it; it is registered in the script that runs"
                )
            content = vars(sys.modules[module])
            source = content.get(SOURCE)
            specs.append(cls(name, module, None if source is None else str(content["__file__"]), source))
        return tuple(specs)

    def load(self) -> None:
        """Register the metric in this process. Raises `InvalidValueError` if its module does not."""
        if self.name not in METRICS:
            if self.source is not None and self.path is not None:
                load_source(self.path, self.source)
            else:
                importlib.import_module(self.module)
        if self.name not in METRICS:
            raise InvalidValueError(f"metric {self.name!r} is not registered by the module {self.module!r}")


def keep_named(values: Mapping[str, float], metrics: tuple[MetricSpec, ...]) -> dict[str, float]:
    """Drop the values of registered metrics that are not among `metrics`, as another job may have registered them."""
    named = {spec.name for spec in metrics}
    return {name: value for name, value in values.items() if name in BUILT_IN or name in named}
