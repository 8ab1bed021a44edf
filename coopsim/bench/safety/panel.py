"""A panel of a clip: a recorded run from above at any moment, as the driven car knows it."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from PIL import Image, ImageDraw, ImageFont

from coopsim.bench.films.recording import Recording
from coopsim.geometry.boxes import Boxes3D
from coopsim.geometry.se3 import Floats
from coopsim.viz import palette
from coopsim.viz.bev import SCALE_BAR_M, outlines
from coopsim.world.places.signals import stop_bars

FINE = 2
"""Pixels drawn for each pixel shown, along either axis."""

BODY, HIDDEN, KNOWN = (92, 98, 107), (226, 230, 236), (255, 122, 66)
"""Colours of bodies, and of what the car must not touch: while it does not know of it, and once it does."""

TOLD, TRACK, BRAKE, CRASH = (92, 200, 255), palette.TRACK, (255, 64, 64), (255, 84, 84)
"""Colours of messages, of reported tracks, of brake lights and of a crash."""

_LEAST_PX = 4.5
"""Half of the smallest length of a body in a picture: a person would be 2 pixels wide."""

_MARGIN_M, _SPANS_M = 24.0, (46.0, 150.0)
"""Free ground about what is shown, and the least and largest height of a view."""

_SHOWN_S = 0.6
"""Time for which an arrived message is shown."""

_BRAKES_M_S2 = 1.0
"""Deceleration from which brake lights are drawn; UN Regulation 13-H, 5.2.22.4, allows them from 0.7 and asks for them
from 1.3 m/s²."""


@dataclass(frozen=True, slots=True)
class View:
    """A part of the world.

    Attributes:
        center_m: its middle (2,) in the world frame.
        span_m: its least height.
    """

    center_m: tuple[float, float]
    span_m: float

    @classmethod
    def of(cls, recordings: Sequence[Recording], from_s: float, shape: float = 1.0) -> View:
        """Find a view that shows the driven cars from a time on, and what they must not touch when they are nearest.

        `shape` is the width of the picture by its height.
        """
        places = [each.drive.car[each.drive.time_s >= from_s - 1e-9, :2] for each in recordings]
        for each in recordings:
            met = each.drive.boxes[max(each.events.closest, 0)][each.drive.in_conflict, :2]
            places.append(met[np.isfinite(met).all(axis=1)])
        corners = np.concatenate(places)
        low, high = corners.min(axis=0), corners.max(axis=0)
        middle, extent = (low + high) / 2, high - low + _MARGIN_M
        span_m = float(np.clip(max(extent[0] / shape, extent[1]), *_SPANS_M))
        return cls((float(middle[0]), float(middle[1])), span_m)


class Panel:
    """A view of a recording, drawn for any moment."""

    def __init__(self, recording: Recording, view: View, size_px: tuple[int, int]) -> None:
        self._recording, self._view, self._size = recording, view, size_px
        self._scale = FINE * min(size_px) / view.span_m
        self._ground = self._draw_ground()
        self._bars = stop_bars(recording.film.road_map.stop_lines, palette.BAR_M)

    def draw(self, time_s: float) -> Image.Image:
        """Draw the run at a time since the episode's start; after its last frame it stands still."""
        record = self._recording
        now = record.at(time_s)
        fine = self._ground.copy()
        draw = ImageDraw.Draw(fine)
        for bar, letter in zip(self._bars, record.lights_at(time_s), strict=False):
            draw.polygon(self._pixels(bar), palette.LIGHT[letter])
        self._dots(draw, record.points_at(time_s))
        self._way(draw, now.way)
        for body in now.bodies:
            self._body(draw, body, BODY)
        for body, known in now.conflicts:
            self._body(draw, body, KNOWN if known else None, None if known else HIDDEN)
            self._ring(draw, body[:2], KNOWN if known else HIDDEN, (13,))
        for body in now.false_tracks:
            self._false(draw, body)
        for body in now.tracks:
            self._body(draw, body, None, TRACK, grow_m=0.35)
        for place in now.agents.values():
            self._ring(draw, place, palette.AGENT, (5, 9))
        self._car(draw, now.car, now.acceleration_m_s2)
        for sender, age_s in record.arrivals(time_s, _SHOWN_S):
            if sender in now.agents:
                self._message(draw, now.agents[sender], now.car[:2], 1 - age_s / _SHOWN_S)
        if record.events.crash_s is not None and time_s >= record.events.crash_s - 1e-9:
            self._burst(draw, now.car)
        shown = fine.reduce(FINE)
        self._words(ImageDraw.Draw(shown), now.agents)
        return shown

    def _draw_ground(self) -> Image.Image:
        ground = Image.new("RGB", (FINE * self._size[0], FINE * self._size[1]), palette.BACKGROUND)
        draw = ImageDraw.Draw(ground)
        for name, color in palette.MAP.items():
            for polygon in getattr(self._recording.film.road_map, name):
                draw.polygon(self._pixels(polygon), color)
        return ground

    def _pixels(self, points: Floats) -> list[tuple[float, float]]:
        shifted = (np.asarray(points, dtype=np.float64) - self._view.center_m) * [self._scale, -self._scale]
        found = np.clip(shifted + FINE * np.array(self._size) / 2, -1e4, 1e4)
        return [(x, y) for x, y in found.tolist()]

    def _dots(self, draw: ImageDraw.ImageDraw, points: Floats) -> None:
        for x, y in self._pixels(points):
            draw.rectangle((x, y, x + 1, y + 1), palette.POINT)

    def _way(self, draw: ImageDraw.ImageDraw, way: Floats) -> None:
        for start, end in zip(way[:-1:4], way[2::4], strict=False):
            draw.line(self._pixels(np.stack([start, end])), (128, 112, 66), FINE)

    def _body(
        self,
        draw: ImageDraw.ImageDraw,
        body: Floats,
        fill: palette.RGB | None,
        edge: palette.RGB | None = None,
        grow_m: float = 0.0,
    ) -> None:
        """Draw a body (5,), its outline wider by `grow_m` on each side."""
        x, y, length, width, yaw = body.tolist()
        least = FINE * 2 * _LEAST_PX / self._scale
        size = [max(length, least) + 2 * grow_m, max(width, least) + 2 * grow_m, 1.0]
        corners = outlines(Boxes3D.from_array([[x, y, 0.5, *size, yaw]]))[0]
        draw.polygon(self._pixels(corners), fill, edge, width=round(1.5 * FINE) if edge else 0)

    def _false(self, draw: ImageDraw.ImageDraw, body: Floats) -> None:
        """Cross out a track where nothing is, thinly."""
        corners = self._pixels(outlines(Boxes3D.from_array([[*body[:2], 0.5, *body[2:4], 1.0, body[4]]]))[0])
        draw.polygon(corners, None, palette.FALSE_TRACK, width=FINE)
        for one, other in ((0, 2), (1, 3)):
            draw.line((corners[one], corners[other]), palette.FALSE_TRACK, FINE)

    def _car(self, draw: ImageDraw.ImageDraw, car: Floats, acceleration_m_s2: float) -> None:
        self._body(draw, car, palette.AGENT)
        cos, sin = math.cos(car[4]), math.sin(car[4])
        ahead, left = np.array([cos, sin]), np.array([-sin, cos])
        middle, half_length, half_width = car[:2], car[2] / 2, car[3] / 2
        screen = [middle + half_length * a * ahead + half_width * b * left for a, b in ((0.45, 0.8), (0.45, -0.8))]
        screen += [middle + half_length * 0.15 * ahead + half_width * b * left for b in (-0.8, 0.8)]
        draw.polygon(self._pixels(np.array(screen)), palette.BACKGROUND)
        if acceleration_m_s2 < -_BRAKES_M_S2:
            strength = min(1.0, -acceleration_m_s2 / 6.0)
            ends = np.array([middle - (half_length + 0.5) * ahead + half_width * b * left for b in (1.0, -1.0)])
            draw.line(self._pixels(ends), BRAKE, round(FINE * (2 + 4 * strength)))

    def _ring(self, draw: ImageDraw.ImageDraw, place: Floats, color: palette.RGB, radii_px: Sequence[int]) -> None:
        ((x, y),) = self._pixels(place[None])
        for radius in radii_px:
            r = FINE * radius
            draw.ellipse((x - r, y - r, x + r, y + r), outline=color, width=FINE)

    def _message(self, draw: ImageDraw.ImageDraw, sender: Floats, receiver: Floats, freshness: float) -> None:
        color = tuple(round(c * freshness + b * (1 - freshness)) for c, b in zip(TOLD, (44, 48, 55), strict=True))
        draw.line(self._pixels(np.stack([sender, receiver])), color, FINE * (3 if freshness > 0.5 else 2))

    def _burst(self, draw: ImageDraw.ImageDraw, car: Floats) -> None:
        """Draw a star at the car's front."""
        front = car[:2] + car[2] / 2 * np.array([math.cos(car[4]), math.sin(car[4])])
        ((x, y),) = self._pixels(front[None])
        spikes = [
            (x + FINE * r * math.cos(a), y + FINE * r * math.sin(a))
            for k in range(20)
            for r, a in [((26.0 if k % 2 else 13.0), k * math.pi / 10)]
        ]
        draw.polygon(spikes, None, CRASH, width=2 * FINE)

    def _words(self, draw: ImageDraw.ImageDraw, agents: dict[str, Floats]) -> None:
        for name, place in agents.items():
            ((x, y),) = self._pixels(place[None])
            on_halo(draw, (x / FINE + 12, y / FINE - 20), name, palette.AGENT, 15)
        left, bottom = 14, self._size[1] - 16
        reach = SCALE_BAR_M * self._scale / FINE
        draw.line((left, bottom, left + reach, bottom), palette.TEXT, 3)
        on_halo(draw, (left, bottom - 22), f"{SCALE_BAR_M:.0f} m", palette.TEXT, 14)


def on_halo(draw: ImageDraw.ImageDraw, spot: tuple[float, float], text: str, color: palette.RGB, size_px: int) -> None:
    """Write on a dark halo, to be read over anything."""
    draw.text(spot, text, color, font_of(size_px), stroke_width=2, stroke_fill=palette.BACKGROUND)


@lru_cache
def font_of(size_px: int) -> ImageFont.FreeTypeFont | ImageFont.ImageFont:
    """Return pillow's own font in a size."""
    return ImageFont.load_default(size_px)


def width_of(text: str, size_px: int) -> float:
    """Return the width of a text, px."""
    return float(font_of(size_px).getlength(text))


def wrapped(texts: Iterable[str], size_px: int, width_px: float) -> list[str]:
    """Break texts into lines that fit a width."""
    lines: list[str] = []
    for text in texts:
        line = ""
        for word in text.split():
            longer = f"{line} {word}".strip()
            if line and width_of(longer, size_px) > width_px:
                lines.append(line)
                longer = word
            line = longer
        lines.append(line)
    return lines
