"""Raised pavements are beside the lanes, however they lie."""

from typing import Any

import numpy as np
import pytest

from coopsim.errors import InvalidValueError
from coopsim.world.custom.place import place_from

BESIDE = [[20.0, -8.0], [40.0, -8.0], [40.0, -3.9], [20.0, -3.9]]  # 0.1 m under the edge of the lane at y = -2


def read(outline: Any, kerb_m: float = 0.12, turn_rad: float = 0.0, **lane: float) -> None:
    """Read a straight road of two lanes, 4 m wide, with a pavement after a lawn."""
    cos, sin = np.cos(turn_rad), np.sin(turn_rad)

    def turned(points: Any) -> Any:
        return (np.array(points) @ [[cos, sin], [-sin, cos]]).tolist()

    corners = zip("abcd", turned([[0.0, -2.0], [60.0, -2.0], [60.0, 2.0], [0.0, 2.0]]), strict=True)
    roads = [{"from": start, "to": end, **lane} for start, end in (("a", "b"), ("c", "d"))]
    loops = [{"from": start, "to": end, "turn": "around"} for start, end in (("b", "c"), ("d", "a"))]
    paved = [{"outline": turned(BESIDE), "kind": "grass"}, {"outline": turned(outline), "kind": "pavement"}]
    place_from({"nodes": dict(corners), "roads": roads + loops, "paved": paved, "kerb_m": kerb_m}, "own")


ACROSS = {
    "a strip over both lanes": [[20.0, -8.0], [22.0, -8.0], [22.0, 8.0], [20.0, 8.0]],
    "an island in a lane": [[20.0, -2.2], [20.5, -2.2], [20.5, -1.9], [20.0, -1.9]],
    "all of the place": [[-90.0, -90.0], [90.0, -90.0], [90.0, 90.0], [-90.0, 90.0]],
    "a corner that points at the middle": [[20.0, -8.0], [24.0, -8.0], [22.0, -2.4]],
    "clockwise": [[20.0, -2.4], [40.0, -2.4], [40.0, -8.0], [20.0, -8.0]],
}


@pytest.mark.parametrize("turn_rad", [0.0, 0.7])
@pytest.mark.parametrize("outline", ACROSS.values(), ids=ACROSS)
def test_one_across_a_lane_is_refused(outline: Any, turn_rad: float) -> None:
    message = r"^paved\[1\]: a raised pavement must be at least 0.5 m from the middle of every lane.* in roads\["
    with pytest.raises(InvalidValueError, match=message):
        read(outline, turn_rad=turn_rad)
    read(outline, kerb_m=0.0, turn_rad=turn_rad)


def test_those_under_the_edges_of_lanes_are_accepted() -> None:
    read(BESIDE)
    read([[20.0, -8.0], [40.0, -8.0], [40.0, -2.6], [20.0, -2.6]], width_m=2.5)
