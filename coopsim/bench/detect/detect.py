"""Detection measurement from the plan to the rows and their table.

Finished episodes are read from files, the others are run. Brackets in the table hold the 95 % interval over episodes,
where there are enough.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from typing import Any

import numpy as np
from tabulate import tabulate

from coopsim.bench.detect.detect_plan import EVERYWHERE, DetectJob, DetectPlan
from coopsim.bench.detect.perceived import Perceived
from coopsim.bench.detect.protocols import PROTOCOLS, VEHICLES, Protocol, among
from coopsim.bench.detect.ranking import Overlaps, Ranking, area_interval
from coopsim.bench.engine.engine import Engine
from coopsim.bench.grid.axis import LATENCY, axis_of
from coopsim.bench.grid.cell import CellResult, Condition, environment_options
from coopsim.bench.results.result_table import named
from coopsim.bench.run_jobs import Progress, run_jobs
from coopsim.bench.store.fingerprint import Sources
from coopsim.bench.store.store import Store
from coopsim.metrics.score import UNKNOWN

_MAIN = "APBEV@0.5"

WITH_INTERVALS = (
    "APBEV@0.5 5_returns", "APBEV@0.7 5_returns", _MAIN, "APBEV@0.7", "AP3D@0.5", "AP3D@0.7", "APBEV@0.3 people",
    "APBEV@0.5 others_only",
)  # fmt: skip
"""Metrics for which rows have intervals."""

_BESIDE = {"coopsim": "opencood"}
"""Protocol whose table stands below another's: most published tables rank boxes as OpenCOOD does."""

_TOGETHER = 10
"""Returns from which on a vehicle is rarely missed: `late_fusion` finds .96 of those with 10 to 19 of all agents."""


@dataclass(frozen=True, slots=True, eq=False)
class Measured:
    """An episode, and the ranking behind each metric of a protocol.

    Attributes:
        perceived: the episode.
            rankings: rankings by metric.
            beside: rankings of the protocol that stands beside it, see `_BESIDE`; empty without one.
    """

    perceived: Perceived
    rankings: Mapping[str, Ranking]
    beside: Mapping[str, Ranking]

    @classmethod
    def of(cls, perceived: Perceived, protocol: str, within_m: float | None = None) -> Measured:
        """Match an episode by a protocol, up to a distance of the receivers; None: everywhere."""
        overlaps = Overlaps.of(perceived if within_m is None else perceived.within(within_m))
        beside = PROTOCOLS.get(_BESIDE[protocol])().rankings(overlaps) if protocol in _BESIDE else {}
        return cls(perceived, PROTOCOLS.get(protocol)().rankings(overlaps), beside)


def row_of(
    plan: DetectPlan, place: tuple[str, Condition], options: Mapping[str, Any], measured: Sequence[Measured]
) -> dict[str, Any]:
    """Return the row of a policy and a condition, in an environment or `EVERYWHERE`, pooled over its episodes."""
    policy, condition = place
    protocol = PROTOCOLS.get(plan.protocol)()
    episodes, rankings = [each.perceived for each in measured], [each.rankings for each in measured]
    messages, sent_bytes = sum(each.messages for each in episodes), sum(each.sent_bytes for each in episodes)
    return {
        "policy": policy,
        "environment": condition.scenario,
        "protocol": plan.protocol,
        "noise": _noise(condition),
        "delay_ms": None if condition.latency_s is None else axis_of(LATENCY).value(condition),
        "attacks": "none" if condition.attacks == "" else condition.attacks,
        "options": dict(options),
        "seeds": list(plan.seeds),
        "receivers": plan.receivers,
        "boxes": plan.boxes,
        "within_m": plan.within_m,
        "bound": policy in plan.bounds,
        "arithmetic": plan.arithmetic(policy),
        "frames": sum(each.frames for each in episodes),
        "receiver_frames": sum(each.receiver_frames for each in episodes),
        "messages": messages,
        "bytes_per_message": round(sent_bytes / messages, 1) if messages else 0.0,
        **_ms(episodes),
        **metrics_of(protocol, rankings),
        "objects": sum(part[_MAIN].objects for part in rankings),
        "only_together": _only_together(episodes),
        **_beside(plan.protocol, [each.beside for each in measured]),
        "objects_of": counts_of(rankings),
        "intervals": intervals_of(protocol, rankings),
    }


def _noise(condition: Condition) -> str | None:
    """Return the noise as "0.4/0.4", m and degrees; None where it is the environment's own."""
    position_m = condition.position_noise_m
    return None if position_m is None else f"{position_m:g}/{condition.heading_noise_deg:g}"


