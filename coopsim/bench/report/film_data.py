"""Data of the views from above in pages: frames of films as small integers, for JSON."""

from __future__ import annotations

import base64
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from coopsim.bench.films.film import ALL, BOX_M, POINT_M, TURN_RAD, Film, FilmFrame, Rows
from coopsim.geometry.se3 import Floats
from coopsim.viz import palette
from coopsim.world.places.signals import stop_bars
from coopsim.world.snapshot import RoadMap

UNIT_M = POINT_M
"""Unit of the integers that store lengths in pages."""

_COLORS: Mapping[str, palette.RGB] = palette.MAP | {
    "background": palette.BACKGROUND,
    "point": palette.POINT,
    "truth": palette.TRUTH,
    "agent": palette.AGENT,
    "connected": palette.CONNECTED,
    "hidden": palette.HIDDEN,
    "kerb": palette.KERB,
    "crash": palette.CRASH,
    "text": palette.TEXT,
    "lie": palette.LIE,
    "track": palette.TRACK,
    "false": palette.FALSE_TRACK,
    **palette.LIGHT,
}
DRAWING: Mapping[str, Any] = {
    "unit": UNIT_M,
    "turn": TURN_RAD,
    "colors": {name: f"rgb{color}" for name, color in _COLORS.items()},
    "hue_step": palette.HUE_STEP,
    "saturation": palette.SATURATION,
    "lightness": palette.LIGHTNESS,
}
"""Units of the numbers, and colours."""


def home_of(frames: Sequence[FilmFrame]) -> Floats:
    """Return the origin (2,) of places in pages, m in the world frame: the middle of the frames' agents halfway."""
    return frames[len(frames) // 2].middle


def map_data(road_map: RoadMap, home: Floats) -> dict[str, Any]:
    """Return the outlines of a road map, by field, and bars at its stop lines."""
    outlines = {name: getattr(road_map, name) for name in palette.MAP}
    outlines |= {"bars": stop_bars(road_map.stop_lines, palette.BAR_M)}
    return {name: [(polygon - home).round(2).tolist() for polygon in found] for name, found in outlines.items()}


def frame_data(frame: FilmFrame, home: Floats, points: str = ALL) -> dict[str, Any]:
    """Return truth and agents of a frame, and the points of an agent, or of all."""
    return {
        "origin": (frame.middle - home).tolist(),
        "truth": rows_data(frame.truth, home),
        "points": _base64(frame.points.get(points, np.zeros((0, 2))), "<i2"),
        "lights": frame.lights,
        "agents": [[name, *place_data(place[:2], home), place.rides] for name, place in frame.agents.items()],
    }


def place_data(place_m: Floats | tuple[float, float], home: Floats) -> list[float]:
    """Return a place (2,) in the world frame as pages have it."""
    place: list[float] = (np.asarray(place_m) - home).round(2).tolist()
    return place


def tracks_data(tracks: Mapping[str, Rows], home: Floats) -> dict[str, str]:
    """Return the tracks of a frame, by reporting agent."""
    return {agent: rows_data(rows, home) for agent, rows in tracks.items()}


def news_data(news: Mapping[str, Mapping[int, float]]) -> dict[str, list[list[float]]]:
    """Return the news of a frame by agent, see `Film.news`: ids, each with the share of its time that has passed."""
    return {agent: [[each, round(share, 3)] for each, share in ages.items()] for agent, ages in news.items() if ages}


def run_data(film: Film, agent: str, numbers: Iterable[int], home: Floats) -> dict[str, Any]:
    """Return the tracks and the news of one agent, if it has any, in frames of a film."""
    shown = [(film.frames[k].tracks, {agent: film.news(agent, k)}) for k in numbers]
    return {
        "tracks": [tracks_data({agent: each[agent]} if agent in each else {}, home) for each, _ in shown],
        "news": [news_data(each) for _, each in shown],
    }


def rows_data(rows: Rows, home: Floats) -> str:
    """Encode id, x, y, length, width, yaw of each box; lengths are rounded to `UNIT_M`."""
    exact = rows.astype(np.float64)
    exact[:, 1:3] -= home / BOX_M
    exact[:, 1:5] *= BOX_M / UNIT_M
    return _base64(np.round(exact), "<i4")


def _base64(values: NDArray[Any], dtype: str) -> str:
    return base64.b64encode(values.astype(dtype).tobytes()).decode()
