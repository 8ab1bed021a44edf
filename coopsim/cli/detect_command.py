"""`coopsim detect`."""

from __future__ import annotations

import argparse
import itertools
import sys
from dataclasses import fields
from pathlib import Path
from typing import TYPE_CHECKING, Any

from coopsim.cli.argument_types import count, names, noises, numbers, policies
from coopsim.cli.arguments import (
    FAILED,
    INTERRUPTED,
    NOISES,
    Command,
    add_flags,
    add_old_name,
    add_options,
    as_json,
    named_options,
)
from coopsim.cli.jobs_bar import JobsBar
from coopsim.errors import InvalidValueError
from coopsim.support.files import require_writable, write_whole

if TYPE_CHECKING:
    from coopsim.bench.detect.detect import DetectProgress
    from coopsim.bench.detect.detect_plan import DetectPlan

_FLAGS = {
    "attacks": "--attack",
    "latency_s": "--latencies-ms",
    "position_noise_m": "--position-noises-m",
    "heading_noise_rad": "--heading-noises-deg",
    "detector": "--detector",
    "max_cycles": "--frames",
    "seed": "--seeds",
    "uplink": "--policies, each of which has its own",
    "expose_ground_truth": "none: it is always on",
    "threads": "--workers",
}
"""Options that must be given by a flag, and the flag."""


def _add_detect(parser: argparse.ArgumentParser) -> None:
    add = parser.add_argument
    add("--policies", type=policies, default=("no_fusion", "late_fusion"), metavar="A,B(x=1)", help="as in `bench`")
    of = "names, scenario files, recordings"
    add("--environments", type=names, default=("crossing",), metavar="A,B.yaml", help=of)
    add_flags(parser, "--seeds", default=(0, 1), help="one episode each (default: 0-1)")
    add("--frames", type=count, default=20, help="measured in each episode (default: %(default)s)")
    add("--every-s", type=float, default=0.5, help="least time between measured frames (default: %(default)s)")
    add_flags(parser, *NOISES)
    of = "delays of messages, a row each (default: the environment's, as of noises)"
    latencies = add("--latencies-ms", type=numbers, default=(), dest="delays_ms", metavar="0,200", help=of)
    add_old_name(parser, "--delays-ms", latencies)
    instead = "--position-noises-m and --heading-noises-deg with --pose together"
    add_old_name(parser, "--noise", latencies, dest="noises", type=noises, metavar=instead)
    parser.set_defaults(noises=())
    add_flags(parser, "--attack", help="agents that lie, a row; several times: several rows, of which `none` is honest")
    add("--protocol", default="coopsim", help="coopsim, opencood, dair, nuscenes or v2x-real (default: %(default)s)")
    add("--within-m", type=float, help="objects and boxes up to this far from the receiver (default: the region)")
    add_flags(parser, "--detector", help="of policies without a network (default: pillars, or the environment's)")
    add_flags(parser, "--device")
    add("--receivers", default="cars", help="cars or all (default: %(default)s)")
    add("--boxes", default="detections", help="detections or tracks (default: %(default)s)")
    add_options(parser, "of the environments, as lidar=VLP-16 or detail=full")
    add_old_name(parser, "--jobs", add_flags(parser, "--workers", help="episodes at once (default: as many as cores)"))
    add_flags(parser, "--dry-run")
    add_flags(
        parser, "--json", metavar="OUT", help="write the rows here; episodes go to OUT.episodes, and are run once"
    )
    add("--episodes", type=Path, metavar="FOLDER", help="of the episodes that several tables share, such as protocols'")
    add("--table", action="store_true", help="print the rows as a Markdown table, also with --json")
    add("--by-range", action="store_true", help="print average precision by range and class below it")
    add("--pictures", type=Path, metavar="FOLDER", help="draw each measured sweep of recordings here, from above")


