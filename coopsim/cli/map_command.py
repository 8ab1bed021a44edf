"""`coopsim map`: what is in a map of another program."""

from __future__ import annotations

import argparse
import warnings
from pathlib import Path

from coopsim.cli.arguments import Command
from coopsim.errors import MapWarning


def _add_map(parser: argparse.ArgumentParser) -> None:
    add = parser.add_argument
    formats = "OpenDRIVE (.xodr), SUMO (.net.xml), OpenStreetMap or Lanelet2 (.osm), plain or in gzip (.gz)"
    add("map", type=Path, metavar="FILE", help=formats)
    add("--picture", type=Path, metavar="FILE.png", help="draw the map from above")


def _run_map(options: argparse.Namespace) -> int:
    from coopsim.data.maps.check import describe_map
    from coopsim.data.maps.picture import write_map_picture
    from coopsim.data.maps.reading import read_map
    from coopsim.viz.portrait import require_picture

    if options.picture is not None:
        require_picture(options.picture)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", MapWarning)  # the description has them
        streets = read_map(options.map)
    for line in describe_map(streets):
        print(line)
    if options.picture is not None:
        print(f"written: {write_map_picture(options.picture, streets)}")
    return 0


MAP = Command(
    "read a map of another program: say what is in it, left out and repaired, check its lanes, and draw it",
    _add_map,
    _run_map,
    ("coopsim map Town05.xodr.gz --picture town05.png", "coopsim map cologne8.net.xml", "coopsim map district.osm"),
)
