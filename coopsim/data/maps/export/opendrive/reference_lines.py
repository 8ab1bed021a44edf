"""Reference lines of ways over junctions."""

from __future__ import annotations

import numpy as np

from coopsim.data.maps.export.town_network import Way
from coopsim.geometry import exact
from coopsim.geometry.se3 import Floats, wrap_angle
from coopsim.world.places.road_network import Lane
from coopsim.world.towns.plan import Stretch

_EASED_M = 1.0
_STEPS = 8  # each leaves about a thousandth of the error


def stretch_of(lane: Lane) -> Stretch:
    """Return the middle of a straight or bent lane."""
    curvature = getattr(lane, "turn", 0) / lane.tightest_m
    return Stretch(lane.position(0.0, 0.0), lane.heading_at(0.0), lane.length, curvature)


def line_of(way: Way, heading_rad: tuple[float, float]) -> list[Stretch]:
    """Return the reference line of a way between lanes of these headings.

    Towns have ways that bend by less than 10 degrees as straight ones, with kinks at both ends. Here arcs of 1 m take
    the kinks' place, 5 cm aside at most, so that edges of lanes meet.
    """
    line = [stretch_of(lane) for lane in way.lanes]
    return line if len(line) > 1 or line[0].curvature_1_m else _eased(line[0], heading_rad)


def _eased(straight: Stretch, heading_rad: tuple[float, float]) -> list[Stretch]:
    """Return an arc, a straight piece and an arc between the ends of a straight line."""
    end = straight.position(np.array([straight.length_m]), np.zeros(1))[0]
    heading, length_m, arcs = straight.heading_rad, straight.length_m, list[Stretch]()
    for _ in range(_STEPS):
        bends = [float(wrap_angle(heading - heading_rad[0])), float(wrap_angle(heading_rad[1] - heading))]
        arcs = [
            Stretch(straight.start, heading_rad[0], _EASED_M, bends[0] / _EASED_M),
            Stretch(end, heading, _EASED_M, bends[1] / _EASED_M),
        ]
        middle = _end(arcs[0])
        last = end - (_end(arcs[1]) - end)
        heading, length_m = float(exact.arctan2(*(last - middle)[::-1])), float(exact.norm(last - middle))
    return [arcs[0], Stretch(middle, heading, length_m), Stretch(last, heading, _EASED_M, arcs[1].curvature_1_m)]


def _end(stretch: Stretch) -> Floats:
    """Return the place (2,) m where a stretch ends."""
    place: Floats = stretch.position(np.array([stretch.length_m]), np.zeros(1))[0]
    return place
