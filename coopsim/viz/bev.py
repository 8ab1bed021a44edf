"""The bird's-eye view of one frame, as an array or in a window."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from coopsim.errors import InvalidValueError
from coopsim.geometry.boxes import Boxes3D
from coopsim.geometry.se3 import Floats
from coopsim.types import NS_PER_S, Tracks
from coopsim.types.lies import Lie
from coopsim.viz import palette
from coopsim.world.snapshot import Actors, AgentBody, RoadMap

SPAN_M = 160.0
"""Width of the world that the image shows."""

SCALE_BAR_M = 20.0


@dataclass(frozen=True, slots=True, eq=False)
class BevFrame:
    """Content of a bird's-eye image in the world frame: truth, points (N, 3) m, tracks by reporting agent, and lies."""

    time_ns: int
    actors: Actors
    agents: Mapping[str, AgentBody]
    points: Floats
    tracks: Mapping[str, Tracks]
    lies: Sequence[Lie] = ()


def outlines(boxes: Boxes3D) -> Floats:
    """Return footprints (N, 4, 2) m, counter-clockwise from front-left."""
    return boxes.corners[:, :4, :2]


class BevRenderer:
    """Renderer of frames over a map: truth grey, connected agents yellow, tracks by the colour of their id.

    North (y) is up. The view is centred on the agents in steps of 20 m, so that it does not move in every frame. Ids of
    different agents are unrelated, and most objects are tracked by several agents: the first agent's tracks are bold
    and on top, so that a change of colour is a change of its id.
    """

    def __init__(self, road_map: RoadMap, width_px: int = 960, height_px: int = 720) -> None:
        os.environ.setdefault("PYGAME_HIDE_SUPPORT_PROMPT", "1")
        import pygame

        self._pygame, self._map = pygame, road_map
        self._size = (width_px, height_px)
        self._surface = pygame.Surface(self._size)
        self._window: Any = None
        pygame.font.init()
        self._font = pygame.font.Font(None, 20)
        self._ground: tuple[tuple[float, float], Any] | None = None

    def show_map(self, road_map: RoadMap) -> None:
        """Draw over another map from now on; the window stays."""
        if road_map is not self._map:
            self._map, self._ground = road_map, None

    def draw(self, frame: BevFrame) -> NDArray[np.uint8]:
        """Return the image, (H, W, 3) uint8; needs no display."""
        self._paint(frame)
        pixels: NDArray[np.uint8] = self._pygame.surfarray.array3d(self._surface)
        return np.ascontiguousarray(pixels.transpose(1, 0, 2))

    def show(self, frame: BevFrame) -> None:
        """Show the image in a window, which opens at the first call.

        Raises:
            InvalidValueError: there is no screen to open it on.
        """
        if self._window is None:
            self._window = self._open()
        self._pygame.event.pump()  # a window that handles no events counts as hanging
        self._paint(frame)
        self._window.get_surface().blit(self._surface, (0, 0))
        self._window.flip()

    def close(self) -> None:
        """Close the window, if one is open; the next `show` opens another."""
        if self._window is not None:
            self._window.destroy()
            self._window = None

    def _open(self) -> Any:
        try:
            self._pygame.display.init()
            # Not pygame.display's window, of which there is one for all environments of a process.
            return self._pygame.Window("coopsim", self._size)
        except self._pygame.error as error:
            raise InvalidValueError(
                f'render_mode "human" cannot open a window here ({error}); "rgb_array" needs no screen'
            ) from None

    def _paint(self, frame: BevFrame) -> None:
        centre = self._centre(frame)
        self._surface.blit(self._map_image(centre), (0, 0))
        self._points(frame.points, centre)
        riding = [body.actor_id for body in frame.agents.values() if body.actor_id is not None]
        connected = np.isin(frame.actors.id, riding)
        self._polygons(outlines(frame.actors.boxes[~connected]), centre, palette.TRUTH, width=1)
        self._polygons(outlines(frame.actors.boxes[connected]), centre, palette.AGENT, width=0)
        first = next(iter(frame.tracks), None)
        for name, tracks in reversed(list(frame.tracks.items())):
            for track_id, corners in zip(tracks.id.tolist(), outlines(tracks.boxes), strict=True):
                width = 2 if name == first else 1
                self._polygons(corners[None], centre, palette.track_color(track_id), width)
        for lie in frame.lies:
            self._polygons(outlines(lie.claimed), centre, palette.LIE, width=2)
        for name, body in frame.agents.items():
            spot = self._pixels(body.world_SE3_base.translation[None, :2], centre)[0]
            if body.actor_id is None:
                self._pygame.draw.circle(self._surface, palette.AGENT, spot, 5)
            self._text(name, spot + np.array([8, -18]), palette.AGENT)
        self._legend(frame, first)

    def _legend(self, frame: BevFrame, first: str | None) -> None:
        lines = [f"{frame.time_ns / NS_PER_S:.1f} s", "truth grey, agents yellow"]
        if first is not None:
            lines.append(f"tracks by id, bold those of {first}")
        if frame.lies:
            liars = sorted({lie.agent for lie in frame.lies})
            lines.append(f"pink: claims of {' and '.join(liars)}")
        for k, line in enumerate(lines):
            self._text(line, np.array([10, 8 + 18 * k]), palette.TEXT)
        left, bottom = 12, self._size[1] - 14
        right = left + SCALE_BAR_M * self._size[0] / SPAN_M
        self._pygame.draw.line(self._surface, palette.TEXT, (left, bottom), (right, bottom), 3)
        self._text(f"{SCALE_BAR_M:.0f} m", np.array([left, bottom - 20]), palette.TEXT)

    def _centre(self, frame: BevFrame) -> tuple[float, float]:
        places = np.array([body.world_SE3_base.translation[:2] for body in frame.agents.values()]).reshape(-1, 2)
        middle = places.mean(axis=0) if len(places) else np.zeros(2)
        steps = np.round(middle / 20.0) * 20.0
        return float(steps[0]), float(steps[1])

    def _map_image(self, centre: tuple[float, float]) -> Any:
        if self._ground is None or self._ground[0] != centre:
            surface = self._pygame.Surface(self._size)
            surface.fill(palette.BACKGROUND)
            for name, color in palette.MAP.items():
                for polygon in getattr(self._map, name):
                    self._pygame.draw.polygon(surface, color, self._pixels(polygon, centre))
            self._ground = (centre, surface)
        return self._ground[1]

    def _points(self, points: Floats, centre: tuple[float, float]) -> None:
        pixels = np.floor(self._pixels(points[:, :2], centre)).astype(np.int64)
        inside = ((pixels >= 0) & (pixels < self._size)).all(axis=1)
        array = self._pygame.surfarray.pixels3d(self._surface)
        array[pixels[inside, 0], pixels[inside, 1]] = palette.POINT
        del array  # the surface stays locked as long as its pixels are borrowed

    def _polygons(self, corners: Floats, centre: tuple[float, float], color: palette.RGB, width: int) -> None:
        for polygon in self._pixels(corners, centre):
            self._pygame.draw.polygon(self._surface, color, polygon, width)
            # A line from near the middle to the front shows the heading.
            front, middle = (polygon[0] + polygon[3]) / 2, polygon.mean(axis=0)
            tick = color if width else palette.BACKGROUND
            self._pygame.draw.line(self._surface, tick, front, 0.4 * front + 0.6 * middle, max(width, 2))

    def _pixels(self, points: Floats, centre: tuple[float, float]) -> Floats:
        scale = self._size[0] / SPAN_M
        offset = (points - np.array(centre)) * [scale, -scale]
        pixels: Floats = offset + np.array(self._size) / 2
        return np.clip(pixels, -1e4, 1e4)

    def _text(self, text: str, spot: NDArray[Any], color: palette.RGB) -> None:
        # With a dark halo, to be readable over points and boxes.
        for layer, shifts in ((palette.BACKGROUND, ((-1, 0), (1, 0), (0, -1), (0, 1))), (color, ((0, 0),))):
            letters = self._font.render(text, True, layer)
            for dx, dy in shifts:
                self._surface.blit(letters, (float(spot[0]) + dx, float(spot[1]) + dy))
