"""The two fixed runs of an entry: the warm-up, which anyone can repeat in seconds, and the run that ranks."""

from __future__ import annotations

import ctypes
import hashlib
import importlib
import json
import math
import os
import platform
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

import coopsim
from coopsim.bench.benchmark import benchmark
from coopsim.bench.engine.engine import Engine
from coopsim.bench.entries.entry_files import work_folder
from coopsim.bench.entries.entry_folder import OURS, EntryFolder
from coopsim.bench.entries.score_file import SAME, floats, read_scores, write_scores
from coopsim.bench.grid.cell import Cell, CellResult
from coopsim.bench.grid.grid import ATTRIBUTES, Grid
from coopsim.bench.grid.grid_file import find_grid
from coopsim.bench.grid.labels import label
from coopsim.bench.isolated.isolation import Isolation
from coopsim.bench.run_jobs import Progress
from coopsim.bench.store.packages import package_versions
from coopsim.errors import LeaderboardEntryError
from coopsim.metrics.built_in import BUILT_IN, BYTES
from coopsim.metrics.metric import PRIMARY_METRIC

if TYPE_CHECKING:
    from coopsim.agents.policy import Needs

SHOWN = (PRIMARY_METRIC, "HOTA", "AMOTA")
"""Metrics of the table, in per cent."""

TOLERANCE = 1e-6
"""Difference by which every metric of a repeated cell may be off, on whatever processor: on another one box policies
came out equal to 1e-12."""


@dataclass(frozen=True, slots=True)
class FixedRun:
    """A run that is the same for all entries.

    Attributes:
        preset: name of its grid.
        file: file of its scores in an entry's folder.
        command: command that makes them.
    """

    preset: str
    file: str
    command: str

    def grid(self, policy: str = "no_fusion", *, sweeps: bool = False) -> Grid:
        """Return the grid for a policy. One that reads `sweeps` gets those of the towns' own LiDAR."""
        grid = find_grid(self.preset, policies=(policy,)).grid()
        left = {name: value for name, value in grid.options.items() if not (sweeps and name == "lidar")}
        return replace(grid, options=left)

    @property
    def digest(self) -> str:
        """Digest of everything that is fixed, so that scores of an older run are known."""
        grid = self.grid()
        fixed = {name: getattr(grid, name) for name in ATTRIBUTES if name != "policies"}
        if not grid.axes:  # as before there were any
            del fixed["axes"]
        return hashlib.sha256(json.dumps(fixed, sort_keys=True, default=list).encode()).hexdigest()[:16]

    def cells(self, name: str) -> dict[str, Cell]:
        """Return the cells of an entry by their names in its file."""
        grid = self.grid()
        conditions = list(grid.conditions())
        cells = {f"{label(cell.condition, conditions)}, seed {cell.seed}": cell for cell in grid.cells()}
        return {text: replace(cell, policy=name) for text, cell in cells.items()}

    def measure(
        self,
        entry: EntryFolder,
        engine: Engine,
        isolation: Isolation,
        *,
        only: Sequence[str] | None = None,
        work: str = "",
        on_progress: Callable[[Progress], object] = lambda progress: None,
    ) -> tuple[dict[str, Any], dict[str, bool]]:
        """Run a copy of an entry, each agent in a process of its own.

        Args:
            entry: the entry.
            engine: runs the cells.
            isolation: separation of the policy from the world.
            only: names of the cells to run; None: all.
            work: key under which finished cells stay after an interruption, for the next call with it; empty: nowhere.
            on_progress: called before the first cell and after each.

        Returns:
            The scores with all that decided them, and which parts of the processes' confinement held.

        Raises:
            CoopsimError: the policy cannot be made, fails in a cell, or is told the truth.
        """
        with work_folder(work) as place:
            copy = entry.copy_to(place / "entry")
            code, packages = copy.code(), copy.packages()
            needs, confinement = needs_of(copy, isolation)
            grid = self.grid(copy.spec().text, sweeps=needs.lidar)
            named = dict(zip(self.cells(entry.name), grid.cells(), strict=True))
            chosen = list(named) if only is None else list(only)
            given: dict[str, Any] = {"engine": engine, "on_progress": on_progress, "retry_failed": True}
            apart, cells = replace(isolation, needs=needs), [named[name] for name in chosen]
            results = benchmark(grid, place / "runs", only=cells, isolation=apart, **given)
        for text, result in zip(chosen, results, strict=True):
            if result.failed:
                raise LeaderboardEntryError(f"policy {entry.policy!r} failed in {text}: {result.reason}")
        scores = {
            "policy": entry.policy,
            "reads": "sensors" if needs.lidar or needs.cameras else "boxes",
            "run": f"{self.preset} {self.digest}",
            "software": {OURS: coopsim.__version__, "Python": platform.python_version(), **package_versions()},
            "processor": processor(),
            "arithmetic": results[0].arithmetic,
            "code": code,
            "packages": packages,
            "cells": [
                {"cell": text, "place_seed": result.place_seed, "values": _plain(result.values, self.kept)}
                for text, result in zip(chosen, results, strict=True)
            ],
        }
        return scores, confinement

    @property
    def kept(self) -> Collection[str]:
        """Metrics in the file: of the warm-up all, as they show a difference."""
        return BUILT_IN if self is WARM_UP else (*SHOWN, BYTES)

    def write(self, folder: Path, scores: Mapping[str, Any]) -> Path:
        """Write scores into an entry's folder."""
        return write_scores(folder / self.file, scores)

    def read(self, entry: EntryFolder) -> dict[str, Any]:
        """Read the scores in an entry's folder, which the entry reports of itself.

        Raises:
            LeaderboardEntryError: there are none, or the file is broken.
        """
        path, remedy = entry.folder / self.file, f"run `coopsim entry {self.command} {entry.folder}`"
        if not os.path.lexists(path):
            raise LeaderboardEntryError(f"{self.file} is missing: {remedy}")
        try:
            return read_scores(path, self.kept, {})
        except LeaderboardEntryError as error:
            raise LeaderboardEntryError(f"{error}: {remedy}") from error

    def results(self, entry: EntryFolder, scores: Mapping[str, Any]) -> list[CellResult]:
        """Return scores as results of a policy of the entry's name."""
        return [
            CellResult(cell, floats(found["values"]), place_seed=found["place_seed"], arithmetic=scores["arithmetic"])
            for cell, found in zip(self.cells(entry.name).values(), scores["cells"], strict=True)
        ]


