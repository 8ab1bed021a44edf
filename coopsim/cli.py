"""The command line: `coopsim demo`, `coopsim record`, `coopsim replay`, `coopsim compare`, `coopsim list`."""

from __future__ import annotations

import argparse
import difflib
import json
import math
import os
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import coopsim
from coopsim.errors import CoopsimError, InvalidValueError
from coopsim.files import require_writable, write_whole

INTERRUPTED = 130
"""Exit status after Ctrl-C, as shells report it."""


class _Parser(argparse.ArgumentParser):
    """Suggests the option that was probably meant; takes no abbreviations, which hide typos."""

    def __init__(self, **kwargs: Any) -> None:
        super().__init__(**(kwargs | {"allow_abbrev": False}))

    def parse_known_args(self, args: Any = None, namespace: Any = None) -> tuple[Any, list[str]]:
        # A sub-command's parser is asked here, never through parse_args. Before argparse, which would rather complain
        # that the option which was mistyped is missing.
        for word in args or () if self._subparsers is None else ():
            option = str(word).split("=")[0]
            if option.startswith("--") and option not in self._option_string_actions:
                close = difflib.get_close_matches(option, self._option_string_actions, n=2, cutoff=0.5)
                hint = f" Did you mean {' or '.join(close)}?" if close else ""
                accepted = ", ".join(name for name in self._option_string_actions if name.startswith("--"))
                self.error(f"unknown option {option}.{hint} Accepted: {accepted}")
        return super().parse_known_args(args, namespace)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run a command; the exit status: 0, 2 for what the user can mend, 130 after Ctrl-C."""
    options = _parser().parse_args(arguments)
    try:
        return int(options.command(options))
    except CoopsimError as error:
        print(f"coopsim: error: {error}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        print("coopsim: interrupted", file=sys.stderr)
        return INTERRUPTED
    except BrokenPipeError:  # the reader of our output went away, as `head` does
        sys.stdout = open(os.devnull, "w")  # noqa: SIM115  (so that the exit does not flush into it again)
        return 0


def _parser() -> argparse.ArgumentParser:
    parser = _Parser(prog="coopsim", description="The gym for cooperative perception.")
    parser.add_argument("--version", action="version", version=f"coopsim {coopsim.__version__}")
    commands = parser.add_subparsers(required=True, metavar="COMMAND", parser_class=_Parser)
    _add_demo(commands.add_parser("demo", help="compare policies in simulated traffic, with a report"))
    _add_record(commands.add_parser("record", help="simulate traffic and write it to a file that demos can play"))
    _add_replay(commands.add_parser("replay", help="score a policy on recorded detections"))
    _add_compare(commands.add_parser("compare", help="every policy on recorded detections, as tables and a picture"))
    listing = commands.add_parser("list", help="names of policies, environments and camera rigs")
    listing.set_defaults(command=_list)
    return parser


def _add_demo(parser: argparse.ArgumentParser) -> None:
    add = parser.add_argument
    add("--environment", default="crossing", help="see `list`, or path of a scenario file (default: %(default)s)")
    add("--playback", type=Path, metavar="FILE", help="what `record` wrote, in place of simulated traffic")
    add("--policies", type=_names, default=("no_fusion", "late_fusion"), metavar="A,B", help="see `list`")
    add("--latencies-ms", type=_milliseconds, default=(0.0, 300.0), metavar="0,300")
    add("--frames", type=_count, help="length of each run (default: 100, or all that FILE has)")
    add("--seed", type=_count_or_zero, help="default: 0, or FILE's own")
    _add_population(parser)
    add("--position-noise-m", type=float, default=0.2, help="default: %(default)s")
    add("--heading-noise-deg", type=float, default=0.2, help="default: %(default)s")
    add("--loss", type=float, default=0.0, help="probability in [0, 1] (default: %(default)s)")
    add("--report", type=Path, default=Path("coopsim-demo.html"), metavar="PATH", help="default: %(default)s")
    add("--json", type=Path, metavar="PATH", help="write the numbers here as well")
    parser.set_defaults(command=_demo)


def _add_record(parser: argparse.ArgumentParser) -> None:
    add = parser.add_argument
    add("scenario", help="as crossing or highway")
    add("--seed", type=_count_or_zero, default=0, help="default: %(default)s")
    add("--frames", type=_count, default=600, help="steps (default: %(default)s)")
    add("--out", type=Path, required=True, metavar="FILE", help="an older one is replaced; Ctrl-C leaves what is there")
    _add_population(parser)
    parser.set_defaults(command=_record)


def _add_population(parser: argparse.ArgumentParser) -> None:
    add = parser.add_argument
    add("--vehicles", type=_count, help="default: the scenario's own")
    add("--connected-cars", type=_count_or_zero, help="default: the scenario's own")
    add("--rsus", type=_count_or_zero, help="roadside units (default: the scenario's own)")
    add("--drones", type=_count_or_zero, help="default: the scenario's own")
    add("--pedestrians", type=_count_or_zero, help="default: the scenario's own")


def _add_replay(parser: argparse.ArgumentParser) -> None:
    _add_recordings(parser)
    add = parser.add_argument
    add("--policy", default="ab3dmot", help="see `list` (default: %(default)s)")
    add("--json", type=Path, metavar="PATH", help="write the numbers here as well")
    parser.set_defaults(command=_replay)


def _add_compare(parser: argparse.ArgumentParser) -> None:
    _add_recordings(parser)
    add = parser.add_argument
    add("--policies", type=_names, metavar="A,B", help="default: all, see `list`")
    add("--out", type=Path, default=Path("coopsim-comparison"), metavar="FOLDER", help="default: %(default)s")
    parser.set_defaults(command=_compare)


def _add_recordings(parser: argparse.ArgumentParser) -> None:
    add = parser.add_argument
    add("path", type=Path, help="folder with labels/ and detections/<name>/")
    add(
        "--detections",
        type=_names,
        required=True,
        metavar="A,B",
        help="every name is one agent, first the one in whose frame the boxes are",
    )
    add("--latency-ms", type=float, default=0.0, help="of every message (default: %(default)s)")
    add("--match-iou", type=float, default=0.25, help="3D IoU of a match (default: %(default)s)")


def _demo(options: argparse.Namespace) -> int:
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
    given = {**world, **_given(options), **noise}
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
            write_whole(options.json, _json([{**about, **values} for about, values in rows]))
        print(f"report: {demo.write_report(options.report)}")
    if interrupted:
        print(f"coopsim: interrupted; {len(demo.runs)} finished runs were kept", file=sys.stderr)
    return INTERRUPTED if interrupted else 0


def _record(options: argparse.Namespace) -> int:
    from coopsim.data.episode import Episode
    from coopsim.world.recorded import record

    record(options.scenario, options.out, seed=options.seed, max_cycles=options.frames, **_given(options))
    episode = Episode(options.out)
    per_frame = episode.size_bytes / episode.frames
    print(f"written: {options.out}, {episode.frames} frames, {per_frame:.0f} bytes a frame")
    return 0


def _given(options: argparse.Namespace) -> dict[str, Any]:
    """Numbers of the scenario that the user named."""
    names = ("vehicles", "connected_cars", "rsus", "drones", "pedestrians")
    return {name: value for name in names if (value := getattr(options, name)) is not None}


def _replay(options: argparse.Namespace) -> int:
    from coopsim.bench.runner import evaluate_recordings
    from coopsim.bench.table import format_table, score_row

    if options.json is not None:
        require_writable(options.json)
    result = evaluate_recordings(
        options.policy,
        options.path,
        options.detections,
        latency_s=options.latency_ms / 1000,
        match_iou=options.match_iou,
    )
    frames_per_s = result.frames / result.seconds
    protocols = {"count": result.count, "ignore": result.ignore}
    print(
        format_table(
            [
                ({"policy": options.policy, "false positives": name}, score_row(score, frames_per_s))
                for name, score in protocols.items()
            ]
        )
    )
    print(f"{result.frames} frames in {result.seconds:.2f} s")
    if options.json is not None:
        scores = {name: score.to_dict() for name, score in protocols.items()}
        write_whole(options.json, _json({**scores, "frames": result.frames, "seconds": result.seconds}))
    return 0


def _compare(options: argparse.Namespace) -> int:
    from tqdm import tqdm

    from coopsim.bench.compare import compare, rows_of, write_comparison
    from coopsim.bench.table import format_table

    policies = options.policies or coopsim.POLICIES.names()
    with tqdm(total=len(policies), unit="policy", disable=None, desc="compare") as bar:
        results = compare(
            options.path,
            options.detections,
            policies,
            on_policy=lambda name: bar.update(),
            latency_s=options.latency_ms / 1000,
            match_iou=options.match_iou,
        )
    rows = [({name: row[name] for name in ("policy", "false positives")}, row) for row in rows_of(results)]
    print(format_table(rows))
    title = f"{options.path.resolve().parent.name}/{options.path.resolve().name}: {', '.join(options.detections)}"
    for path in write_comparison(options.out, results, title):
        print(f"written: {path}")
    return 0


def _list(options: argparse.Namespace) -> int:
    from coopsim.sensors.rigs import RIG_NAMES

    print("policies:     " + ", ".join(coopsim.POLICIES.names()))
    print("environments: " + ", ".join(coopsim.ENVIRONMENTS.names()))
    print("camera rigs:  " + ", ".join(RIG_NAMES))
    return 0


def _names(text: str) -> tuple[str, ...]:
    names = tuple(name.strip() for name in text.split(","))
    if not all(names) or len(set(names)) < len(names):
        raise argparse.ArgumentTypeError(f"must be distinct names with commas between them, got {text!r}")
    return names


def _milliseconds(text: str) -> tuple[float, ...]:
    try:
        return tuple(float(part) for part in text.split(","))
    except ValueError:
        raise argparse.ArgumentTypeError(f"must be numbers with commas between them, got {text!r}") from None


def _count_or_zero(text: str) -> int:
    return _integer(text, least=0)


def _count(text: str) -> int:
    return _integer(text, least=1)


def _integer(text: str, least: int) -> int:
    if not (text.isdecimal() and int(text) >= least):
        raise argparse.ArgumentTypeError(f"must be an integer >= {least}, got {text!r}")
    return int(text)


def _json(content: object) -> str:
    return json.dumps(content, indent=2) + "\n"
