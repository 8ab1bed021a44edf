"""Logged ways as lanes for drivers: where they lead, how fast one drives there, and where somebody stood."""

from __future__ import annotations

import numpy as np

from coopsim.data.logs.play.paths import Paths, far_apart
from coopsim.data.logs.track_log import TrackLog
from coopsim.geometry import exact
from coopsim.geometry.se3 import Floats
from coopsim.types import Ints
from coopsim.world.places.polyline import PolylineLane
from coopsim.world.places.road_network import RoadNetwork
from coopsim.world.traffic.lanes import NumberedNetwork

_SPACING_M, _WIDTH_M = 2.0, 3.5
_CELL_M, _CELL_RAD, _USUAL = 4.0, np.pi / 4, 85.0
_STOOD_S, _STOOD_M = 2.0, 1.25


def limits_m_s(log: TrackLog, tracks: Ints, paths: Paths) -> Floats:
    """Return how fast one drives on ways (R,), m/s, as nobody knows the limits.

    That is the fastest that the log has anybody of some tracks at their places, in their direction, of which 85 % of a
    way's places have no more: limits are set so.
    """
    rows = np.isin(log.track, tracks)
    speed = exact.norm(log.velocity[rows])
    cells = np.concatenate([_cells(log.place[rows], log.heading[rows]), _cells(paths.xy, paths.heading)])
    _, cell = np.unique(cells, axis=0, return_inverse=True)
    fastest = np.zeros(cell.max() + 1)
    np.maximum.at(fastest, cell.ravel()[: len(speed)], speed)
    here = np.split(fastest[cell.ravel()[len(speed) :]], paths.first[1:-1])
    return np.array([np.percentile(each, _USUAL) for each in here])


def _cells(xy: Floats, heading: Floats) -> Ints:
    """Return the cells (N, 3) of places and directions."""
    turn = np.round(heading / _CELL_RAD) % round(2 * np.pi / _CELL_RAD)
    return np.column_stack([np.floor(xy[:, :2] / _CELL_M), turn]).astype(np.int64)


def lanes_along(paths: Paths, limit_m_s: Floats) -> NumberedNetwork:
    """Return a road of one lane along each way (R,), with a speed limit each (R,)."""
    network = RoadNetwork()
    kept = far_apart(paths.xy, paths.owner, _SPACING_M)
    kept[paths.first[1:] - 1] = True
    for k, limit in enumerate(limit_m_s.tolist()):
        of = slice(*paths.first[k : k + 2])
        network.add_lane(f"{k}", f"{k} end", PolylineLane(paths.xy[of][kept[of]], _WIDTH_M, limit))
    return NumberedNetwork(network)


def halts_of(paths: Paths, ways: Ints) -> tuple[Ints, Floats, Floats]:
    """Return where road users stood in their log: way (H,), m along it, and time (s) at which they went on."""
    at = np.flatnonzero(np.isin(paths.owner, ways))
    ends = np.isin(at, paths.first[1:] - 1)
    after = np.where(ends, at, at + 1)
    until_s = np.where(ends, paths.last_s[paths.owner[at]], paths.time_s[after])
    stood = (until_s - paths.time_s[at] >= _STOOD_S) & (paths.along[after] - paths.along[at] <= _STOOD_M)
    return paths.owner[at[stood]], paths.along[at[stood]], until_s[stood]
