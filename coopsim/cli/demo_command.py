"""`coopsim demo`."""

from __future__ import annotations

import argparse
import math
import sys
from collections.abc import Collection
from pathlib import Path
from typing import TYPE_CHECKING, Any

from coopsim.cli.argument_types import count, count_or_zero, numbers, policies
from coopsim.cli.arguments import (
    INTERRUPTED,
    Command,
    add_flags,
    add_old_name,
    add_options,
    add_population,
    as_json,
    detector_option,
    named_options,
    population,
)
from coopsim.errors import InvalidValueError
from coopsim.support.files import require_writable, write_whole

if TYPE_CHECKING:
    from coopsim.bench.demo import DemoConfig

_POLICIES = ("no_fusion", "late_fusion")
_UNLESS = ", unless an option or the scenario file sets it"
_FLAGS = {
    "latency_s": "--latencies-ms",
    "loss": "--loss",
    "position_noise_m": "--position-noise-m",
    "heading_noise_rad": "--heading-noise-deg",
    "max_cycles": "--frames",
    "playback": "--playback",
    "seed": "--seed",
    "attacks": "--attack",
    "uplink": "--policies, each of which has its own",
}
"""Options that must be given by a flag, and the flag."""


def _add_demo(parser: argparse.ArgumentParser) -> None:
    add = parser.add_argument
    add("--environment", default="crossing", help="see `list`, or path of a scenario file (default: %(default)s)")
    add("--playback", type=Path, metavar="FILE", help="what `record` wrote, in place of simulated traffic")
    add("--policies", type=policies, default=_POLICIES, metavar="A,B(x=1)", help="see `list policies`")
    add("--latencies-ms", type=numbers, metavar="0,300", help=f"default: 0,300{_UNLESS}")
    add("--frames", type=count, help="length of each run (default: 100, or all that FILE has)")
    add("--seed", type=count_or_zero, help="default: 0, or that of FILE or of the scenario file")
    add_population(parser)
    add("--position-noise-m", type=float, help=f"default: 0.2{_UNLESS}")
    add("--heading-noise-deg", type=float, help=f"default: 0.2{_UNLESS}")
    add("--loss", type=float, help=f"probability in [0, 1] (default: 0{_UNLESS})")
    add_flags(parser, "--attack", help="an agent that lies; may be given several times")
    add_flags(parser, "--detector", "--device")
    add_options(parser, "of the environment, such as lidar=VLP-16, channel=FILE or, of town, place_seed=7")
    out = add("--out", type=Path, default=Path("coopsim-demo.html"), metavar="PATH", help="default: %(default)s")
    add_old_name(parser, "--report", out)
    add_flags(parser, "--json")


def _run_demo(options: argparse.Namespace) -> int:
    from tqdm import tqdm

    from coopsim.bench.demo import Demo
    from coopsim.bench.text.score_text import evaluation_row, format_table, format_visibility
    from coopsim.metrics.score import without_nan

    demo = Demo(_config(options))
    if options.json is not None and options.json.resolve() == options.out.resolve():
        raise InvalidValueError(f"--json and --out must be two files, got {options.json} for both")
    for path in filter(None, (options.out, options.json)):
        require_writable(path)
    interrupted = False
    total = len(demo.config.policies) * len(demo.config.latencies_s) * demo.config.frames
    with tqdm(total=total, unit="frame", disable=None, desc="demo") as bar:
        try:
            demo.run(bar.update)
        except KeyboardInterrupt:
            interrupted = True
    if demo.runs:  # an interrupt before the first is finished leaves older files untouched
        rows = [(run.about, evaluation_row(run.evaluation)) for run in demo.runs]
        print(format_table(rows))
        print("\nRecall by which agents got returns from an object, and the gain by what only others saw, in per cent:")
        print(format_visibility([(run.about, run.evaluation.score.visibility) for run in demo.runs]))
        if options.json is not None:
            write_whole(options.json, as_json([{**about, **without_nan(values)} for about, values in rows]))
        print(f"report: {demo.write_report(options.out, options.typed)}")
    if interrupted:
        kept = f"{len(demo.runs)} finished {'run was' if len(demo.runs) == 1 else 'runs were'} kept"
        print(f"coopsim: interrupted; {kept}", file=sys.stderr)
    return INTERRUPTED if interrupted else 0


def _config(options: argparse.Namespace) -> DemoConfig:
    from coopsim.bench.demo import DemoConfig
    from coopsim.bench.grid.cell import scenario_options
    from coopsim.bench.grid.policies import detector_on, policy_on, require_device
    from coopsim.catalog import usual_seed
    from coopsim.world.recording.episode_file import Episode

    played = None if options.playback is None else Episode(options.playback)
    frames = options.frames or (100 if played is None else max(played.frames - 1, 1))
    usual = usual_seed(options.environment) if played is None else played.header.seed
    seed = usual if options.seed is None else options.seed
    world = {} if played is None else {**played.header.population, "playback": options.playback}
    given = named_options(options, _FLAGS)
    explicit = {*given, *scenario_options(options.environment)}
    if options.attack:
        given["attacks"] = " + ".join(filter(None, options.attack))
    given = {**world, **population(options), **_degradation(options, explicit), **given, **detector_option(options)}
    if "detector" in given:
        given["detector"] = detector_on(options.device, given["detector"])
    require_device(options.device)
    on_device = tuple(policy_on(options.device, text) for text in options.policies)
    return DemoConfig(options.environment, on_device, _latencies_s(options, explicit), frames, seed, given)


def _degradation(options: argparse.Namespace, explicit: Collection[str]) -> dict[str, Any]:
    """Return noise and loss of the flags, and the default noise where no option sets it."""
    position_m, heading_deg = options.position_noise_m, options.heading_noise_deg
    if "localization" not in explicit:
        position_m = 0.2 if position_m is None and "position_noise_m" not in explicit else position_m
        heading_deg = 0.2 if heading_deg is None and "heading_noise_rad" not in explicit else heading_deg
    heading_rad = None if heading_deg is None else math.radians(heading_deg)
    given = {"position_noise_m": position_m, "heading_noise_rad": heading_rad, "loss": options.loss}
    return {name: value for name, value in given.items() if value is not None}


def _latencies_s(options: argparse.Namespace, explicit: Collection[str]) -> tuple[float | None, ...]:
    if options.latencies_ms is not None:
        if "channel" in explicit:
            raise InvalidValueError("--latencies-ms must be left out where a channel is given, which sets the latency")
        return tuple(latency_ms / 1000 for latency_ms in options.latencies_ms)
    return (None,) if {"channel", "latency_s"} & set(explicit) else (0.0, 0.3)


DEMO = Command(
    "compare policies in simulated traffic, with a report",
    _add_demo,
    _run_demo,
    (
        "coopsim demo",
        "coopsim demo --environment occluded_crossing --policies no_fusion,late_fusion --latencies-ms 0,300 --seed 3",
    ),
)
