"""The files of a benchmark that people read."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from coopsim.bench.engine.job import Job, run_job
from coopsim.bench.grid.axis import NOBODY_LIES
from coopsim.bench.grid.cell import Cell, CellResult
from coopsim.bench.grid.grid import LISTS
from coopsim.bench.isolated.isolation import FRAME_LIMIT_S, Isolation
from coopsim.bench.paper.protocol_text import protocol_text
from coopsim.bench.paper.provenance import Provenance
from coopsim.bench.paper.tables import interval_csv, latex_tables
from coopsim.bench.paper.trade_off_plot import trade_off
from coopsim.bench.report.bench_plots import plots
from coopsim.bench.report.bench_report import About, Played, write_bench_report
from coopsim.bench.report.bench_text import to_csv, to_markdown
from coopsim.bench.report.clips import RunCell, film
from coopsim.bench.report.lie_pairs import film_lies, lie_pairs
from coopsim.bench.report.lies_text import to_lies_markdown
from coopsim.bench.results.result_table import ResultTable
from coopsim.bench.results.standings import worst_windows
from coopsim.bench.safety.pairs import CRASH, film_pairs, telling_pairs
from coopsim.bench.safety.safety_plots import crash_plots
from coopsim.bench.safety.safety_text import to_safety_markdown
from coopsim.catalog import PolicySpec, refuse_writing
from coopsim.episode import Recorder
from coopsim.errors import CoopsimError, InvalidValueError, UnknownNameError
from coopsim.metrics.built_in import BYTES
from coopsim.metrics.metric import PRIMARY_METRIC
from coopsim.support.checks import require_count, require_non_negative
from coopsim.support.files import make_folder, write_whole
from coopsim.support.user_code import code_in

_UNITS: Mapping[str, str] = {"_ms": "ms", "_mbit_s": "Mbit/s", "_deg": "deg", "_m": "m"}
"""Units by the endings of names."""


def publish(
    folder: str | Path,
    results: Sequence[CellResult],
    provenance: Provenance | None = None,
    *,
    title: str = "coopsim bench",
    metrics: Sequence[str] = (),
    clips: int = 5,
    clip_time_s: float = 120.0,
    with_plots: bool = False,
    trust: bool = False,
    pairs: int = 10,
) -> tuple[Path, ...]:
    """Write `report.html`, `report.md` and `results.csv`, the files for papers, and plots as SVG files if asked for.

    Where agents lied, `lies.md` is written, too. Where cars were driven, `safety.md` and figures of crash rates are,
    and the report has telling pairs in place of the worst moments. Equal results give equal files, unless the time for
    clips runs out, which the report then says. Return the paths.

    Args:
        folder: folder of the files, made if need be.
        results: results of every cell, failed ones included.
        provenance: provenance of the results' grid; its options are needed to repeat the worst moments.
        title: title of the report.
        metrics: metrics of `report.md`, whose leaderboard is by the first one, and of the files for papers.
        clips: largest number of clips of the worst moments, and of pairs with a lie; 0: nothing is run.
        clip_time_s: time after which no further clip of a kind is begun.
        with_plots: write `plots/METRIC_AXIS.svg`, for every metric of the report and every axis that varies.
        trust: run policies again that the results name as `module:Class` or `file.py:Class`; False: they have no clips.
        pairs: largest number of telling pairs; 0, or no clips: nothing is run.

    Raises:
        InvalidValueError: there are no results, they do not fit together, or a file cannot be written, as where a link
            or a metric's name leads out of the folder.
        UnknownNameError: the results have no such metric.
    """
    require_count(0, clips=clips, pairs=pairs)
    require_non_negative(clip_time_s=clip_time_s)
    table, folder, origin = ResultTable.of(results, metrics), Path(folder), provenance or Provenance()
    about = _about(origin, title)
    contents = {folder / "report.md": to_markdown(table, title, metrics), folder / "results.csv": to_csv(table)}
    contents |= {folder / name: text for name, text in paper_files(table, origin, metrics).items()}
    if with_plots:
        for metric in table.shown:
            contents |= {folder / "plots" / name: text for name, text in plots(table, metric).items()}
    if any(each.attacks for each in table.conditions) and PRIMARY_METRIC in table.metrics:
        contents |= {folder / "lies.md": to_lies_markdown(table)}
    driven = CRASH in table.metrics
    if driven:
        contents |= {folder / "safety.md": to_safety_markdown(table)}
        contents |= {folder / "plots" / name: text for name, text in crash_plots(table).items()}
    report = folder / "report.html"
    _require_within(folder, (report, *contents))
    for parent in {path.parent for path in contents}:
        make_folder(parent)
    written = [write_whole(path, text) for path, text in contents.items()]
    write_bench_report(report, table, about)  # complete, even if the clips are interrupted
    isolation = origin.isolation
    if clips and "salt" not in isolation:  # without the salt, nobody can make the same episodes
        rerun = make_rerun(origin.grid.get("options", {}), isolation, trust=trust)
        lies, lie_notes = film_lies(lie_pairs(table, clips), rerun, clip_time_s)
        if driven:
            filmed, notes = film_pairs(telling_pairs(table, pairs), rerun, clip_time_s)
            played = Played(pairs=filmed, notes=notes, lies=lies, lie_notes=lie_notes)
        else:
            shown, missing = film(worst_windows(table, clips), rerun, clip_time_s)
            played = Played(shown, notes=missing, lies=lies, lie_notes=lie_notes)
        write_bench_report(report, table, about, played)
    return (report, *written)


def _about(provenance: Provenance, title: str) -> About:
    """Describe a grid for its report: its lists and options, and versions."""
    grid, software = provenance.grid, provenance.software
    lists = {name: grid[name] for name in LISTS if grid.get(name, [None]) != [None]}
    settings = {_with_unit(name): ", ".join(map(_short, values)) for name, values in lists.items()}
    settings |= {name: str(grid[name]) for name in ("vary", "frames") if grid.get(name) is not None}
    settings |= {option: ", ".join(map(_short, values)) for option, values in grid.get("axes", {}).items()}
    settings |= {name: str(value) for name, value in grid.get("options", {}).items()}
    if software:
        settings["versions"] = ", ".join(f"{name} {number}" for name, number in software.items())
    return About(title, provenance.command, settings)


def _with_unit(name: str) -> str:
    """Spell the name of a list for people: `latencies_ms` becomes "latencies (ms)"."""
    end, unit = next(((end, unit) for end, unit in _UNITS.items() if name.endswith(end)), ("", ""))
    return name.removesuffix(end).replace("_", " ") + f" ({unit})" * bool(unit)


def _short(value: object) -> str:
    if value is None:
        return "the environment's own"
    if value == math.inf:
        return "no limit"
    if value == "":
        return NOBODY_LIES  # of all lists only that of attacks has empty texts
    return f"{value:g}" if isinstance(value, float) else str(value)


def _require_within(folder: Path, paths: Iterable[Path]) -> None:
    """Refuse paths that lead out of a folder, which may be a stranger's: by links in it, or by names of metrics."""
    whole = folder.resolve()
    for path in paths:
        if not path.resolve().is_relative_to(whole):
            raise InvalidValueError(f"cannot write {path}: it leads out of {folder}, to {path.resolve()}")


