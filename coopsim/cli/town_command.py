"""`coopsim town`."""

from __future__ import annotations

import argparse
from pathlib import Path

from coopsim.cli.arguments import Parser, count, count_or_zero

HELP = "draw a town from a seed, and write it as a scenario file"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    does = parser.add_subparsers(required=True, metavar="COMMAND", dest="does", parser_class=Parser)
    draw = does.add_parser("draw", help="write the place of a seed as a scenario file, and as a picture from above")
    add = draw.add_argument
    add("seed", type=count_or_zero, metavar="SEED", help="of the place, as place_seed of the environment town")
    add("--junctions", type=count, metavar="N", help="where streets meet, 1 to 9 (default: drawn)")
    add("--openness", type=float, metavar="X", help="0: walls at the kerb, 1: wide lawns (default: drawn)")
    add("--lanes", type=count, metavar="N", help="most lanes a direction, 1 to 3 (default: drawn)")
    add("--out", type=Path, required=True, metavar="FILE.yaml", help="an older file is replaced")
    add("--picture", type=Path, metavar="FILE.png", help="draw the town from above as well")


def run(options: argparse.Namespace) -> int:
    """Run the command. Return the exit status."""
    from coopsim.viz.town_picture import require_picture, write_picture
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
