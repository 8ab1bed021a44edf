"""The drawing of a place from above: one for renders, clips and the gallery, in the colours of the palette."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache

import numpy as np
from PIL import Image, ImageDraw, ImageFont

from coopsim.geometry.boxes import Boxes3D
from coopsim.geometry.se3 import Floats
from coopsim.viz import palette
from coopsim.world.places.signals import stop_bars
from coopsim.world.snapshot import RoadMap

_NAME_PX = 14


def outlines(boxes: Boxes3D) -> Floats:
    """Return footprints (N, 4, 2) m, counter-clockwise from front-left."""
    return boxes.corners[:, :4, :2]


def box_of(body: Floats) -> Boxes3D:
    """Return a footprint (5,) x, y, length, width, m, and yaw, rad, as a box of 1 m height."""
    x, y, length, width, yaw = body.tolist()
    return Boxes3D.from_array([[x, y, 0.5, length, width, 1.0, yaw]])


class FromAbove:
    """A picture from above, north up: the ground once, and over it whatever a frame has.

    Args:
        road_map: outlines of the place.
        center_m: place (2,) in the middle.
        px_per_m: scale.
        size_px: width and height.
        fine: pixels drawn for each pixel shown, along either axis: 1, or 2 for smooth edges.
    """

    def __init__(
        self, road_map: RoadMap, center_m: Sequence[float], px_per_m: float, size_px: tuple[int, int], fine: int = 1
    ) -> None:
        self._center, self._scale, self._size, self._fine = np.asarray(center_m), fine * px_per_m, size_px, fine
        self._ground = Image.new("RGB", (fine * size_px[0], fine * size_px[1]), palette.BACKGROUND)
        self._picture, self._draw = self._ground, ImageDraw.Draw(self._ground)
        for name, color in palette.MAP.items():
            outlines = [self.pixels(polygon) for polygon in getattr(road_map, name)]
            for outline in outlines if name == "pavements" else ():  # under all of them, so that no joint has a kerb
                self._draw.line([*outline, outline[0]], palette.KERB, 3 * fine, joint="curve")
            for outline in outlines:
                self._draw.polygon(outline, color)

    def begin(self) -> None:
        """Begin a frame on the bare ground."""
        self._picture = self._ground.copy()
        self._draw = ImageDraw.Draw(self._picture)

    def done(self) -> Image.Image:
        """Return the frame."""
        return self._picture.reduce(self._fine) if self._fine > 1 else self._picture

    def pixels(self, points: Floats) -> list[tuple[float, float]]:
        """Return the pixels of points (N, 2) m."""
        return [(x, y) for x, y in self._pixels(points).tolist()]

    def _pixels(self, points: Floats) -> Floats:
        shifted = (np.asarray(points, dtype=np.float64) - self._center) * [self._scale, -self._scale]
        return np.clip(shifted + self._fine * np.array(self._size) / 2, -1e4, 1e4)  # type: ignore[no-any-return]

    def lights(self, stop_lines: Sequence[Floats], letters: str) -> None:
        """Draw bars at stop lines in the colours of their lights."""
        for bar, letter in zip(stop_bars(stop_lines, palette.BAR_M), letters, strict=False):
            self._draw.polygon(self.pixels(bar), palette.LIGHT[letter])

    def points(self, points: Floats) -> None:
        """Draw points (N, 2), a pixel that is shown each; those outside are left out."""
        found = self._fine * np.floor(self._pixels(points) / self._fine).astype(np.int64)
        block = np.indices((self._fine, self._fine)).reshape(2, -1).T
        found = (found[:, None] + block).reshape(-1, 2)
        inside = found[((found >= 0) & (found < self._picture.size)).all(axis=1)]
        array = np.array(self._picture)
        array[inside[:, 1], inside[:, 0]] = palette.POINT
        self._picture = Image.fromarray(array)
        self._draw = ImageDraw.Draw(self._picture)

    def shape(
        self, corners: Floats, fill: palette.RGB | None, edge: palette.RGB | None = None, width: float = 1
    ) -> None:
        """Draw a polygon (K, 2) m, `width` px about it."""
        self._draw.polygon(self.pixels(corners), fill, edge, width=round(width * self._fine) if edge else 0)

    def line(self, points: Floats, color: palette.RGB, width: float = 1) -> None:
        """Draw a line through points (K, 2) m."""
        self._draw.line(self.pixels(points), color, round(width * self._fine))

    def box(self, corners: Floats, color: palette.RGB, width: int) -> None:
        """Draw a footprint (4, 2) from front-left, with a line to its front; `width` 0: filled."""
        self.shape(corners, None if width else color, color if width else None, width)
        front, middle = (corners[0] + corners[3]) / 2, corners.mean(axis=0)
        tick = color if width else palette.BACKGROUND
        self.line(np.stack([front, 0.4 * front + 0.6 * middle]), tick, max(width, 2))

    def false(self, corners: Floats) -> None:
        """Draw a footprint where nothing is: thin, grey and crossed out."""
        self.shape(corners, None, palette.FALSE_TRACK)
        for one, other in ((0, 2), (1, 3)):
            self.line(corners[[one, other]], palette.FALSE_TRACK)

    def ring(self, place: Floats, color: palette.RGB, radius_px: float, width: int = 1) -> None:
        """Draw a ring about a place (2,)."""
        self._round(place, radius_px, outline=color, width=width * self._fine)

    def dot(self, place: Floats, color: palette.RGB, radius_px: float) -> None:
        """Draw a dot."""
        self._round(place, radius_px, fill=color)

    def write(self, text: str, place: Floats, shift_px: tuple[int, int], color: palette.RGB) -> None:
        """Write beside a place (2,)."""
        ((x, y),) = self.pixels(place[None])
        shifted = x + self._fine * shift_px[0], y + self._fine * shift_px[1]
        on_halo(self._draw, shifted, text, color, self._fine * _NAME_PX)

    def _round(self, place: Floats, radius_px: float, **how: int | palette.RGB) -> None:
        ((x, y),) = self.pixels(place[None])
        r = self._fine * radius_px
        self._draw.ellipse((x - r, y - r, x + r, y + r), **how)  # type: ignore[arg-type]


def on_halo(draw: ImageDraw.ImageDraw, spot: tuple[float, float], text: str, color: palette.RGB, size_px: int) -> None:
    """Write on a dark halo, to be read over anything."""
    draw.text(spot, text, color, font_of(size_px), stroke_width=2, stroke_fill=palette.BACKGROUND)


@lru_cache
def font_of(size_px: int) -> ImageFont.FreeTypeFont | ImageFont.ImageFont:
    """Return pillow's own font in a size."""
    return ImageFont.load_default(size_px)
