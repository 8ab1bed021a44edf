"""The bird's-eye view of one frame, as an array or in a window."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from coopsim.geometry.boxes import Boxes3D
from coopsim.geometry.se3 import Floats
from coopsim.types import NS_PER_S, Tracks
from coopsim.viz import palette
from coopsim.world.snapshot import Actors, AgentBody, RoadMap

SPAN_M = 160.0
"""How much of the world the picture's width shows at least."""


@dataclass(frozen=True, slots=True, eq=False)
class BevFrame:
    """What a bird's-eye picture shows, all in the world frame.

    Attributes:
        time_ns: since the episode's start.
        actors: the truth.
        agents: true places, by name.
        points: (N, 3) m.
        tracks: by reporting agent.
    """

    time_ns: int
    actors: Actors
    agents: Mapping[str, AgentBody]
    points: Floats
    tracks: Mapping[str, Tracks]


def outlines(boxes: Boxes3D) -> Floats:
    """Footprints (N, 4, 2) m, counter-clockwise from front-left."""
    return boxes.corners[:, :4, :2]


class BevRenderer:
    """Draws frames over a map: truth grey, connected agents yellow, tracks by the colour of their id.

    The view is centred on the agents and steps in tens of metres, so that it holds still.

    Args:
        road_map: outlines to draw beneath.
        width_px: of the picture.
        height_px: of the picture.
    """

    def __init__(self, road_map: RoadMap, width_px: int = 960, height_px: int = 720) -> None:
        os.environ.setdefault("PYGAME_HIDE_SUPPORT_PROMPT", "1")
        import pygame

        self._pygame, self._map = pygame, road_map
        self._size = (width_px, height_px)
        self._surface = pygame.Surface(self._size)
        self._window: Any = None
        pygame.font.init()
        self._font = pygame.font.Font(None, 18)
        self._ground: tuple[tuple[float, float], Any] | None = None

    def draw(self, frame: BevFrame) -> NDArray[np.uint8]:
        """The picture, (H, W, 3) uint8; needs no display."""
        self._paint(frame)
        pixels: NDArray[np.uint8] = self._pygame.surfarray.array3d(self._surface)
        return np.ascontiguousarray(pixels.transpose(1, 0, 2))

    def show(self, frame: BevFrame) -> None:
        """The picture in a window, which opens at the first call."""
        pygame = self._pygame
        if self._window is None:
            pygame.display.init()
            self._window = pygame.display.set_mode(self._size)
            pygame.display.set_caption("coopsim")
        pygame.event.pump()
        self._paint(frame)
        self._window.blit(self._surface, (0, 0))
        pygame.display.flip()

    def close(self) -> None:
        """Close the window, if there is one."""
        if self._window is not None:
            self._pygame.display.quit()
            self._window = None

    def _paint(self, frame: BevFrame) -> None:
        centre = self._centre(frame)
        self._surface.blit(self._map_picture(centre), (0, 0))
        self._points(frame.points, centre)
        riding = [body.actor_id for body in frame.agents.values() if body.actor_id is not None]
        connected = np.isin(frame.actors.id, riding)
        self._polygons(outlines(frame.actors.boxes[~connected]), centre, palette.TRUTH, width=1)
        self._polygons(outlines(frame.actors.boxes[connected]), centre, palette.AGENT, width=0)
        for tracks in frame.tracks.values():
            for track_id, corners in zip(tracks.id.tolist(), outlines(tracks.boxes), strict=True):
                self._polygons(corners[None], centre, palette.track_color(track_id), width=2)
        for name, body in frame.agents.items():
            spot = self._pixels(body.world_SE3_base.translation[None, :2], centre)[0]
            if body.actor_id is None:
                self._pygame.draw.circle(self._surface, palette.AGENT, spot, 5)
            self._text(name, spot + np.array([8, -16]), palette.AGENT)
        self._text(f"{frame.time_ns / NS_PER_S:.1f} s", np.array([10, 8]), palette.TEXT)
        self._text("truth grey, agents yellow, tracks by id", np.array([10, 26]), palette.TEXT)

    def _centre(self, frame: BevFrame) -> tuple[float, float]:
        places = np.array([body.world_SE3_base.translation[:2] for body in frame.agents.values()]).reshape(-1, 2)
        middle = places.mean(axis=0) if len(places) else np.zeros(2)
        steps = np.round(middle / 20.0) * 20.0
        return float(steps[0]), float(steps[1])

    def _map_picture(self, centre: tuple[float, float]) -> Any:
        if self._ground is None or self._ground[0] != centre:
            surface = self._pygame.Surface(self._size)
            surface.fill(palette.BACKGROUND)
            for polygons, color in (
                (self._map.pavements, palette.PAVEMENT),
                (self._map.lanes, palette.ROAD),
                (self._map.crosswalks, palette.CROSSWALK),
                (self._map.buildings, palette.BUILDING),
            ):
                for polygon in polygons:
                    self._pygame.draw.polygon(surface, color, self._pixels(polygon, centre))
            self._ground = (centre, surface)
        return self._ground[1]

    def _points(self, points: Floats, centre: tuple[float, float]) -> None:
        pixels = self._pixels(points[:, :2], centre).astype(np.int64)
        inside = ((pixels >= 0) & (pixels < self._size)).all(axis=1)
        array = self._pygame.surfarray.pixels3d(self._surface)
        array[pixels[inside, 0], pixels[inside, 1]] = palette.POINT
        del array  # the surface stays locked as long as its pixels are borrowed

    def _polygons(self, corners: Floats, centre: tuple[float, float], color: tuple[int, int, int], width: int) -> None:
        for polygon in self._pixels(corners, centre):
            self._pygame.draw.polygon(self._surface, color, polygon, width)
            # The front edge twice as bold: which way it heads.
            self._pygame.draw.line(self._surface, color, polygon[0], polygon[3], width + 1)

    def _pixels(self, points: Floats, centre: tuple[float, float]) -> Floats:
        scale = self._size[0] / SPAN_M
        offset = (points - np.array(centre)) * [scale, -scale]
        pixels: Floats = offset + np.array(self._size) / 2
        return np.clip(pixels, -1e4, 1e4)

    def _text(self, text: str, spot: NDArray[Any], color: tuple[int, int, int]) -> None:
        self._surface.blit(self._font.render(text, True, color), (float(spot[0]), float(spot[1])))
