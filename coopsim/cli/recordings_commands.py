"""`coopsim replay` and `coopsim leaderboard`: policies on recordings."""

from __future__ import annotations

import argparse
import sys
import traceback
from pathlib import Path
from typing import TYPE_CHECKING, Any

from coopsim.cli.argument_types import count, names, policies, policy
from coopsim.cli.arguments import FAILED, INTERRUPTED, Command, add_flags, add_options, as_json, named_options
from coopsim.support.files import require_writable, write_whole

if TYPE_CHECKING:
    from coopsim.bench.evaluate import RecordingsEvaluation
    from coopsim.bench.leaderboard import Results


def _add_recordings(parser: argparse.ArgumentParser) -> None:
    """Declare a folder of recordings, what is detected in them, and the latency of messages."""
    add = parser.add_argument
    add("path", type=Path, help="folder of recordings: of a data set, of plain arrays, or with labels/*.txt")
    of = "of text files: each name is one agent; boxes are in the frame of the first"
    add("--detections", type=names, metavar="A,B", help=of)
    add_flags(parser, "--detector", help="of recordings with sweeps (default: pillars)")
    add_flags(parser, "--device")
    add("--sequences", type=names, metavar="A,B", help="names of sequences (default: all)")
    add("--frames", type=count, help="of each sequence with sweeps (default: all)")
    add("--latency-ms", type=float, default=0.0, help="of every message (default: %(default)s)")
    add("--match-iou", type=float, default=0.25, help="3D IoU of a match (default: %(default)s)")
    add("--odometry", metavar="NAME", help="auto, poses, estimated or none (default: auto)")
    add("--axes", metavar="NAME", help="of text files: kitti or v2v4real (default: kitti)")
    add_options(parser, "of the environment, as region_x_m=140 or format=opv2v")


def _replay_options(options: argparse.Namespace) -> dict[str, Any]:
    """Return what `_add_recordings` declares, but path and detections, as keywords of `evaluate_recordings`."""
    flags = {"detector": "--detector", "max_cycles": "--frames", "latency_s": "--latency-ms"}
    flags |= {name: f"--{name.replace('_', '-')}" for name in ("path", "detections", "sequences", "match_iou")}
    given = {
        "detector": _detector(options),
        "sequences": options.sequences,
        "max_cycles": options.frames,
        "odometry": options.odometry,
        "axes": options.axes,
    }
    return {
        "latency_s": options.latency_ms / 1000,
        "match_iou": options.match_iou,
        **{name: value for name, value in given.items() if value is not None},
        **named_options(options, flags),
    }


def _detector(options: argparse.Namespace) -> str | None:
    """Return the detector of sweeps with its device; None: the environment's, or boxes come from text files."""
    from coopsim.bench.grid.policies import detector_on, require_device

    require_device(options.device)
    of_sweeps = "pillars" if options.device != "cpu" and options.detections is None else None
    detector: str | None = detector_on(options.device, options.detector or of_sweeps)
    return detector


def _add_replay(parser: argparse.ArgumentParser) -> None:
    _add_recordings(parser)
    add = parser.add_argument
    add("--policy", type=policy, default="ab3dmot", metavar="A(x=1)", help="as in `bench` (default: %(default)s)")
    add_flags(parser, "--json")


def _run_replay(options: argparse.Namespace) -> int:
    from coopsim.bench.evaluate import evaluate_recordings
    from coopsim.bench.grid.policies import policy_on
    from coopsim.bench.results.result_table import named
    from coopsim.bench.text.score_text import format_table, score_row

    if options.json is not None:
        require_writable(options.json)
    given, on_device = _replay_options(options), policy_on(options.device, options.policy)
    result = evaluate_recordings(on_device, options.path, options.detections, **given)
    protocols, policy = {"count": result.count, "ignore": result.ignore}, named(on_device, bound=result.bound)
    print(
        format_table(
            [
                ({"policy": policy, "false positives": name}, score_row(score, result.frames_per_s))
                for name, score in protocols.items()
            ]
        )
    )
    print(f"{result.frames} frames in {result.seconds:.2f} s")
    if options.json is not None:
        scores = {name: score.to_dict() for name, score in protocols.items()}
        write_whole(options.json, as_json({**scores, "frames": result.frames, "seconds": result.seconds}))
    return 0


REPLAY = Command(
    "score a policy on recordings",
    _add_replay,
    _run_replay,
    ("coopsim replay opv2v/test --policy late_fusion --latency-ms 100 --json scores.json",),
)


def _add_leaderboard(parser: argparse.ArgumentParser) -> None:
    _add_recordings(parser)
    add = parser.add_argument
    add("--policies", type=policies, metavar="A,B(x=1)", help="as in `bench` (default: all without LiDAR)")
    add_flags(parser, "--isolate", "--salt-fd")
    add("--out", type=Path, default=Path("coopsim-leaderboard"), metavar="FOLDER", help="default: %(default)s")


def _run_leaderboard(options: argparse.Namespace) -> int:
    from tqdm import tqdm

    from coopsim.bench.grid.policies import policy_on
    from coopsim.bench.isolated.isolation import Isolation
    from coopsim.bench.leaderboard import evaluate_each
    from coopsim.catalog import policies_on_boxes
    from coopsim.support.files import make_folder

    make_folder(options.out)
    isolation = Isolation.of(options.isolate, options.salt_fd)
    given = _replay_options(options)
    ranked = [policy_on(options.device, text) for text in options.policies or policies_on_boxes()]
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
    from coopsim.bench.text.score_text import format_table

    rows = [({name: row[name] for name in ("policy", "false positives")}, row) for row in rows_of(results)]
    print(format_table(rows))
    found_by = ", ".join(options.detections or (options.detector or "pillars",))
    title = f"{options.path.resolve().parent.name}/{options.path.resolve().name}: {found_by}"
    for path in write_leaderboard(options.out, results, title):
        print(f"written: {path}")


LEADERBOARD = Command(
    "rank policies on recordings, as tables and a plot",
    _add_leaderboard,
    _run_leaderboard,
    ("coopsim leaderboard opv2v/test --policies no_fusion,late_fusion --out leaderboard",),
)