WARM_UP = FixedRun("warm_up", "warm_up.json", "warm-up")
SCORED = FixedRun("leaderboard", "scores.json", "score")


def needs_of(entry: EntryFolder, isolation: Isolation) -> tuple[Needs, dict[str, bool]]:
    """Return what an entry's policy needs, asked once in a process of its own, and how that process is confined.

    Raises:
        CoopsimError: it cannot be made, or is told the truth.
    """
    with isolation.policy(entry.spec()) as policy:
        return policy.needs, getattr(policy, "confinement", {})


def differences(file: str, stored: Mapping[str, Any], fresh: Mapping[str, Any]) -> Iterator[str]:
    """Yield a line for each repeated cell in which any metric came out otherwise, by more than `TOLERANCE`.

    What a file says of the processor that made it widens nothing.
    """
    if stored["reads"] != fresh["reads"]:
        yield f"{file} says that the policy reads {stored['reads']}, and it reads {fresh['reads']}"
    others = [f"{key} {stored[key]!r:.80}" for key in SAME if stored[key] != fresh[key]]
    elsewhere = f"; not comparable here, as it says that it was made elsewhere ({', '.join(others)})" if others else ""
    before = {cell["cell"]: cell for cell in stored["cells"]}
    for new in fresh["cells"]:
        old = before[new["cell"]]
        told, came = ({**each["values"], "place_seed": each["place_seed"]} for each in (old, new))
        names = sorted(told.keys() | came.keys(), key=lambda name: (name not in SHOWN, name))
        wrong = [name for name in names if not _alike(told.get(name), came.get(name))]
        if wrong:
            name, more = wrong[0], f", as do {len(wrong) - 1} other metrics" if len(wrong) > 1 else ""
            values = f"{name} is {told.get(name)} there and {came.get(name)} here"
            yield f"{file} differs in {new['cell']}: {values}{more}{elsewhere}"


def mean_of(scores: Mapping[str, Any]) -> str:
    """Return the means of the table's metrics over all cells, in words."""
    found = {name: [cell["values"][name] for cell in scores["cells"]] for name in SHOWN}
    means = {name: float(np.mean(values)) for name, values in found.items() if None not in values}
    return ", ".join(f"{name} {mean:.1f}" for name, mean in means.items()) or "no scores"


def processor() -> str:
    """Return the kind of this processor, which decides last bits: LLVM's name, numpy's SIMD, and BLAS's kernels."""
    binding: Any = importlib.import_module("llvmlite.binding")  # numba's, without types
    configuration: Any = np.show_config(mode="dicts")
    simd = configuration["SIMD Extensions"].get("found", [])
    return " ".join([platform.machine(), binding.get_host_cpu_name(), *simd, *_blas_kernels()])


def _blas_kernels() -> list[str]:
    """Return the name of the kernels that numpy's own OpenBLAS has chosen; nothing for another BLAS."""
    for path in Path(np.__file__).parents[1].glob("numpy.libs/*openblas*"):
        library = ctypes.CDLL(str(path))
        for name in ("scipy_openblas_get_corename64_", "scipy_openblas_get_corename"):
            if hasattr(library, name):
                ask = getattr(library, name)
                ask.restype = ctypes.c_char_p
                return [f"OpenBLAS {ask().decode()}"]
    return []


def _alike(before: float | None, now: float | None) -> bool:
    if before is None or now is None:
        return before is now
    return abs(before - now) <= TOLERANCE


def _plain(values: Mapping[str, float], kept: Collection[str]) -> dict[str, float | None]:
    """Return the values to keep as JSON has them: what is undefined is None."""
    return {name: None if math.isnan(values[name]) else values[name] for name in kept if name in values}