def _run_detect(options: argparse.Namespace) -> int:
    from coopsim.bench.detect.detect import markdown_table, measure_detection
    from coopsim.bench.detect.range_table import range_table, require_ranges
    from coopsim.bench.detect.sweep_pictures import draw_measured, require_recordings
    from coopsim.bench.dry_run import estimate_detection
    from coopsim.bench.engine.engine import Engine

    plan, out, folder = _plan(options), options.json, _folder(options)
    engine = Engine(workers=options.workers)
    if options.dry_run:
        print(estimate_detection(plan, folder).text("episodes", engine.at_once))
        return 0
    if out is not None:
        require_writable(out)
    if options.by_range:
        require_ranges(plan.protocol)
    if options.pictures is not None:
        require_recordings(plan)
        folder = folder or options.pictures / "episodes"
    rows: list[dict[str, Any]] = []
    interrupted = False
    with JobsBar("detect", "episodes", [condition for _, condition in plan.rows()], engine.at_once) as bar:

        def show(progress: DetectProgress) -> None:
            nonlocal rows
            grown, rows = len(progress.rows) > len(rows), progress.rows
            bar.show(progress)
            if out is not None and (grown or progress.outcome is None):
                write_whole(out, as_json(rows))

        try:
            measure_detection(plan, folder=folder, engine=engine, on_progress=show)
        except KeyboardInterrupt:
            interrupted = True
    if options.table or out is None:
        print(markdown_table(rows))
    for row in rows if options.by_range else ():
        print(f"\n{range_table(row)}")
    for path in draw_measured(plan, folder, options.pictures) if folder and options.pictures else ():
        print(f"written: {path}")
    if out is not None:
        print(f"written: {out}", file=sys.stderr)
    if interrupted:
        kept = f"{len(rows)} finished rows" + ("" if out is None else f" are in {out}")
        again = "" if out is None else "; the same command goes on from there"
        print(f"coopsim: interrupted; {kept}{again}", file=sys.stderr)
        return INTERRUPTED
    bar.tell_of_lost()
    if bar.failed:
        print(f"coopsim: {bar.failed} episodes failed, and their rows are missing", file=sys.stderr)
    return FAILED if bar.failed or bar.lost else 0


def _plan(options: argparse.Namespace) -> DetectPlan:
    from coopsim.bench.detect.detect_plan import DetectPlan

    named = [each.name for each in fields(DetectPlan) if each.name not in ("options", "noises", "attacks")]
    given = {name: getattr(options, name) for name in named}
    own: dict[str, Any] = {"noises": _noises(options), "attacks": tuple(options.attack)}
    return DetectPlan(**given, **own, options=named_options(options, _FLAGS))


def _noises(options: argparse.Namespace) -> tuple[tuple[float, float], ...]:
    """Return pairs of m and degrees; empty where the environment's own noise holds."""
    positions, headings = options.position_noises_m, options.heading_noises_deg
    if positions is None and headings is None:
        return tuple(options.noises)
    if options.noises:
        raise InvalidValueError("noise must be given once, by --position-noises-m and --heading-noises-deg")
    positions, headings = positions or (0.0,), headings or (0.0,)
    if options.pose != "together":
        return tuple(itertools.product(positions, headings))
    if len(positions) != len(headings):
        counted = f"got {len(positions)} and {len(headings)}"
        raise InvalidValueError(f"--pose together needs as many position as heading noises, {counted}")
    return tuple(zip(positions, headings, strict=True))


def _folder(options: argparse.Namespace) -> Path | None:
    own: Path | None = options.json and options.json.with_name(f"{options.json.name}.episodes")
    return options.episodes or own


DETECT = Command(
    "measure what policies detect: average precision by distance, class and who saw it, under noise and delay",
    _add_detect,
    _run_detect,
    (
        "coopsim detect --policies no_fusion,late_fusion,attfuse --seeds 0-4 --json detect.json",
        "coopsim detect --policies late_fusion --position-noises-m 0,0.4 --heading-noises-deg 0,0.4 --pose together",
        "coopsim detect --policies no_fusion,late_fusion --attack none --attack 'cav_1=ghost(ahead_m=15)'",
        "coopsim detect --policies no_fusion,attfuse --latencies-ms 0,200 --dry-run",
    ),
)
