"""`coopsim record`."""

from __future__ import annotations

import argparse
from pathlib import Path

import coopsim
from coopsim.cli.arguments import add_options, add_population, count, count_or_zero, named_options, population

HELP = "simulate traffic and record it to a file that demos can play back"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
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


def run(options: argparse.Namespace) -> int:
    """Run the command. Return the exit status."""
    from coopsim.world.recording.episode_file import Episode

    given = {**population(options), **named_options(options, {"max_cycles": "--frames", "seed": "--seed"})}
    if options.seed is not None:
        given["seed"] = options.seed
    coopsim.record(options.scenario, options.out, max_cycles=options.frames, **given)
    episode = Episode(options.out)
    per_frame = episode.size_bytes / episode.frames
    print(f"written: {options.out}, {episode.frames} frames, {per_frame:.0f} bytes a frame")
    return 0
