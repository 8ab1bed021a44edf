"""The two fixed runs of an entry: the warm-up, which anyone can repeat in seconds, and the run that ranks."""

from __future__ import annotations

import hashlib
import importlib
import json
import math
import platform
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

import coopsim
from coopsim.bench.benchmark import Progress, benchmark
from coopsim.bench.engine.engine import Engine
from coopsim.bench.entries.entry_folder import OURS, EntryFolder
from coopsim.bench.grid.cell import Cell, CellResult, label
from coopsim.bench.grid.grid import ATTRIBUTES, Grid
from coopsim.bench.grid.grid_file import find_grid
from coopsim.bench.isolated.isolation import Isolation
from coopsim.bench.store.fingerprint import package_versions
from coopsim.errors import LeaderboardEntryError
from coopsim.metrics.built_in import BUILT_IN, BYTES
from coopsim.metrics.metric import PRIMARY_METRIC
from coopsim.support.files import write_whole

if TYPE_CHECKING:
    from coopsim.agents.policy import Needs

SHOWN = (PRIMARY_METRIC, "HOTA", "AMOTA")
"""Metrics of the table, in per cent."""

TOLERANCE = 1.0
"""Points by which these may differ on another processor or with other versions. There box policies came out equal to
1e-12, and a network in bfloat16 instead of float32 within this (`docs/learn/enter_the_leaderboard.md`)."""

_SAME = ("software", "processor", "arithmetic")
_KEYS = ("policy", "reads", "run", *_SAME, "code", "cells")


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
        store: Path,
        engine: Engine,
        isolation: Isolation,
        on_progress: Callable[[Progress], object] = lambda progress: None,
    ) -> dict[str, Any]:
        """Run an entry's policy, and return its scores with all that decided them.

        Finished cells stay in the folder `store`, so the same call goes on after an interruption.

        Raises:
            CoopsimError: the policy cannot be made, fails in a cell, or is told the truth.
        """
        code, needs = entry.code(), needs_of(entry, isolation)
        grid = self.grid(entry.spec().text, sweeps=needs.lidar)
        given: dict[str, Any] = {"engine": engine, "isolation": isolation, "on_progress": on_progress}
        results = benchmark(grid, store, retry_failed=True, **given)
        cells = dict(zip(self.cells(entry.name), results, strict=True))
        for text, result in cells.items():
            if result.failed:
                raise LeaderboardEntryError(f"policy {entry.policy!r} failed in {text}: {result.reason}")
        return {
            "policy": entry.policy,
            "reads": "sensors" if needs.lidar or needs.cameras else "boxes",
            "run": f"{self.preset} {self.digest}",
            "software": {OURS: coopsim.__version__, "Python": platform.python_version(), **package_versions()},
            "processor": processor(),
            "arithmetic": results[0].arithmetic,
            "code": code,
            "cells": [
                {"cell": text, "place_seed": result.place_seed, "values": _plain(result.values, self.kept)}
                for text, result in cells.items()
            ],
        }

    @property
    def kept(self) -> tuple[str, ...]:
        """Metrics in the file: of the warm-up all, as they show a difference."""
        return tuple(BUILT_IN) if self is WARM_UP else (*SHOWN, BYTES)

    def write(self, folder: Path, scores: Mapping[str, Any]) -> Path:
        """Write scores into an entry's folder, a line for each cell."""
        lines = ",\n    ".join(json.dumps(cell, ensure_ascii=False) for cell in scores["cells"])
        text = json.dumps({**scores, "cells": []}, indent=2)
        return write_whole(folder / self.file, text.replace('"cells": []', f'"cells": [\n    {lines}\n  ]') + "\n")

    def read(self, entry: EntryFolder) -> dict[str, Any]:
        """Read the scores in an entry's folder.

        Raises:
            LeaderboardEntryError: there are none, or the file is broken.
        """
        path = entry.folder / self.file
        remedy = f"run `coopsim entry {self.command} {entry.folder}`"
        if not path.is_file():
            raise LeaderboardEntryError(f"{self.file} is missing: {remedy}")
        try:
            scores = json.loads(path.read_text(encoding="utf-8"))
            complete = all(key in scores for key in _KEYS) and all(map(_is_cell, scores["cells"]))
        except (OSError, ValueError, TypeError):
            complete = False
        if not complete:
            raise LeaderboardEntryError(f"{self.file} is broken: {remedy}")
        return dict(scores)

    def results(self, entry: EntryFolder, scores: Mapping[str, Any]) -> list[CellResult]:
        """Return scores as results of a policy of the entry's name."""
        return [
            CellResult(cell, _floats(found["values"]), place_seed=found["place_seed"], arithmetic=scores["arithmetic"])
            for cell, found in zip(self.cells(entry.name).values(), scores["cells"], strict=True)
        ]


