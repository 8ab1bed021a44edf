"""`coopsim record` and `coopsim town`: traffic and towns as files."""

from __future__ import annotations

import argparse
from pathlib import Path

import coopsim
from coopsim.cli.arguments import (
    Command,
    Parser,
    add_options,
    add_population,
    count,
    count_or_zero,
    named_options,
    population,
)


def _add_record(parser: argparse.ArgumentParser) -> None:
    add = parser.add_argument
    add("scenario", help="as crossing or highway, or path of a scenario file")
    add("--seed", type=count_or_zero, help="default: 0, or the scenario file's own")
    add("--frames", type=count, default=600, help="steps (default: %(default)s)")
    add(
        "--out",
        type=Path,
        required=True,
        metavar="FILE",
        help="an older file is replaced; Ctrl-C keeps the frames so far",
    )
    add_population(parser)
    add_options(parser, "of the scenario, as density=2 or bicycles=3")


def _run_record(options: argparse.Namespace) -> int:
    from coopsim.world.recording.episode_file import Episode

    given = {**population(options), **named_options(options, {"max_cycles": "--frames", "seed": "--seed"})}
    if options.seed is not None:
        given["seed"] = options.seed
    coopsim.record(options.scenario, options.out, max_cycles=options.frames, **given)
    episode = Episode(options.out)
    per_frame = episode.size_bytes / episode.frames
    print(f"written: {options.out}, {episode.frames} frames, {per_frame:.0f} bytes a frame")
    return 0


RECORD = Command(
    "simulate traffic and record it to a file that demos can play back",
    _add_record,
    _run_record,
    ("coopsim record highway --out highway.rec --frames 300 --seed 3",),
)


def _add_town(parser: argparse.ArgumentParser) -> None:
    does = parser.add_subparsers(required=True, metavar="COMMAND", dest="does", parser_class=Parser)
    draw = does.add_parser("draw", help="write the place of a seed as a scenario file, and as a picture from above")
    add = draw.add_argument
    add("seed", type=count_or_zero, metavar="SEED", help="of the place, as place_seed of the environment town")
    add("--junctions", type=count, metavar="N", help="where streets meet, 1 to 9 (default: drawn)")
    add("--openness", type=float, metavar="X", help="0: walls at the kerb, 1: wide lawns (default: drawn)")
    add("--lanes", type=count, metavar="N", help="most lanes a direction, 1 to 3 (default: drawn)")
    add("--out", type=Path, required=True, metavar="FILE.yaml", help="an older file is replaced")
    add("--picture", type=Path, metavar="FILE.png", help="draw the town from above as well")


def _run_town(options: argparse.Namespace) -> int:
    from coopsim.viz.portrait import require_picture, write_picture
    from coopsim.world.towns.options import TownOptions
    from coopsim.world.towns.scenarios import draw_town, write_town

    if options.picture is not None:
        require_picture(options.picture)
    town = draw_town(options.seed, TownOptions(options.junctions, options.openness, options.lanes))
    written = [write_town(options.out, town)]
    if options.picture is not None:
        written.append(write_picture(options.picture, town, options.seed))
    for path in written:
        print(f"written: {path}")
    return 0


TOWN = Command(
    "draw a town from a seed, and write it as a scenario file",
    _add_town,
    _run_town,
    ("coopsim town draw 7 --out town.yaml --picture town.png",),
)
