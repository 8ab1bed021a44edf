"""Pictures of whole towns from above."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from PIL import Image

from coopsim.errors import InvalidValueError
from coopsim.support.files import require_writable
from coopsim.viz.overhead import draw_overhead
from coopsim.world.scenario import Scenario
from coopsim.world.world import World

PICTURES = (".png", ".jpg", ".jpeg")
"""Endings of the names of pictures."""

_MARGIN_M = 15.0
_PICTURE_PX = 900


def require_picture(path: Path) -> None:
    """Raise `InvalidValueError` if a picture cannot be written there: to be called before it is drawn."""
    if path.suffix.lower() not in PICTURES:
        raise InvalidValueError(f"picture must end in {', '.join(PICTURES)}, got {str(path)!r}")
    require_writable(path)


def write_picture(path: Path, town: Scenario, seed: int) -> Path:
    """Draw all of a town from above at the start of the episode with this seed; agents are ringed.

    Raises:
        InvalidValueError: the file cannot be written, or its name is not that of a picture.
    """
    require_picture(path)
    corners = np.concatenate(town.layout.road_map.lanes)
    low, high = corners.min(axis=0), corners.max(axis=0)
    side_m = float((high - low).max()) + 2 * _MARGIN_M
    Image.fromarray(draw_overhead(World(town, seed), (low + high) / 2, side_m, _PICTURE_PX)).save(path)
    return path