def _only_together(episodes: Sequence[Perceived]) -> float | None:
    """Return the share of vehicles with `_TOGETHER` returns of all agents, but of none alone; None if unknown.

    Only of these does it help to fuse what several agents measured, beyond choosing who saw best.
    """
    returns = np.concatenate([e.true_returns[e.true_counts & among(e.true_label, VEHICLES)] for e in episodes])
    if not len(returns) or (returns == UNKNOWN).any():
        return None
    return round(float(((returns[:, 0] >= _TOGETHER) & (returns[:, 1] < _TOGETHER)).mean()), 6)


def _beside(protocol: str, parts: Sequence[Mapping[str, Ranking]]) -> dict[str, Any]:
    """Return the metrics of the protocol that stands beside another, under its name."""
    beside = _BESIDE.get(protocol)
    return {} if beside is None else {beside: metrics_of(PROTOCOLS.get(beside)(), parts)}


def counts_of(parts: Sequence[Mapping[str, Ranking]]) -> dict[str, int]:
    """Return the numbers of objects behind the main metric of each kind and part, by the end of its name."""
    names = [name for name in parts[0] if name.startswith(_MAIN)]
    return {name.removeprefix(_MAIN): sum(part[name].objects for part in parts) for name in names}


def metrics_of(protocol: Protocol, parts: Sequence[Mapping[str, Ranking]]) -> dict[str, float | None]:
    """Return the metrics of episodes together, by name; None where there was nothing to be found.

    Args:
        protocol: protocol of the metrics.
        parts: rankings of each episode, by name.
    """
    joined = {name: Ranking.joined([part[name] for part in parts]) for name in parts[0]}
    return {name: None if math.isnan(value) else round(value, 6) for name, value in protocol.values(joined).items()}


def intervals_of(protocol: Protocol, parts: Sequence[Mapping[str, Ranking]]) -> dict[str, list[float]]:
    """Return the 95 % intervals of the main areas, by name; empty for too few episodes."""
    pooled = protocol.ranks_frames_together
    found = {
        name: area_interval([part[name] for part in parts], pooled=pooled)
        for name in WITH_INTERVALS
        if name in parts[0]
    }
    return {name: [round(end, 6) for end in ends] for name, ends in found.items() if ends is not None}


def _ms(episodes: Sequence[Perceived]) -> dict[str, float]:
    """Return milliseconds a frame of the environment, by part."""
    frames = sum(each.frames for each in episodes)
    names = list(dict.fromkeys(name for each in episodes for name in each.ms))
    return {
        f"ms_{name}": round(sum(each.ms.get(name, 0.0) * each.frames for each in episodes) / max(frames, 1), 3)
        for name in names
    }


_ABOUT = ("policy", "environment", "noise", "delay_ms", "attacks")
_NUMBERS: dict[str, tuple[str, ...]] = {
    "coopsim": (
        "APBEV@0.5 5_returns", "APBEV@0.7 5_returns", "APBEV@0.5", "APBEV@0.7", "false_per_frame",
        "APBEV@0.3 people", "APBEV@0.5 others_only", "recall", "recall others_only", "AP3D@0.5", "AP3D@0.7",
        "backwards", "only_together",
    ),
    "opencood": ("APBEV@0.3", "APBEV@0.5", "APBEV@0.7"),
    "dair": ("AP3D@0.3", "AP3D@0.5", "AP3D@0.7", "APBEV@0.3", "APBEV@0.5", "APBEV@0.7"),
    "nuscenes": ("mAP", "mAP@0.5m", "mAP@1m", "mAP@2m", "mAP@4m"),
    "v2x-real": ("APBEV@0.5 Vehicle", "APBEV@0.5 Truck", "APBEV@0.5 Pedestrian", "mAPBEV@0.3", "mAPBEV@0.5"),
}  # fmt: skip
_COSTS = ("frames", "bytes_per_message", "ms_environment", "ms_uplink", "ms_policy")


def markdown_table(rows: Sequence[Mapping[str, Any]]) -> str:
    """Format rows of one protocol as a Markdown table, and below it the same boxes by the protocol beside it."""
    if not rows:
        return "no results"
    beside = _BESIDE.get(str(rows[0]["protocol"]), "")
    about = ("within_m", "bound", *_ABOUT)
    seconds = [
        {**{name: row.get(name) for name in about}, "protocol": beside, **row[beside]} for row in rows if beside in row
    ]
    return "\n\n".join(_table(each) for each in (rows, seconds) if each)


