"""Puts furniture and plants into any layout, as many as real streets have (see `densities`)."""

from __future__ import annotations

from typing import Any

import numpy as np

from coopsim.geometry.se3 import Floats
from coopsim.world.furniture.densities import BACK, BACK_LINES, KERB, KERB_LINES, VERGE, VERGE_LINES
from coopsim.world.furniture.kept_free import lanes_of, obstacles_of
from coopsim.world.furniture.lining import Lining
from coopsim.world.furniture.plot import Plot
from coopsim.world.furniture.stations import fronts, street_sides, way_sides
from coopsim.world.places.layout import Layout

_AROUND_M = 60.0  # beyond the ends of lanes and ways
_AHEAD_M = 1_500.0  # where traffic is kept up around cars that go on and on along x


def furnish(layout: Layout, seed: int) -> list[dict[str, Any]]:
    """Return furniture and plants for a layout, as entries of the key `furniture` of a place.

    What stands where depends on the layout and the seed alone. Nothing stands on roads or where long vehicles sweep
    over their edges, near the lines along which people walk and ride (`kept_free.WALK_M`), on crosswalks, in bays, in
    buildings or in another piece. Numbers are rounded to millimetres.
    """
    area = _area(layout)
    lanes, plot = lanes_of(layout, area), Plot(obstacles_of(layout, area))
    kerbs, backs = street_sides(layout, area, lanes), way_sides(layout, lanes)
    lining = Lining(seed, plot)
    lining.crosswalks(kerbs, layout.road_map.crosswalks)
    walked = layout.footways is not None
    lining.rows("kerb", [row for row in (KERB if walked else VERGE) if not row.fills], kerbs)
    lining.lines("kerb", KERB_LINES if walked else VERGE_LINES, kerbs)
    lining.rows("kerb", [row for row in (KERB if walked else VERGE) if row.fills], kerbs)
    lining.fronts(*fronts(layout))
    lining.rows("back", [row for row in BACK if not row.fills], backs)
    lining.lines("back", BACK_LINES, backs)
    lining.rows("back", [row for row in BACK if row.fills], backs)
    return plot.entries


def _area(layout: Layout) -> Floats:
    """Return the least and greatest x and y (2, 2) m of what is furnished: everything, but not all of endless roads."""
    ends = [lane.position(along, 0.0) for lane in layout.network.lanes.values() for along in (0.0, lane.length)]
    if layout.window_m is not None:
        ends = [layout.network.get_lane(slot.lane).position(slot.along_m, 0.0) for slot in layout.slots]
    nodes = [] if layout.footways is None else list(layout.footways.nodes)
    points = np.array([*ends, *nodes, *(rsu.translation[:2] for rsu in layout.rsus)])
    area = np.stack([points.min(axis=0) - _AROUND_M, points.max(axis=0) + _AROUND_M])
    if layout.window_m is not None:
        area[:, 0] = area[0, 0] - layout.window_m, area[1, 0] + _AHEAD_M
    return area