def make_rerun(
    options: Mapping[str, Any], isolation: Mapping[str, Any] | None = None, *, trust: bool = False
) -> RunCell:
    """Return a function that runs a cell as the benchmark does, and tells recorders of it.

    `options` of the environments and `isolation` of the policies are those in the results' folder; `trust` lets it run
    code that the cell and the options name: a policy, planner, attack or defence.
    """

    def run(cell: Cell, *recorders: Recorder) -> CellResult:
        try:
            condition = cell.condition
            code = code_in([cell.policy, list(condition.settings), condition.scenario, dict(options)])
            if code is not None and not trust:
                raise InvalidValueError(f"it names code, {code!r}, which is run only with --trust")
            refuse_writing(options, "the results' options")
            apart = Isolation(FRAME_LIMIT_S if isolation else None)
            job = Job.of(cell, options, PolicySpec.parse(cell.policy), isolation=apart)
        except CoopsimError as error:  # the cell's policy or files are gone, or not trusted
            return CellResult(cell, traceback=str(error))
        return run_job(job, recorders).result

    return run


METRICS = (PRIMARY_METRIC, "AMOTA", "AMOTP", "HOTA", "IDS")
"""The metrics of the tables; the first one is that of the figure and of the tables by axis."""


def paper_files(table: ResultTable, provenance: Provenance, metrics: Sequence[str] = ()) -> dict[str, str]:
    """Return the files for papers by name: `protocol.txt`, `intervals.csv`, `tables/*.tex`, and the figure.

    The figure is `plots/METRIC_over_bytes.svg`, where bytes were counted. Without any value there is the protocol
    alone. `metrics` are by default those of `METRICS` that the results have, or else all that reports show.

    Raises:
        UnknownNameError: the results have no such metric.
    """
    for name in metrics:
        if name not in table.metrics or name == BYTES:
            raise UnknownNameError("metric", name, table.shown)
    chosen = tuple(metrics) or tuple(name for name in METRICS if name in table.metrics) or table.shown
    files = {"protocol.txt": protocol_text(table, provenance, chosen)}
    if not chosen:
        return files
    files["intervals.csv"] = interval_csv(table, chosen)
    files |= {f"tables/{name}": text for name, text in latex_tables(table, chosen).items()}
    if BYTES in table.metrics:
        files[f"plots/{chosen[0]}_over_bytes.svg"] = trade_off(table, chosen[0], provenance.sends)
    return files
