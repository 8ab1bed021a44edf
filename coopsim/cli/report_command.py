"""`coopsim report`."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path

from coopsim.bench.grid.cell import CellResult
from coopsim.cli.arguments import count_or_zero, names, stored_results

HELP = "write the report, tables and figures of a benchmark's folder again, finished or not"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    parser.add_argument("out", type=Path, metavar="FOLDER", help="of `coopsim bench`")
    trust = "run policies again that the results name as module:Class or file.py:Class, for clips"
    parser.add_argument("--trust", action="store_true", help=trust)
    add_report(parser)


def add_report(parser: argparse._ActionsContainer) -> None:
    """Declare what `bench` and `report` write."""
    add = parser.add_argument
    add("--metrics", type=names, default=(), metavar="A,B", help="of leaderboard, LaTeX tables and figure")
    add("--clips", type=count_or_zero, default=5, help="of the worst moments (default: %(default)s)")
    add("--plots", action="store_true", help="write the curves of all metrics as SVG files, too")


def run(options: argparse.Namespace) -> int:
    """Run the command. Return the exit status."""
    from coopsim.bench.store.store import Store

    results = stored_results(options.out)
    write_files(options.out, results, options, trust=options.trust)
    asked = Store(options.out).asked()
    if len(results) < asked:
        print(f"{len(results)} of {asked} cells are in {options.out}; the command that began them goes on from there")
    return 0


def write_files(folder: Path, results: Sequence[CellResult], options: argparse.Namespace, *, trust: bool) -> None:
    """Write the files of a folder's results, and print the leaderboard and their paths; `trust` as of `publish`."""
    from coopsim.bench.paper.provenance import Provenance
    from coopsim.bench.report.bench_text import leaderboard_text
    from coopsim.bench.report.publish import publish
    from coopsim.bench.results.result_table import ResultTable
    from coopsim.bench.store.store import Store

    written = publish(
        folder,
        results,
        Provenance.from_data(Store(folder).provenance()),
        metrics=options.metrics,
        clips=options.clips,
        with_plots=options.plots,
        trust=trust,
    )
    print(leaderboard_text(ResultTable.of(results), options.metrics))
    for path in written:
        print(f"written: {path}")
