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
from coopsim.viz.false_tracks import is_false
from coopsim.world.places.signals import stop_bars
from coopsim.world.snapshot import Actors, AgentBody, RoadMap

SPAN_M = 160.0
"""Width of the world that the image shows."""

SCALE_BAR_M = 20.0


@dataclass(frozen=True, slots=True, eq=False)
class BevFrame:
    """Content of a bird's-eye image in the world frame: truth, points (N, 3) m, tracks by reporting agent, and lies.

    `ego` is the agent that the image is about; None: the first one.
    """

    time_ns: int
    actors: Actors
    agents: Mapping[str, AgentBody]
    points: Floats
    tracks: Mapping[str, Tracks]
    lies: Sequence[Lie] = ()
    ego: str | None = None

    @property
    def about(self) -> str | None:
        """The agent that the image is about: the ego while it is there, or else the first; None without agents."""
        return self.ego if self.ego in self.agents else next(iter(self.agents), None)


def footprints(boxes: Boxes3D) -> Floats:
    """Return x, y, length, width, m, and yaw, rad, of boxes, (N, 5)."""
    return np.column_stack([boxes.center[:, :2], boxes.size[:, :2], boxes.yaw])


def outlines(boxes: Boxes3D) -> Floats:
    """Return footprints (N, 4, 2) m, counter-clockwise from front-left."""
    return boxes.corners[:, :4, :2]


class BevRenderer:
    """Renderer of frames over a map, for people: the truth grey, agents yellow, the ego filled, and its tracks green.

    A track where nothing is, is false: thin, grey and crossed out. North (y) is up. The view is centred on the agents
    in steps of 20 m, so that it does not move in every frame. The lower left corner is free for words of others.

    Args:
        road_map: outlines of the place.
        width_px: width of the image.
        height_px: height of the image.
        all_tracks: draw the tracks of all agents; False: of the ego alone, as most objects are tracked by several.
    """

    def __init__(
        self, road_map: RoadMap, width_px: int = 960, height_px: int = 720, *, all_tracks: bool = False
    ) -> None:
        os.environ.setdefault("PYGAME_HIDE_SUPPORT_PROMPT", "1")
        import pygame

        self._pygame, self._map, self._all_tracks = pygame, road_map, all_tracks
        self._size = (width_px, height_px)
        self._surface = pygame.Surface(self._size)
        self._window: Any = None
        pygame.font.init()
        self._font = pygame.font.Font(None, 20)
        self._ground: tuple[tuple[float, float], Any] | None = None

    def show_map(self, road_map: RoadMap) -> None:
        """Draw over another map from now on; the window stays."""
        if road_map.lanes is not self._map.lanes:
            self._ground = None
        self._map = road_map

    def render(self, frame: BevFrame, mode: str) -> NDArray[np.uint8] | None:
        """Return an image for the mode "rgb_array"; show it in a window for "human"."""
        if mode == "human":
            self.show(frame)
            return None
        return self.draw(frame)

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
        bars = stop_bars(self._map.stop_lines, palette.BAR_M) if self._map.lights else []
        for bar, letter in zip(bars, self._map.lights, strict=True):
            self._pygame.draw.polygon(self._surface, palette.LIGHT[letter], self._pixels(bar, centre))
        self._points(frame.points, centre)
        riding = {name: body.actor_id for name, body in frame.agents.items() if body.actor_id is not None}
        connected = np.isin(frame.actors.id, list(riding.values()))
        mine = frame.actors.id == riding.get(frame.about or "", -1)
        self._polygons(outlines(frame.actors.boxes[~connected]), centre, palette.TRUTH, width=1)
        self._polygons(outlines(frame.actors.boxes[connected & ~mine]), centre, palette.AGENT, width=1)
        self._polygons(outlines(frame.actors.boxes[mine]), centre, palette.AGENT, width=0)
        for name, tracks in frame.tracks.items() if self._all_tracks else ():
            if name != frame.about:
                self._tracks(frame, tracks.boxes, centre, palette.OTHER_TRACK, width=1)
        own = frame.tracks.get(frame.about or "")
        if own is not None:
            self._tracks(frame, own.boxes, centre, palette.TRACK, width=2)
        for lie in frame.lies:
            self._polygons(outlines(lie.claimed), centre, palette.LIE, width=2)
        for name, body in frame.agents.items():
            spot = self._pixels(body.world_SE3_base.translation[None, :2], centre)[0]
            if body.actor_id is None:
                self._pygame.draw.circle(self._surface, palette.AGENT, spot, 5)
            self._text(name, spot + np.array([8, -18]), palette.AGENT)
        self._legend(frame)

    def _tracks(
        self, frame: BevFrame, boxes: Boxes3D, centre: tuple[float, float], color: palette.RGB, width: int
    ) -> None:
        """Draw tracks, those where nothing is as false ones."""
        false = is_false(footprints(boxes), footprints(frame.actors.boxes))
        for polygon in self._pixels(outlines(boxes[false]), centre):
            self._pygame.draw.polygon(self._surface, palette.FALSE_TRACK, polygon, 1)
            for one, other in ((0, 2), (1, 3)):
                self._pygame.draw.line(self._surface, palette.FALSE_TRACK, polygon[one], polygon[other])
        self._polygons(outlines(boxes[~false]), centre, color, width)

    def _legend(self, frame: BevFrame) -> None:
        """Write the time and the meaning of what is drawn, with a mark before each."""
        self._text(f"{frame.time_ns / NS_PER_S:.1f} s", np.array([10, 8]), palette.TEXT)
        for k, (text, color, width, crossed) in enumerate(self._keys(frame)):
            box = self._pygame.Rect(10, 31 + 18 * k, 16, 10)
            self._pygame.draw.rect(self._surface, color, box, width)
            for ends in ((box.topleft, box.bottomright), (box.bottomleft, box.topright)) if crossed else ():
                self._pygame.draw.line(self._surface, color, *ends)
            self._text(text, np.array([34, 28 + 18 * k]), palette.TEXT)
        right, bottom = self._size[0] - 12, self._size[1] - 14
        left = right - SCALE_BAR_M * self._size[0] / SPAN_M
        self._pygame.draw.line(self._surface, palette.TEXT, (left, bottom), (right, bottom), 3)
        self._text(f"{SCALE_BAR_M:.0f} m", np.array([left, bottom - 20]), palette.TEXT)

    def _keys(self, frame: BevFrame) -> list[tuple[str, palette.RGB, int, bool]]:
        """Return the legend's words, each with colour and width of its mark (0: filled), and whether it is crossed."""
        keys = [("object", palette.TRUTH, 1, False)]
        if frame.about is not None:
            keys.append((frame.about, palette.AGENT, 0, False))
        if len(frame.agents) > 1:
            keys.append(("other agent", palette.AGENT, 1, False))
        if frame.tracks:
            of = "" if frame.about is None else f" of {frame.about}"
            keys += [(f"track{of}", palette.TRACK, 2, False), ("false track", palette.FALSE_TRACK, 1, True)]
        if self._all_tracks and len(frame.tracks) > 1:
            keys.append(("track of another agent", palette.OTHER_TRACK, 1, False))
        if frame.lies:
            keys.append((f"claim of {' and '.join(sorted({lie.agent for lie in frame.lies}))}", palette.LIE, 2, False))
        return keys

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
