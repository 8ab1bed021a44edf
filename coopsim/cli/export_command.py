"""`coopsim export`."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from coopsim.cli.arguments import (
    INTERRUPTED,
    add_options,
    add_population,
    count,
    named_options,
    population,
    seeds,
)

HELP = "simulate episodes and write them in the format of a data set, as opv2v"

_FLAGS = {"max_cycles": "--frames", "seed": "--seeds", "sense_every": "dt_s"}
"""Options that must be given otherwise, and how."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    add = parser.add_argument
    add("format", metavar="FORMAT", help="see `list`; as opv2v, or opv2v(lidar=roof)")
    add("environment", metavar="ENVIRONMENT", help="as crossing or town, or path of a scenario file; see `list`")
    add(
        "--out",
        type=Path,
        required=True,
        metavar="DIR",
        help="new or empty; the same command again goes on with an export that was interrupted",
    )
    add("--seeds", type=seeds, default=(0,), metavar="0-4", help="an episode each (default: 0)")
    add("--frames", type=count, default=100, help="of each episode (default: %(default)s)")
    add_population(parser)
    add_options(parser, "of the environment, as cameras=surround, lidar=OS1-128 or dt_s=0.5")


def run(options: argparse.Namespace) -> int:
    """Run the command. Return the exit status."""
    from tqdm import tqdm

    from coopsim.data.export.export_card import DONE, PAGE, PICTURE, read_card
    from coopsim.data.export.export_run import export

    given = {**population(options), **named_options(options, _FLAGS)}
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