WARM_UP = FixedRun("warm_up", "warm_up.json", "warm-up")
SCORED = FixedRun("leaderboard", "scores.json", "score")


def needs_of(entry: EntryFolder, isolation: Isolation) -> Needs:
    """Return what an entry's policy needs. Raises `CoopsimError` if it cannot be made, or is told the truth."""
    with isolation.described(entry.spec()) as policy:
        if policy.needs.truth:
            raise LeaderboardEntryError(f"policy {entry.policy!r} is told the truth: a bound, which does not compete")
        return policy.needs


def differences(file: str, stored: Mapping[str, Any], fresh: Mapping[str, Any]) -> Iterator[str]:
    """Yield a line for each cell in which scores came out otherwise.

    With the same versions on the same kind of processor all values must be equal to the bit; else those of `SHOWN`
    within `TOLERANCE`.
    """
    same = all(stored[key] == fresh[key] for key in _SAME)
    if stored["reads"] != fresh["reads"]:
        yield f"{file} says that the policy reads {stored['reads']}, and it reads {fresh['reads']}"
    for old, new in zip(stored["cells"], fresh["cells"], strict=True):
        before, now = old["values"], new["values"]
        names = sorted(before.keys() | now.keys(), key=lambda name: (name not in SHOWN, name)) if same else SHOWN
        wrong = [name for name in names if not _alike(before.get(name), now.get(name), 0.0 if same else TOLERANCE)]
        if wrong or old["place_seed"] != new["place_seed"]:
            name = wrong[0] if wrong else "place_seed"
            values = {**before, "place_seed": old["place_seed"]}, {**now, "place_seed": new["place_seed"]}
            others = f", as do {len(wrong) - 1} other metrics" if len(wrong) > 1 else ""
            elsewhere = "" if same else "; it was made on another processor or with other versions"
            told, came = (each.get(name) for each in values)
            yield f"{file} differs in {old['cell']}: {name} is {told} there and {came} here{others}{elsewhere}"


def mean_of(scores: Mapping[str, Any]) -> str:
    """Return the means of the table's metrics over all cells, in words."""
    found = {name: [cell["values"][name] for cell in scores["cells"]] for name in SHOWN}
    means = {name: float(np.mean(values)) for name, values in found.items() if None not in values}
    return ", ".join(f"{name} {mean:.1f}" for name, mean in means.items()) or "no scores"


def processor() -> str:
    """Return the kind of this processor, which decides last bits of numbers: LLVM's name of it, and numpy's SIMD."""
    binding: Any = importlib.import_module("llvmlite.binding")  # numba's, without types
    configuration: Any = np.show_config(mode="dicts")
    simd = configuration["SIMD Extensions"].get("found", [])
    return " ".join([platform.machine(), binding.get_host_cpu_name(), *simd])


def _alike(before: float | None, now: float | None, tolerance: float) -> bool:
    if before is None or now is None:
        return before is now
    return before == now or abs(before - now) <= tolerance


def _plain(values: Mapping[str, float], kept: tuple[str, ...]) -> dict[str, float | None]:
    """Return the values to keep as JSON has them: what is undefined is None."""
    return {name: None if math.isnan(values[name]) else values[name] for name in kept if name in values}


def _floats(values: Mapping[str, float | None]) -> dict[str, float]:
    return {name: math.nan if value is None else value for name, value in values.items()}


def _is_cell(cell: Any) -> bool:
    numbers = all(each is None or isinstance(each, (int, float)) for each in cell["values"].values())
    return isinstance(cell["cell"], str) and isinstance(cell["place_seed"], (int, type(None))) and numbers
