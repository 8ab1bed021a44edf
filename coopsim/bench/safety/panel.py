"""A panel of a clip: a recorded run from above at any moment, as the driven car knows it."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from PIL import Image, ImageDraw

from coopsim.bench.films.recording import Recording
from coopsim.geometry.se3 import Floats
from coopsim.viz import palette
from coopsim.viz.bev import SCALE_BAR_M
from coopsim.viz.from_above import FromAbove, box_of, font_of, on_halo, outlines

FINE = 2
"""Pixels drawn for each pixel shown, along either axis."""

BODY, HIDDEN, KNOWN = (92, 98, 107), palette.HIDDEN, palette.TRACK
"""Colours of bodies, and of what the car must not touch: while it does not know of it, and once it does."""

TOLD, TRACK, BRAKE, CRASH = palette.CONNECTED, palette.TRACK, (255, 64, 64), palette.CRASH
_WAY: palette.RGB = (128, 112, 66)
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
        self._recording, self._size = recording, size_px
        self._px_per_m = min(size_px) / view.span_m
        self._above = FromAbove(recording.film.road_map, view.center_m, self._px_per_m, size_px, FINE)

    def draw(self, time_s: float) -> Image.Image:
        """Draw the run at a time since the episode's start; after its last frame it stands still."""
        record, above = self._recording, self._above
        now = record.at(time_s)
        above.begin()
        above.lights(record.film.road_map.stop_lines, record.lights_at(time_s))
        above.points(record.points_at(time_s))
        for start, end in zip(now.way[:-1:4], now.way[2::4], strict=False):
            above.line(np.stack([start, end]), _WAY)
        for body in now.bodies:
            above.shape(self._corners(body), BODY)
        for body, known in now.conflicts:
            above.shape(self._corners(body), KNOWN if known else None, None if known else HIDDEN, 1.5)
            above.ring(body[:2], KNOWN if known else HIDDEN, 13)
        for body in now.false_tracks:
            above.false(outlines(box_of(body))[0])
        for body in now.tracks:
            above.shape(self._corners(body, grow_m=0.35), None, TRACK, 1.5)
        for place in now.agents.values():
            for radius_px in (5, 9):
                above.ring(place, palette.CONNECTED, radius_px)
        self._car(now.car, now.acceleration_m_s2)
        for place, share in now.news:
            above.ring(place, _faded(1 - share), (1.5 + 4 * share) * self._px_per_m, 2)
        for sender, age_s in record.arrivals(time_s, _SHOWN_S):
            if sender in now.agents:
                self._message(now.agents[sender], now.car[:2], 1 - age_s / _SHOWN_S)
        if record.events.crash_s is not None and time_s >= record.events.crash_s - 1e-9:
            self._burst(now.car)
        for name, place in now.agents.items():
            above.write(name, place, (12, -20), palette.CONNECTED)
        return self._scaled(above.done())

    def _scaled(self, shown: Image.Image) -> Image.Image:
        """Add the bar of the scale."""
        draw, left, bottom = ImageDraw.Draw(shown), 14, self._size[1] - 16
        draw.line((left, bottom, left + SCALE_BAR_M * self._px_per_m, bottom), palette.TEXT, 3)
        on_halo(draw, (left, bottom - 22), f"{SCALE_BAR_M:.0f} m", palette.TEXT, 14)
        return shown

    def _corners(self, body: Floats, grow_m: float = 0.0) -> Floats:
        """Return the outline (4, 2) of a body (5,), wider by `grow_m` on each side, and large enough to be seen."""
        grown = body.copy()
        grown[2:4] = np.maximum(body[2:4], 2 * _LEAST_PX / self._px_per_m) + 2 * grow_m
        corners: Floats = outlines(box_of(grown))[0]
        return corners

    def _car(self, car: Floats, acceleration_m_s2: float) -> None:
        above = self._above
        above.shape(self._corners(car), palette.AGENT)
        cos, sin = math.cos(car[4]), math.sin(car[4])
        ahead, left = np.array([cos, sin]), np.array([-sin, cos])
        middle, half_length, half_width = car[:2], car[2] / 2, car[3] / 2
        screen = [middle + half_length * a * ahead + half_width * b * left for a, b in ((0.45, 0.8), (0.45, -0.8))]
        screen += [middle + half_length * 0.15 * ahead + half_width * b * left for b in (-0.8, 0.8)]
        above.shape(np.array(screen), palette.BACKGROUND)
        if acceleration_m_s2 < -_BRAKES_M_S2:
            strength = min(1.0, -acceleration_m_s2 / 6.0)
            ends = np.array([middle - (half_length + 0.5) * ahead + half_width * b * left for b in (1.0, -1.0)])
            above.line(ends, BRAKE, 2 + 4 * strength)

    def _message(self, sender: Floats, receiver: Floats, freshness: float) -> None:
        self._above.line(np.stack([sender, receiver]), _faded(freshness), 3 if freshness > 0.5 else 2)

    def _burst(self, car: Floats) -> None:
        """Draw a star at the car's front."""
        front = car[:2] + car[2] / 2 * np.array([math.cos(car[4]), math.sin(car[4])])
        turns, radii = np.arange(20) * math.pi / 10, np.where(np.arange(20) % 2, 26.0, 13.0) / self._px_per_m
        spikes = front + radii[:, None] * np.column_stack([np.cos(turns), np.sin(turns)])
        self._above.shape(spikes, None, CRASH, 2)


def _faded(freshness: float) -> palette.RGB:
    """Return the colour of messages, nearer to that of the road the older one is."""
    both = zip(TOLD, palette.MAP["lanes"], strict=True)
    red, green, blue = (round(c * freshness + b * (1 - freshness)) for c, b in both)
    return red, green, blue


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
