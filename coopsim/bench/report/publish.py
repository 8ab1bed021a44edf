"""The files of a benchmark that people read."""

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
"""Units by the endings of names."""


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
    """Write `report.html`, `report.md` and `results.csv`, and plots as SVG files if asked for.

    Equal results give equal files, unless the time for clips runs out, which the report then says.

    Args:
        folder: of the files; it is made if need be.
        results: of every cell, those of failed ones included.
        about: title, command and settings.
        options: of the cells' environments (`Grid.options`), to repeat the worst moments.
        clips: largest number of clips of the worst moments; 0: nothing is run.
        clip_time_s: no further clip is begun after this time.
        with_plots: write `plots/METRIC_AXIS.svg`, for every metric of the report and every axis that varies.

    Returns:
        The paths of the files.

    Raises:
        InvalidValueError: there are no results, they do not fit together, or a file cannot be written.
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
    report = write_bench_report(folder / "report.html", table, about)  # complete, even if the clips are interrupted
    if clips:
        shown, notes = film(worst_moments(table, clips), make_rerun(options or {}), clip_time_s)
        write_bench_report(report, table, about, shown, notes)
    return (report, *written)


def about(grid: Grid, command: str, title: str = "coopsim bench") -> About:
    """Describe a grid for its report: its lists and options, and versions.

    Args:
        grid: the grid.
        command: reproduces the results.
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
    """Spell the name of a list for people: `latencies_ms` becomes "latencies (ms)"."""
    end, unit = next(((end, unit) for end, unit in _UNITS.items() if name.endswith(end)), ("", ""))
    return name.removesuffix(end).replace("_", " ") + f" ({unit})" * bool(unit)


def _short(value: object) -> str:
    if value == math.inf:
        return "no limit"
    return f"{value:g}" if isinstance(value, float) else str(value)


def make_rerun(options: Mapping[str, Any]) -> RunCell:
    """Return a function that runs a cell as the benchmark does, and calls another after every frame."""

    def run(cell: Cell, on_frame: OnFrame) -> CellResult:
        try:
            job = Job.of(cell, options, PolicySpec.parse(cell.policy))
        except CoopsimError as error:  # the cell's policy or files are gone
            return CellResult(cell, traceback=str(error))
        return run_job(job, on_frame).result

    return run
