"""`coopsim replay`."""

from __future__ import annotations

import argparse
from pathlib import Path

from coopsim.cli.arguments import add_recordings, as_json, policy, replay_options
from coopsim.support.files import require_writable, write_whole

HELP = "score a policy on recordings"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    add_recordings(parser)
    add = parser.add_argument
    add("--policy", type=policy, default="ab3dmot", metavar="A(x=1)", help="as in `bench` (default: %(default)s)")
    add("--json", type=Path, metavar="PATH", help="write the numbers here as well")


def run(options: argparse.Namespace) -> int:
    """Run the command. Return the exit status."""
    from coopsim.bench.evaluate import evaluate_recordings
    from coopsim.bench.report.table import format_table, score_row

    if options.json is not None:
        require_writable(options.json)
    result = evaluate_recordings(options.policy, options.path, options.detections, **replay_options(options))
    protocols = {"count": result.count, "ignore": result.ignore}
    print(
        format_table(
            [
                ({"policy": options.policy, "false positives": name}, score_row(score, result.frames_per_s))
                for name, score in protocols.items()
            ]
        )
    )
    print(f"{result.frames} frames in {result.seconds:.2f} s")
    if options.json is not None:
        scores = {name: score.to_dict() for name, score in protocols.items()}
        write_whole(options.json, as_json({**scores, "frames": result.frames, "seconds": result.seconds}))
    return 0
