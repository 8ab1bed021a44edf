"""`coopsim export`, `coopsim check-export`, `coopsim export-results`: folders in formats of data sets, and maps."""

from __future__ import annotations

import argparse
import sys
from itertools import islice
from pathlib import Path

from coopsim.cli.argument_types import count, count_or_zero, policy
from coopsim.cli.arguments import (
    FAILED,
    INTERRUPTED,
    POPULATION,
    Command,
    add_flags,
    add_options,
    add_population,
    named_options,
    population,
)
from coopsim.errors import InvalidValueError

_FRAMES = 100

_EXPORT_FLAGS = {"max_cycles": "--frames", "seed": "--seeds", "sense_every": "dt_s"}
"""Options that must be given otherwise, and how."""


def _add_export(parser: argparse.ArgumentParser) -> None:
    add = parser.add_argument
    add("format", metavar="FORMAT", help="see `list`; as opv2v, or opv2v(lidar=roof); of a map: opendrive or sumo")
    add("environment", metavar="ENVIRONMENT", help="as crossing or town, or path of a scenario file; of a map: town")
    of = "new or empty; the same command again goes on with an export that was interrupted; of a map: the file"
    add("--out", type=Path, required=True, metavar="DIR", help=of)
    add_flags(parser, "--seeds", help="an episode each (default: 0)")
    add("--frames", type=count, help=f"of each episode (default: {_FRAMES})")
    add("--seed", type=count_or_zero, help="of a map: seed of the episode in this place (default: 0)")
    add_population(parser)
    add_options(parser, "of the environment, as cameras=surround, lidar=OS1-128 or dt_s=0.5; of a map: as lanes=2")


def _run_export(options: argparse.Namespace) -> int:
    from coopsim.config.spec import parse_spec
    from coopsim.data.export.export_format import EXPORT_FORMATS
    from coopsim.data.maps.export.map_format import MAP_FORMATS
    from coopsim.support.checks import require_choice

    name, _ = parse_spec("export format", options.format)
    if name not in EXPORT_FORMATS:
        require_choice("export format", name, (*EXPORT_FORMATS.names(), *MAP_FORMATS.names()))
        return _run_map_export(options)
    if options.seed is not None:
        raise InvalidValueError(f"--seed is of exports of maps: {name} takes --seeds")
    return _run_recording(options)


def _run_map_export(options: argparse.Namespace) -> int:
    from coopsim.data.maps.export.map_format import export_map

    for flag in ("seeds", "frames", *POPULATION):
        if getattr(options, flag) is not None:
            raise InvalidValueError(
                f"--{flag.replace('_', '-')} is not of exports of maps; accepted: --seed, and --option of the place"
            )
    given = named_options(options)
    for path in export_map(options.format, options.environment, options.out, seed=options.seed or 0, **given):
        print(f"written: {path}, {path.stat().st_size / 1e6:.1f} MB")
    return 0


def _run_recording(options: argparse.Namespace) -> int:
    from tqdm import tqdm

    from coopsim.data.export.export_card import DONE, PAGE, PICTURE, read_card
    from coopsim.data.export.export_run import export

    given = {**population(options), **named_options(options, _EXPORT_FLAGS)}
    seeds, per_episode = options.seeds or (0,), options.frames or _FRAMES
    frames = per_episode * len(seeds)
    with tqdm(total=frames, unit="frame", disable=None, desc=f"export {options.format}") as bar:
        try:
            export(
                options.format,
                options.environment,
                options.out,
                seeds=seeds,
                frames=per_episode,
                progress=bar.update,
                **given,
            )
        except KeyboardInterrupt:
            bar.close()
            print("coopsim: interrupted; the same command again goes on", file=sys.stderr)
            return INTERRUPTED
    card = read_card(options.out)
    assert card["state"] == DONE
    print(f"written: {options.out}, {frames} frames, {card['files']} files, {card['bytes'] / 1e6:.1f} MB")
    print(f"card: {options.out / PAGE}, picture: {options.out / PICTURE}")
    return 0


EXPORT = Command(
    "write episodes in the format of a data set, such as opv2v, or a town as a map, such as opendrive",
    _add_export,
    _run_export,
    (
        "coopsim export opv2v crossing --out crossing --seeds 0-3 --option lidar=OS1-128",
        "coopsim export opendrive town --seed 7 --out town.xodr",
        "coopsim export sumo town --seed 7 --out town.net.xml --option lanes=2",
    ),
)


_MOST_PROBLEMS = 100
"""Problems that are printed: a wrong folder can have one in every file."""


def _add_check_export(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("folder", type=Path, metavar="DIR", help="what `export` wrote")
    parser.add_argument("--format", help="check this format alone, in a folder that coopsim need not have written")


def _run_check_export(options: argparse.Namespace) -> int:
    from coopsim.data.export.export_run import check_export

    problems = list(islice(check_export(options.folder, options.format), _MOST_PROBLEMS + 1))
    for problem in problems[:_MOST_PROBLEMS]:
        print(problem)
    if problems:
        count = f"more than {_MOST_PROBLEMS}" if len(problems) > _MOST_PROBLEMS else str(len(problems))
        print(f"{count} problem{'s' * (len(problems) > 1)}")
        return FAILED
    print(f"{options.folder} is as it should be")
    return 0


CHECK_EXPORT = Command(
    "check a folder that `export` wrote, or another one in such a format",
    _add_check_export,
    _run_check_export,
    ("coopsim check-export crossing", "coopsim check-export other --format opv2v"),
)


_RESULT_FLAGS = {"uplink": "--policy", "max_cycles": "the export's --frames", "seed": "the export's --seeds"}
"""Options that must be given otherwise, and how."""


def _add_export_results(parser: argparse.ArgumentParser) -> None:
    add = parser.add_argument
    add("folder", type=Path, metavar="DIR", help="what `export nuscenes` wrote; it stays as it is")
    add("--policy", type=policy, default="late_fusion", metavar="A(x=1)", help="as in `bench` (default: %(default)s)")
    add("--out", type=Path, required=True, metavar="DIR", help="gets tracking.json and detection.json")
    add_options(parser, "of the environment, beyond the export's, as loss=0.3 or detector=coalign")


def _run_export_results(options: argparse.Namespace) -> int:
    from tqdm import tqdm

    from coopsim.bench.nuscenes_results import TRACKING, as_table, read_plan, score_results, write_results

    given = named_options(options, _RESULT_FLAGS)
    plan, _ = read_plan(options.folder)
    with tqdm(total=plan.frames * len(plan.seeds), unit="frame", disable=None, desc=options.policy) as bar:
        write_results(options.folder, options.policy, options.out, progress=bar.update, **given)
    print(as_table(score_results(options.folder, options.out / TRACKING)))
    print(f"written: {options.out}")
    return 0


EXPORT_RESULTS = Command(
    "run a policy on what `export nuscenes` wrote, and write its tracks for nuScenes' official tools",
    _add_export_results,
    _run_export_results,
    ("coopsim export-results exported --policy late_fusion --out results",),
)
