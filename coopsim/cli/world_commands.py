"""`coopsim record` and `coopsim town`: traffic and towns as files."""

from __future__ import annotations

import argparse
from pathlib import Path

import coopsim
from coopsim.catalog import is_scenario_file, scenario_file_options, scenario_of_file
from coopsim.cli.argument_types import count, count_or_zero
from coopsim.cli.arguments import Command, Parser, add_options, add_population, named_options, population
from coopsim.errors import InvalidValueError


def _add_record(parser: argparse.ArgumentParser) -> None:
    add = parser.add_argument
    add("scenario", help="as crossing or highway, or path of a scenario file")
    add("--seed", type=count_or_zero, help="default: 0, or the scenario file's own")
    add("--frames", type=count, default=600, help="steps (default: %(default)s)")
    of = "an older file is replaced; Ctrl-C keeps the frames so far"
    add("--out", type=Path, required=True, metavar="FILE", help=of)
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
    draw = does.add_parser("draw", help="write the place of a seed as a scenario file, or draw a place from above")
    add = draw.add_argument
    of = "of the place, as place_seed of the environment town; or a scenario file, whose place --picture draws"
    add("place", type=_place, metavar="SEED or FILE.yaml", help=of)
    add("--junctions", type=count, metavar="N", help="where streets meet, 1 to 9 (default: drawn)")
    add("--openness", type=float, metavar="X", help="0: walls at the kerb, 1: wide lawns (default: drawn)")
    add("--lanes", type=count, metavar="N", help="most lanes a direction, 1 to 3 (default: drawn)")
    add("--traffic-lights", action="store_true", help="at junctions of main roads")
    add("--traffic-side", default="right", metavar="SIDE", help="of the road: right or left (default: %(default)s)")
    add("--out", type=Path, metavar="FILE.yaml", help="of a SEED: an older file is replaced")
    add("--picture", type=Path, metavar="FILE.png", help="draw the place from above")


def _run_town(options: argparse.Namespace) -> int:
    from coopsim.viz.portrait import require_picture, write_picture
    from coopsim.world.drawn_options import TownOptions
    from coopsim.world.towns.scenarios import draw_town, write_town

    if options.picture is not None:
        require_picture(options.picture)
    given = TownOptions(
        options.junctions, options.openness, options.lanes, options.traffic_lights, options.traffic_side
    )
    if isinstance(options.place, Path):
        written = [_picture_of_file(options, drawn=given != TownOptions())]
    else:
        if options.out is None:
            raise InvalidValueError("--out must name the scenario file to write: FILE.yaml")
        town = draw_town(options.place, given)
        written = [write_town(options.out, town)]
        if options.picture is not None:
            written.append(write_picture(options.picture, town, options.place))
    for path in written:
        print(f"written: {path}")
    return 0


def _place(text: str) -> int | Path:
    """Parse the seed of a place, or the path of a scenario file."""
    return Path(text) if is_scenario_file(text) else count_or_zero(text)


def _picture_of_file(options: argparse.Namespace, *, drawn: bool) -> Path:
    """Draw the place of a scenario file; `drawn` tells that options of drawn towns are given."""
    from coopsim.viz.portrait import write_picture
    from coopsim.world.drawn_places import TOWN as DRAWN
    from coopsim.world.scenario import NUMBERS, make_scenario
    from coopsim.world.situations.situation import NAMED

    if options.picture is None or options.out is not None or drawn:
        raise InvalidValueError("of a scenario file --picture FILE.png is drawn: give that, and no option of a seed")
    place, keywords = scenario_of_file(options.place), scenario_file_options(options.place)
    if place in (NAMED, DRAWN):
        raise InvalidValueError(f"{options.place}: the place is drawn anew for each seed; accepted: a file with place")
    numbers = {name: keywords[name] for name in (*NUMBERS, "detail") if name in keywords}
    return write_picture(options.picture, make_scenario(place, **numbers), keywords.get("seed") or 0)


TOWN = Command(
    "draw a town from a seed, and write it as a scenario file; or draw the place of a file",
    _add_town,
    _run_town,
    ("coopsim town draw 7 --out town.yaml --picture town.png", "coopsim town draw junction.yaml --picture place.png"),
)
