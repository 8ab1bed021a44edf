"""`coopsim leaderboard`."""

from __future__ import annotations

import argparse
from pathlib import Path

import coopsim
from coopsim.cli.arguments import add_recordings, policies

HELP = "every policy on recorded detections, as tables and a picture"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """What the command takes."""
    add_recordings(parser)
    add = parser.add_argument
    add("--policies", type=policies, metavar="A,B(x=1)", help="as in `bench` (default: all, see `list`)")
    add("--out", type=Path, default=Path("coopsim-leaderboard"), metavar="FOLDER", help="default: %(default)s")


def run(options: argparse.Namespace) -> int:
    """Run it; the exit status."""
    from tqdm import tqdm

    from coopsim.bench.leaderboard import evaluate_all, make_folder, rows_of, write_leaderboard
    from coopsim.bench.table import format_table

    make_folder(options.out)
    ranked = options.policies or coopsim.POLICIES.names()
    with tqdm(total=len(ranked), unit="policy", disable=None, desc="leaderboard") as bar:
        results = evaluate_all(
            options.path,
            options.detections,
            ranked,
            on_policy=lambda name: bar.update(),
            latency_s=options.latency_ms / 1000,
            match_iou=options.match_iou,
        )
    rows = [({name: row[name] for name in ("policy", "false positives")}, row) for row in rows_of(results)]
    print(format_table(rows))
    title = f"{options.path.resolve().parent.name}/{options.path.resolve().name}: {', '.join(options.detections)}"
    for path in write_leaderboard(options.out, results, title):
        print(f"written: {path}")
    return 0
