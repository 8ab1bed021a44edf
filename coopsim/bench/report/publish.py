"""The files of a benchmark that people read."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from coopsim.bench.films.choice import Films
from coopsim.bench.films.crash_pairs import CRASH, filmed_pairs, telling_pairs
from coopsim.bench.films.lie_pairs import filmed_lies, lie_pairs
from coopsim.bench.films.moments import filmed_moments, worst_windows
from coopsim.bench.grid.axis import NOBODY_LIES
from coopsim.bench.grid.cell import CellResult
from coopsim.bench.grid.grid import LISTS
from coopsim.bench.paper.protocol_text import protocol_text
from coopsim.bench.paper.provenance import Provenance
from coopsim.bench.paper.tables import interval_csv, latex_tables
from coopsim.bench.paper.trade_off_plot import trade_off
from coopsim.bench.report import crash_figures, lie_figures, moment_figures
from coopsim.bench.report.answer import answer_of
from coopsim.bench.report.bench_plots import plots
from coopsim.bench.report.bench_report import About, Played, title_of_report, write_bench_report
from coopsim.bench.report.film_section import FilmSection
from coopsim.bench.report.keys import SCENE
from coopsim.bench.results.result_table import ResultTable
from coopsim.bench.safety.safety_text import to_safety_markdown
from coopsim.bench.text.bench_text import to_csv, to_markdown
from coopsim.bench.text.lies_text import to_lies_markdown
from coopsim.errors import InvalidValueError, UnknownNameError
from coopsim.metrics.built_in import BYTES
from coopsim.metrics.metric import PRIMARY_METRIC
from coopsim.support.checks import require_count
from coopsim.support.files import make_folder, write_whole

_MACHINE = ("processor", "platform")
"""Names of what runs note of their machine."""

_UNITS: Mapping[str, str] = {"_ms": "ms", "_mbit_s": "Mbit/s", "_deg": "deg", "_m": "m"}
"""Units by the endings of names."""


def publish(
    folder: str | Path,
    results: Sequence[CellResult],
    provenance: Provenance | None = None,
    *,
    circumstances: Sequence[Mapping[str, Any]] = (),
    title: str = "",
    metrics: Sequence[str] = (),
    clips: int = 5,
    with_plots: bool = False,
    pairs: int = 10,
    on_note: Callable[[str], object] = lambda note: None,
) -> tuple[Path, ...]:
    """Write `report.html`, `report.md` and `results.csv`, the files for papers, and plots as SVG files if asked for.

    Where agents lied, `lies.md` is written, too. Where cars were driven, `safety.md` and figures of crash rates are,
    and the report has telling pairs in place of the worst moments. Nothing is run: clips are of the films that the
    runs kept. Equal results with equal films and circumstances give equal files. Return the paths.

    Args:
        folder: folder of the files, made if need be.
        results: results of every cell, failed ones included.
        provenance: provenance of the results' grid.
        circumstances: notes on each run, for its date and machine in the report (`Store.all_circumstances`).
        title: title of the report; empty: the question that the benchmark asks.
        metrics: metrics of `report.md`, whose leaderboard is by the first one, and of the files for papers.
        clips: largest number of clips of the worst moments, and of pairs with a lie.
        with_plots: write `plots/METRIC_AXIS.svg`, for every metric of the report and every axis that varies.
        pairs: largest number of telling pairs; without clips there are none.
        on_note: called with a line on each film that is missing or broken.

    Raises:
        InvalidValueError: there are no results, they do not fit together, or a file cannot be written, as where a link
            or a metric's name leads out of the folder.
        UnknownNameError: the results have no such metric.
    """
    require_count(0, clips=clips, pairs=pairs)
    table, folder, origin = ResultTable.of(results, metrics), Path(folder), provenance or Provenance()
    about, answer = _about(origin, title, circumstances), answer_of(table)
    heading, verdict = title_of_report(title, answer), answer.verdict if answer else ""
    contents = {
        folder / "report.md": to_markdown(table, heading, metrics, verdict),
        folder / "results.csv": to_csv(table),
    }
    contents |= {folder / name: text for name, text in paper_files(table, origin, metrics).items()}
    if with_plots:
        for metric in table.shown:
            contents |= {folder / "plots" / name: text for name, text in plots(table, metric).items()}
    if any(each.attacks for each in table.conditions) and PRIMARY_METRIC in table.metrics:
        contents |= {folder / "lies.md": to_lies_markdown(table)}
    if CRASH in table.metrics:
        contents |= {folder / "safety.md": to_safety_markdown(table)}
        figures = plots(table, CRASH, together=True)
        figures |= {f"{CRASH}_over_bytes.svg": trade_off(table, CRASH, origin.sends)} if BYTES in table.metrics else {}
        contents |= {folder / "plots" / name: text for name, text in figures.items()}
    report = folder / "report.html"
    _require_within(folder, (report, *contents))
    for parent in {path.parent for path in contents}:
        make_folder(parent)
    salted = "salt" in origin.isolation  # films would show what the salt keeps secret
    played = played_films(table, metrics, clips, pairs) if clips and not salted else Played()
    for note in played.notes:
        on_note(note)
    write_bench_report(report, table, about, played)
    return (report, *(write_whole(path, text) for path, text in contents.items()))


def played_films(table: ResultTable, metrics: Sequence[str], clips: int, pairs: int) -> Played:
    """Choose what a report plays among the runs that were filmed, and read their films; arguments as of `publish`."""
    competing = [each for each in table.results if not (each.failed or each.bound)]
    kept, films = [each for each in competing if each.film is not None], Films()
    several = len({each.cell.policy for each in competing}) > 1 or any(each.attacks for each in table.conditions)
    if not kept or not several:
        return Played(notes=[_missing(len(competing), len(competing))] if several and competing else ())
    filmed = ResultTable.of(kept, metrics)
    lies = [lie_figures.lie_figure(each, table) for each in filmed_lies(lie_pairs(filmed, clips), films)]
    sections = [FilmSection("Lies", lie_figures.NOTE, lie_figures.KEYS, lies)]
    if CRASH in table.metrics:
        crashes = filmed_pairs(telling_pairs(filmed, pairs), films)
        figures = [crash_figures.crash_figure(each, table) for each in crashes]
        sections.append(FilmSection("Without and with messages", crash_figures.NOTE, crash_figures.KEYS, figures))
    else:
        moments = filmed_moments(worst_windows(filmed, clips), films)
        figures = [moment_figures.moment_figure(each, table) for each in moments]
        sections.append(FilmSection("Worst moments", moment_figures.NOTE, SCENE, figures))
    unfilmed = len(competing) - len(kept)
    return Played(sections, [*films.notes, *([_missing(unfilmed, len(competing))] if unfilmed else [])])


def _missing(count: int, of: int) -> str:
    some = "no run has a film, so there are no clips" if count == of else f"{count} of {of} runs have no film"
    return f"{some}: `coopsim bench` of the same grid with --retry-unfilmed runs them again"


def _about(provenance: Provenance, title: str, circumstances: Sequence[Mapping[str, Any]]) -> About:
    """Describe a grid for its report: its lists and options, versions, and when and where it ran."""
    grid, software = provenance.grid, provenance.software
    lists = {name: grid[name] for name in LISTS if grid.get(name, [None]) != [None]}
    settings = {_with_unit(name): ", ".join(map(_short, values)) for name, values in lists.items()}
    settings |= {name: str(grid[name]) for name in ("vary", "frames") if grid.get(name) is not None}
    settings |= {option: ", ".join(map(_short, values)) for option, values in grid.get("axes", {}).items()}
    settings |= {name: "none" if value is None else str(value) for name, value in grid.get("options", {}).items()}
    if software:
        settings["versions"] = ", ".join(f"{name} {number}" for name, number in software.items())
    settings |= {"commit": provenance.commit} if provenance.commit else {}
    ran = _ran(circumstances)
    return About(title, provenance.command, settings | ran, ran.get("date", ""))


def _ran(circumstances: Sequence[Mapping[str, Any]]) -> dict[str, str]:
    """Say on which days and machines runs ended, as far as they noted it."""
    days = sorted({str(each["ended"])[:10] for each in circumstances if "ended" in each})
    machines = {", ".join(str(each[name]) for name in _MACHINE if name in each) for each in circumstances}
    known = sorted(machines - {""})
    return {
        **({"date": " to ".join(dict.fromkeys((days[0], days[-1])))} if days else {}),
        **({"machine": "; ".join(known)} if known else {}),
    }


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
