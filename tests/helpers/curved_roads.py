"""Places with curved lanes: an oval of two long lanes, and a crossing whose turns are curved."""

from __future__ import annotations

import numpy as np

from coopsim.world.places.description import MapLane, PlaceDescription, line_of


def arc(centre: tuple[float, float], radius_m: float, from_rad: float, to_rad: float, pieces: int) -> np.ndarray:
    """Return points (pieces + 1, 2) m on an arc."""
    phase = np.linspace(from_rad, to_rad, pieces + 1)
    return np.array(centre) + radius_m * np.column_stack([np.cos(phase), np.sin(phase)])


def oval(radius_m: float = 30.0, half_m: float = 50.0, pieces: int = 12, **lane: object) -> PlaceDescription:
    """Return a closed way, counter-clockwise, of two curved lanes: each a straight and half a turn."""
    east = np.vstack([[-half_m, -radius_m], arc((half_m, 0.0), radius_m, -np.pi / 2, np.pi / 2, pieces)])
    nodes = {"a": (-half_m, -radius_m), "b": (half_m, radius_m)}
    via = line_of(east[1:-1])
    back = line_of(-east[1:-1])
    roads = (MapLane("a", "b", via=via, curved=True, **lane), MapLane("b", "a", via=back, curved=True, **lane))
    return PlaceDescription(nodes=nodes, roads=roads)
