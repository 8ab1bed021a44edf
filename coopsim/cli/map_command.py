"""`coopsim map`: what is in a map of another program."""

from __future__ import annotations

import argparse
import warnings
from pathlib import Path
from typing import Any

from coopsim.cli.argument_types import count_or_zero
from coopsim.cli.arguments import Command
from coopsim.errors import InvalidValueError, MapWarning


def _add_map(parser: argparse.ArgumentParser) -> None:
    add = parser.add_argument
    formats = "OpenDRIVE (.xodr), SUMO (.net.xml), OpenStreetMap or Lanelet2 (.osm), plain or in gzip (.gz)"
    add("map", type=Path, metavar="FILE", help=formats)
    add("--picture", type=Path, metavar="FILE.png", help="draw the map, or a place of it, from above")
    add("--place-seed", type=count_or_zero, metavar="N", help="draw the place with this seed, as environments have it")
    add("--around", metavar="X,Y", help="draw the place around a point of the map's plane, m")
    add("--radius-m", type=float, help="of that place (default: 250)")


def _run_map(options: argparse.Namespace) -> int:
    from coopsim.data.maps.check import describe_map
    from coopsim.data.maps.picture import write_map_picture
    from coopsim.data.maps.reading import read_map
    from coopsim.viz.portrait import require_picture

    if options.picture is not None:
        require_picture(options.picture)
    elif options.place_seed is not None or options.around is not None or options.radius_m is not None:
        raise InvalidValueError("--place-seed, --around and --radius-m are of a --picture: name its file")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", MapWarning)  # the description has them
        streets = read_map(options.map)
    for line in describe_map(streets):
        print(line)
    if options.picture is not None:
        names = ("place_seed", "around", "radius_m")
        place = {name: value for name in names if (value := getattr(options, name)) is not None}
        written = _draw_place(options, place) if place else write_map_picture(options.picture, streets)
        print(f"written: {written}")
    return 0


def _draw_place(options: argparse.Namespace, place: dict[str, Any]) -> Path:
    from coopsim.viz.portrait import write_picture
    from coopsim.world.drawn_places import choose_scenarios

    seed = place.get("place_seed", 0)
    return write_picture(options.picture, choose_scenarios(str(options.map), **place).of(seed), seed)


MAP = Command(
    "read a map of another program: say what is in it, left out and repaired, check its lanes, and draw it",
    _add_map,
    _run_map,
    (
        "coopsim map Town05.xodr.gz --picture place.png --place-seed 3",
        "coopsim map cologne8.net.xml",
        "coopsim map district.osm",
    ),
)
