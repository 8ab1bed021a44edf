"""`coopsim leaderboard`."""

from __future__ import annotations

import argparse
import sys
import traceback
from pathlib import Path
from typing import TYPE_CHECKING

from coopsim.cli.arguments import FAILED, INTERRUPTED, add_isolation, add_recordings, policies, replay_options

if TYPE_CHECKING:
    from coopsim.bench.evaluate import RecordingsEvaluation
    from coopsim.bench.leaderboard import Results

HELP = "rank policies on recordings, as tables and a plot"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    add_recordings(parser)
    add = parser.add_argument
    add(
        "--policies",
        type=policies,
        metavar="A,B(x=1)",
        help="as in `bench` (default: all without LiDAR)",
    )
    add_isolation(parser)
    add("--out", type=Path, default=Path("coopsim-leaderboard"), metavar="FOLDER", help="default: %(default)s")


def run(options: argparse.Namespace) -> int:
    """Run the command. Return the exit status."""
    from tqdm import tqdm

    from coopsim.bench.isolated.isolation import Isolation
    from coopsim.bench.leaderboard import evaluate_each
    from coopsim.catalog import policies_on_boxes
    from coopsim.support.files import make_folder

    make_folder(options.out)
    ranked = options.policies or policies_on_boxes()
    isolation = Isolation.of(options.isolate, options.salt)
    given = replay_options(options)
    each = evaluate_each(options.path, options.detections, ranked, isolation=isolation, **given)
    results: dict[str, RecordingsEvaluation] = {}
    failed = 0
    interrupted = False
    with tqdm(each, total=len(ranked), unit="policy", disable=None, desc="leaderboard") as bar:
        try:
            for name, result in bar:
                if isinstance(result, Exception):
                    failed += 1
                    text = "".join(traceback.format_exception(result))  # no report shows it
                    bar.write(f"coopsim: failed: {name}\n{text}", file=sys.stderr, end="")
                else:
                    results[name] = result
        except KeyboardInterrupt:
            interrupted = True
    if results:  # older files stay untouched while nothing is finished
        _report(results, options)
    if failed:
        print(f"coopsim: {failed} of {len(ranked)} policies failed and are not ranked", file=sys.stderr)
    if interrupted:
        print(f"coopsim: interrupted; {len(results)} of {len(ranked)} policies were ranked", file=sys.stderr)
        return INTERRUPTED
    return FAILED if failed else 0


def _report(results: Results, options: argparse.Namespace) -> None:
    from coopsim.bench.leaderboard import rows_of, write_leaderboard
    from coopsim.bench.report.table import format_table

    rows = [({name: row[name] for name in ("policy", "false positives")}, row) for row in rows_of(results)]
    print(format_table(rows))
    found_by = ", ".join(options.detections or (options.detector or "pillars",))
    title = f"{options.path.resolve().parent.name}/{options.path.resolve().name}: {found_by}"
    for path in write_leaderboard(options.out, results, title):
        print(f"written: {path}")
