"""A made map: two streets that cross, each with a lane in both directions."""

from __future__ import annotations

from typing import Any

import numpy as np

from coopsim.data.maps.street_map import StreetJunction, StreetLane, StreetMap, StreetWay
from coopsim.geometry.se3 import Floats

ARM_M, STOP_M, ASIDE_M, WIDE_M = 150.0, 12.0, 1.75, 3.5


def turned(points: Floats, quarter: int) -> Floats:
    """Return points (N, 3) turned by quarters about the origin."""
    cos, sin = (1, 0, -1, 0)[quarter % 4], (0, 1, 0, -1)[quarter % 4]
    return np.asarray(points, dtype=np.float64) @ np.array([[cos, sin, 0], [-sin, cos, 0], [0, 0, 1]])


def line(*points: tuple[float, float]) -> Floats:
    return np.array([[x, y, 0.0] for x, y in points])


def lane(name: str, kind: Any, points: Floats, width_m: float = WIDE_M, speed_m_s: float | None = 13.9) -> StreetLane:
    return StreetLane(name, name, kind, points, np.full(len(points), width_m), speed_m_s)


def crossroads(*, walks: bool = False, speed_m_s: float = 13.9, **more: Any) -> StreetMap:
    """Make the map; with `walks` each street has pavements of 2 m, right beside its lanes."""
    lanes, ways = {}, {}
    for k in range(4):
        into, out = line((ARM_M, ASIDE_M), (STOP_M, ASIDE_M)), line((STOP_M, -ASIDE_M), (ARM_M, -ASIDE_M))
        lanes[f"in{k}"] = lane(f"in{k}", "drive", turned(into, k), speed_m_s=speed_m_s)
        lanes[f"out{k}"] = lane(f"out{k}", "drive", turned(out, k), speed_m_s=speed_m_s)
        for side in (1.0, -1.0) if walks else ():
            y = side * (2 * ASIDE_M + 1.0)
            name = f"walk{k}{'lr'[side < 0]}"
            lanes[name] = lane(name, "walk", turned(line((STOP_M, y), (ARM_M, y)), k), 2.0)
    for k in range(4):
        for step in (1, 2, 3):
            start, end = lanes[f"in{k}"].line[-1:], lanes[f"out{(k + step) % 4}"].line[:1]
            middle = (start + end) / 2 * (0.5 if step != 2 else 1.0)
            name, path = f"in{k}>out{(k + step) % 4}", np.concatenate([start, middle, end])
            ways[name] = StreetWay(
                name, f"in{k}", f"out{(k + step) % 4}", "J", path, np.full(3, WIDE_M), None, "straight"
            )
    return StreetMap(
        source="made", format="made", lanes=lanes, links={}, ways=ways, junctions={"J": StreetJunction("J", "")}, **more
    )