def _table(rows: Sequence[Mapping[str, Any]]) -> str:
    """Format rows of one protocol; columns in which no row has anything are left out."""
    protocol, within_m = str(rows[0]["protocol"]), rows[0].get("within_m")
    numbers = _NUMBERS.get(protocol, tuple(name for name in rows[0] if name.startswith(("AP", "mAP"))))
    shown = [name for name in (*_ABOUT, *numbers, *_COSTS) if any(row.get(name) is not None for row in rows)]
    cells = [[_with_interval(row, name) for name in shown] for row in rows]
    align = ["left" if name in _ABOUT else "right" for name in shown]
    table = tabulate(cells, headers=shown, tablefmt="github", colalign=align, disable_numparse=True)
    near = "" if within_m is None else f", within {within_m:g} m of the receiver"
    used = {row["arithmetic"] for row in rows if row.get("arithmetic")}
    computed = f", networks multiply in {' or '.join(sorted(used))}" if used else ""
    return f"protocol {protocol}{near}{computed}\n\n{table}"


def _cell(name: str, value: Any) -> str:
    if value is None:
        return "-"
    if isinstance(value, str):
        return value
    if name in ("frames", "bytes_per_message", "delay_ms"):
        return f"{value:,.0f}"
    return f"{value:.1f}" if name.startswith("ms_") else f"{value:.3f}"


def _with_interval(row: Mapping[str, Any], name: str) -> str:
    if name == "policy":
        return named(row[name], bound=row.get("bound", False))
    low_high = row.get("intervals", {}).get(name)
    return _cell(name, row.get(name)) + ("" if low_high is None else f" ({low_high[0]:.2f}-{low_high[1]:.2f})")


@dataclass(frozen=True, slots=True)
class DetectProgress(Progress):
    """Progress of a measurement: of its episodes, and the rows whose episodes are all there, in order."""

    rows: list[dict[str, Any]] = field(default_factory=list)


def measure_detection(
    plan: DetectPlan,
    *,
    folder: str | Path | None = None,
    check: bool = True,
    engine: Engine | None = None,
    on_progress: Callable[[DetectProgress], object] = lambda progress: None,
) -> list[dict[str, Any]]:
    """Run every episode of a plan that is not in the folder yet, and return the rows.

    The rows are the same for any number of processes, but for the times in them. A row whose policy raised in an
    episode is missing; `on_progress` was told.

    Args:
        plan: the plan.
        check: make every policy and environment before the first episode, see `DetectPlan.check`.
        folder: folder of finished episodes, made if need be; None: nothing is kept.
        engine: runs the episodes; None: processes of this machine, as many as cores.
        on_progress: called before the first episode and after each.

    Raises:
        CoopsimError: a name is unknown or a value is not accepted; the message says what is accepted.
    """
    if check:
        plan.check()
    table = _Table(plan)

    def show(progress: Progress) -> None:
        table.take(progress.results)
        known = {each.name: getattr(progress, each.name) for each in fields(progress)}
        on_progress(DetectProgress(**known, rows=table.rows))

    store = None if folder is None else Store(folder)
    run_jobs(list(table.jobs.values()), engine, store, on_progress=show)
    return table.rows


class _Table:
    """Rows that fill up as episodes come.

    Attributes:
        jobs: all jobs, by key.
    """

    def __init__(self, plan: DetectPlan) -> None:
        self._plan = plan
        self.jobs: dict[str, DetectJob] = {}
        self._keys: dict[tuple[str, Condition], list[str]] = {}
        self._measured: dict[str, Measured] = {}
        self._rows: dict[tuple[str, Condition], dict[str, Any]] = {}
        sources = Sources()
        for policy, condition in plan.rows():
            jobs = {job.key: job for job in plan.jobs_of(policy, condition, sources)}
            self.jobs |= jobs
            self._keys[policy, condition] = list(jobs)
            if len(plan.environments) > 1:
                whole = policy, Condition(EVERYWHERE, condition.settings)
                self._keys[whole] = [*self._keys.pop(whole, []), *jobs]  # it follows the rows that it pools

    @property
    def rows(self) -> list[dict[str, Any]]:
        """The complete rows; after those of all environments, the one that pools them."""
        return [self._rows[place] for place in self._keys if place in self._rows]

    def take(self, results: Mapping[str, CellResult]) -> None:
        """Take new episodes in, and make the rows that they complete."""
        for key in results.keys() - self._measured.keys():
            if not results[key].failed:
                perceived = Perceived.from_arrays(results[key].arrays)
                self._measured[key] = Measured.of(perceived, self._plan.protocol, self._plan.within_m)
        for place, keys in self._keys.items():
            if place not in self._rows and all(key in self._measured for key in keys):
                first = self.jobs[keys[0]]
                options = environment_options(replace(first.cell, frames=None), first.options)
                options = {name: value for name, value in options.items() if name != "threads"}
                self._rows[place] = row_of(self._plan, place, options, [self._measured[key] for key in keys])
