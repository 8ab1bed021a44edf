"""From results to the files that people read."""

from __future__ import annotations

import math
import platform
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import coopsim
from coopsim.bench.engine.job import Job, run_job
from coopsim.bench.evaluate import OnFrame
from coopsim.bench.grid.cell import Cell, CellResult
from coopsim.bench.grid.grid import LISTS, Grid
from coopsim.bench.policy_spec import PolicySpec
from coopsim.bench.report.bench_plots import plots
from coopsim.bench.report.bench_report import About, write_bench_report
from coopsim.bench.report.bench_text import to_csv, to_markdown
from coopsim.bench.report.clips import RunCell, film
from coopsim.bench.results.moments import worst_moments
from coopsim.bench.results.result_table import ResultTable
from coopsim.bench.store.fingerprint import package_versions
from coopsim.errors import CoopsimError
from coopsim.support.checks import require_count, require_non_negative
from coopsim.support.files import make_folder, write_whole

_UNITS: Mapping[str, str] = {"_ms": "ms", "_mbit_s": "Mbit/s", "_deg": "deg", "_m": "m"}
"""By the ends of names."""


def publish(
    folder: str | Path,
    results: Sequence[CellResult],
    about: About,
    *,
    options: Mapping[str, Any] | None = None,
    clips: int = 5,
    clip_time_s: float = 120.0,
    with_plots: bool = False,
) -> tuple[Path, ...]:
    """Write `report.html`, `report.md` and `results.csv`, and on demand plots as SVG files.

    The same results give the same files, unless the time for clips runs out, which the report then says.

    Args:
        folder: where to; it is made if need be.
        results: of every cell, those of failed ones included.
        about: what the report says beside them.
        options: of the environments, as the cells were run with (`Grid.options`), to run the worst moments again.
        clips: of the worst moments, at most; 0: none, and nothing is run.
        clip_time_s: after that long no further clip is begun.
        with_plots: write `plots/METRIC_AXIS.svg`, for every metric of the report and every axis that varies.

    Returns:
        What was written.

    Raises:
        InvalidValueError: there are no results, or they do not fit together, or a file cannot be written.
    """
    require_count(0, clips=clips)
    require_non_negative(clip_time_s=clip_time_s)
    table, folder = ResultTable.of(results), Path(folder)
    contents = {folder / "report.md": to_markdown(table, about.title), folder / "results.csv": to_csv(table)}
    if with_plots:
        for metric in table.shown:
            contents |= {folder / "plots" / name: text for name, text in plots(table, metric).items()}
    for parent in {path.parent for path in contents}:
        make_folder(parent)
    written = [write_whole(path, text) for path, text in contents.items()]
    report = write_bench_report(folder / "report.html", table, about)  # there, whatever interrupts the filming
    if clips:
        shown, notes = film(worst_moments(table, clips), again(options or {}), clip_time_s)
        write_bench_report(report, table, about, shown, notes)
    return (report, *written)


def about(grid: Grid, command: str, title: str = "coopsim bench") -> About:
    """What a report says of a grid: everything that it is made of, and versions.

    Args:
        grid: what was run.
        command: which runs it again.
        title: of the report.
    """
    lists = {_with_unit(name): ", ".join(map(_short, getattr(grid, name))) for name in LISTS}
    settings = {
        **lists,
        "frames": str(grid.frames),
        **{name: str(value) for name, value in grid.options.items()},
        "versions": ", ".join(
            [f"coopsim {coopsim.__version__}", f"Python {platform.python_version()}"]
            + [f"{name} {number}" for name, number in package_versions().items()]
        ),
    }
    return About(title, command, settings)


def _with_unit(name: str) -> str:
    """A list of the grid as people write it: `latencies_ms` is "latencies (ms)"."""
    end, unit = next(((end, unit) for end, unit in _UNITS.items() if name.endswith(end)), ("", ""))
    return name.removesuffix(end).replace("_", " ") + f" ({unit})" * bool(unit)


def _short(value: object) -> str:
    if value == math.inf:
        return "no limit"
    return f"{value:g}" if isinstance(value, float) else str(value)


def again(options: Mapping[str, Any]) -> RunCell:
    """Runs a cell as the benchmark does, and calls back after every frame (see `clips.RunCell`)."""

    def run(cell: Cell, on_frame: OnFrame) -> CellResult:
        try:
            job = Job.of(cell, options, PolicySpec.parse(cell.policy))
        except CoopsimError as error:  # what the cell was run with is not there any more
            return CellResult(cell, traceback=str(error))
        return run_job(job, on_frame).result

    return run
