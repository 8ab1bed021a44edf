"""Draw a map from above, north up."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
from PIL import Image, ImageDraw

from coopsim.data.maps.street_map import DRIVEN, StreetMap, edges_of
from coopsim.geometry.se3 import Floats
from coopsim.viz.palette import RGB
from coopsim.viz.portrait import require_picture

_SIDE_PX, _SMOOTHING, _MARGIN = 1600, 2, 0.03
_GROUND: RGB = (238, 240, 234)
_LANES: dict[str, RGB] = {
    "other": (214, 217, 205),
    "shoulder": (176, 178, 180),
    "walk": (205, 190, 168),
    "park": (150, 160, 185),
    "rail": (140, 120, 110),
    "cycle": (196, 140, 130),
    "shared": (130, 120, 140),
    "bus": (120, 112, 92),
    "drive": (96, 98, 104),
}
"""Colours by kind; later kinds are drawn over earlier ones."""
_WAY: RGB = (112, 115, 122)
_MIDDLE: RGB = (250, 208, 92)
_CROSSING: RGB = (250, 250, 250)
_AREAS: dict[str, RGB] = {"walk": (214, 200, 180), "park": (165, 174, 196)}
_SOLIDS: dict[str, RGB] = {
    "building": (168, 108, 92), "wall": (90, 70, 60), "tree": (110, 150, 90), "pole": (60, 60, 60),
}  # fmt: skip
_SIGNALS: dict[str, RGB] = {
    "light": (40, 160, 70), "stop": (200, 40, 40), "yield": (230, 120, 30), "sign": (60, 90, 190),
}  # fmt: skip
_SIGNAL_PX = 3


def ribbon(line: Floats, width_m: Floats) -> Floats:
    """Return the outline (2K, 2) of a lane from its middle (K, 3) and width (K,)."""
    left, right = edges_of(line, width_m)
    return np.concatenate([left, right[::-1]])


def draw_map(streets: StreetMap) -> Image.Image:
    """Draw a map: lanes by kind, ways over junctions with their middles, crossings, signals and what stands there."""
    low, high = _extent(streets)
    scale = _SIDE_PX * _SMOOTHING / float((high - low).max())
    width, height = (max(int(side), 1) for side in ((high - low) * scale).tolist())
    picture = Image.new("RGB", (width, height), _GROUND)
    draw = ImageDraw.Draw(picture)

    def pixels(points: Floats) -> list[tuple[float, float]]:
        flat = (points[:, :2] - low) * scale
        return [(x, height - y) for x, y in flat.tolist()]

    for outline, color in _surfaces(streets):
        draw.polygon(pixels(outline), fill=color)
    thin = max(int(scale * 0.15), 1)
    for line in _middles(streets):
        draw.line(pixels(line), fill=_MIDDLE, width=thin)
    for solid in streets.solids:
        if solid.thickness_m is not None:
            wide = max(int(scale * solid.thickness_m), thin)
            draw.line(pixels(solid.line), fill=_SOLIDS[solid.kind], width=wide)
        else:
            draw.polygon(pixels(solid.line), fill=_SOLIDS[solid.kind])
    for signal in streets.signals:
        (x, y), r = pixels(signal.at[None])[0], _SIGNAL_PX * _SMOOTHING
        draw.ellipse((x - r, y - r, x + r, y + r), fill=_SIGNALS[signal.kind])
    size = max(width // _SMOOTHING, 1), max(height // _SMOOTHING, 1)
    return picture.resize(size, Image.Resampling.BOX)


def write_map_picture(path: Path, streets: StreetMap) -> Path:
    """Draw a map into a file.

    Raises:
        InvalidValueError: the file cannot be written, or its name is not that of an image.
    """
    require_picture(path)
    draw_map(streets).save(path)
    return path


def _extent(streets: StreetMap) -> tuple[Floats, Floats]:
    lines = [lane.line[:, :2] for lane in streets.lanes.values()] + [way.line[:, :2] for way in streets.ways.values()]
    points = np.concatenate(lines)
    low, high = points.min(axis=0), points.max(axis=0)
    margin = 5.0 + _MARGIN * float((high - low).max())
    return low - margin, high + margin


def _surfaces(streets: StreetMap) -> Iterator[tuple[Floats, RGB]]:
    """Yield outlines with their colours, from the lowest to the topmost."""
    yield from ((area.outline, _AREAS[area.kind]) for area in streets.areas)
    for kind, color in _LANES.items():
        if kind == "drive":
            yield from ((ribbon(way.line, way.width_m), _WAY) for way in streets.ways.values())
        yield from ((ribbon(lane.line, lane.width_m), color) for lane in streets.lanes.values() if lane.kind == kind)
    for crossing in streets.crossings:
        yield ribbon(crossing.line, np.full(len(crossing.line), crossing.width_m)), _CROSSING


def _middles(streets: StreetMap) -> Iterator[Floats]:
    yield from (lane.line for lane in streets.lanes.values() if lane.kind in DRIVEN)
    yield from (way.line for way in streets.ways.values())
