"""`coopsim demo`."""

from __future__ import annotations

import argparse
import math
import sys
from pathlib import Path

from coopsim.cli.arguments import add_population, as_json, count, count_or_zero, names, numbers, population
from coopsim.cli.status import INTERRUPTED
from coopsim.errors import InvalidValueError
from coopsim.files import require_writable, write_whole

HELP = "compare policies in simulated traffic, with a report"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """What the command takes."""
    add = parser.add_argument
    add("--environment", default="crossing", help="see `list`, or path of a scenario file (default: %(default)s)")
    add("--playback", type=Path, metavar="FILE", help="what `record` wrote, in place of simulated traffic")
    add("--policies", type=names, default=("no_fusion", "late_fusion"), metavar="A,B", help="see `list`")
    add("--latencies-ms", type=numbers, default=(0.0, 300.0), metavar="0,300")
    add("--frames", type=count, help="length of each run (default: 100, or all that FILE has)")
    add("--seed", type=count_or_zero, help="default: 0, or FILE's own")
    add_population(parser)
    add("--position-noise-m", type=float, default=0.2, help="default: %(default)s")
    add("--heading-noise-deg", type=float, default=0.2, help="default: %(default)s")
    add("--loss", type=float, default=0.0, help="probability in [0, 1] (default: %(default)s)")
    add("--report", type=Path, default=Path("coopsim-demo.html"), metavar="PATH", help="default: %(default)s")
    add("--json", type=Path, metavar="PATH", help="write the numbers here as well")


def run(options: argparse.Namespace) -> int:
    """Run it; the exit status."""
    from tqdm import tqdm

    from coopsim.bench.demo import Demo, DemoConfig
    from coopsim.bench.table import evaluation_row, format_table, format_visibility
    from coopsim.data.episode import Episode

    played = None if options.playback is None else Episode(options.playback)
    frames = options.frames or (100 if played is None else max(played.frames - 1, 1))
    seed = options.seed if options.seed is not None else (0 if played is None else played.header.seed)
    noise = {
        "position_noise_m": options.position_noise_m,
        "heading_noise_rad": math.radians(options.heading_noise_deg),
        "loss": options.loss,
    }
    world = {} if played is None else {**played.header.population, "playback": options.playback}
    given = {**world, **population(options), **noise}
    latencies_s = tuple(latency_ms / 1000 for latency_ms in options.latencies_ms)
    demo = Demo(DemoConfig(options.environment, options.policies, latencies_s, frames, seed, given))
    if options.json is not None and options.json.resolve() == options.report.resolve():
        raise InvalidValueError(f"--json and --report must be two files, got {options.json} for both")
    for path in filter(None, (options.report, options.json)):
        require_writable(path)
    interrupted = False
    total = len(options.policies) * len(latencies_s) * frames
    with tqdm(total=total, unit="frame", disable=None, desc="demo") as bar:
        try:
            demo.run(bar.update)
        except KeyboardInterrupt:
            interrupted = True
    if demo.runs:  # an interrupt before the first is finished leaves older files as they are
        rows = [(run.about, evaluation_row(run.evaluation)) for run in demo.runs]
        print(format_table(rows))
        print("\nWho got returns from an object, recall there, and what the second adds to all recall, in per cent:")
        print(format_visibility([(run.about, run.evaluation.score.visibility) for run in demo.runs]))
        if options.json is not None:
            write_whole(options.json, as_json([{**about, **values} for about, values in rows]))
        print(f"report: {demo.write_report(options.report)}")
    if interrupted:
        print(f"coopsim: interrupted; {len(demo.runs)} finished runs were kept", file=sys.stderr)
    return INTERRUPTED if interrupted else 0
