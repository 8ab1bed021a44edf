"""Surroundings of a log: a place of a map, or flat ground on which the ways of the log's vehicles are shown."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from coopsim.data.logs.track_log import TrackLog
from coopsim.data.maps.place.scenarios import open_file, place_around
from coopsim.geometry import exact
from coopsim.geometry.outlines import along_of
from coopsim.geometry.se3 import Floats
from coopsim.world.places.layout import GROUND, Layout, flat_part, flights_around, rectangle
from coopsim.world.places.road_network import RoadNetwork
from coopsim.world.places.streets import RSU_HEIGHT_M
from coopsim.world.snapshot import RoadMap, StaticPart

_MARGIN_M, _HALF_M, _STEP_M = 60.0, 1.7, 4.0


def map_ground(path: str, middle: Floats, radius_m: float, seed: int) -> Layout:
    """Return the place of a map around a point, whose plane is the log's.

    Raises:
        MapFileError: the file cannot be read.
        InvalidValueError: there is no road there that can be driven.
    """
    x, y = middle.tolist()
    return place_around(open_file(path), (x, y), radius_m, seed).make_layout()


def flat_ground(
    log: TrackLog, radius_m: float, houses: Sequence[StaticPart] = (), footprints: Sequence[Floats] = ()
) -> Layout:
    """Return flat ground with nothing but houses (see `lots.py`) on it; its map shows where vehicles drove."""
    reach = radius_m + _MARGIN_M
    ground = rectangle((-reach, reach), (-reach, reach))
    return Layout(
        network=RoadNetwork(),
        slots=(),
        connected_order=(),
        rsus=(),
        rsu_height_m=RSU_HEIGHT_M,
        speeds_m_s=(0.0,),
        static=(flat_part("ground", [ground], 0.0, GROUND, 0.2), *houses),
        road_map=RoadMap(tuple(_ways(log)), (), (), tuple(footprints)),
        flights=flights_around(np.zeros(2)),
    )


def _ways(log: TrackLog) -> list[Floats]:
    """Return polygons along the ways of vehicles, of the width of a lane."""
    found = []
    for k in range(len(log.ids)):
        line = log.place[log.first[k] : log.first[k + 1], :2]
        gone = along_of(line)
        rows = np.unique(np.searchsorted(gone, np.arange(0.0, gone[-1], _STEP_M)))
        if len(rows) < 2 or log.size[k, 0] < 2.5:
            continue
        heading = log.heading[log.first[k] : log.first[k + 1]][rows]
        aside = _HALF_M * np.column_stack([-exact.sin(heading), exact.cos(heading)])
        found.append(np.concatenate([line[rows] + aside, (line[rows] - aside)[::-1]]))
    return found
