"""`coopsim export`, `coopsim check-export` and `coopsim export-results`: folders in the formats of data sets."""

from __future__ import annotations

import argparse
import sys
from itertools import islice
from pathlib import Path

from coopsim.cli.argument_types import count, policy
from coopsim.cli.arguments import (
    FAILED,
    INTERRUPTED,
    Command,
    add_flags,
    add_options,
    add_population,
    named_options,
    population,
)

_EXPORT_FLAGS = {"max_cycles": "--frames", "seed": "--seeds", "sense_every": "dt_s"}
"""Options that must be given otherwise, and how."""


def _add_export(parser: argparse.ArgumentParser) -> None:
    add = parser.add_argument
    add("format", metavar="FORMAT", help="see `list`; as opv2v, or opv2v(lidar=roof)")
    add("environment", metavar="ENVIRONMENT", help="as crossing or town, or path of a scenario file; see `list`")
    of = "new or empty; the same command again goes on with an export that was interrupted"
    add("--out", type=Path, required=True, metavar="DIR", help=of)
    add_flags(parser, "--seeds", default=(0,), help="an episode each (default: 0)")
    add("--frames", type=count, default=100, help="of each episode (default: %(default)s)")
    add_population(parser)
    add_options(parser, "of the environment, as cameras=surround, lidar=OS1-128 or dt_s=0.5")


def _run_export(options: argparse.Namespace) -> int:
    from tqdm import tqdm

    from coopsim.data.export.export_card import DONE, PAGE, PICTURE, read_card
    from coopsim.data.export.export_run import export

    given = {**population(options), **named_options(options, _EXPORT_FLAGS)}
    frames = options.frames * len(options.seeds)
    with tqdm(total=frames, unit="frame", disable=None, desc=f"export {options.format}") as bar:
        try:
            export(
                options.format,
                options.environment,
                options.out,
                seeds=options.seeds,
                frames=options.frames,
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
    "simulate episodes and write them in the format of a data set, such as opv2v",
    _add_export,
    _run_export,
    ("coopsim export opv2v crossing --out crossing --seeds 0-3 --option lidar=OS1-128",),
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
