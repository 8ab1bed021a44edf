"""The bird's-eye view of one frame, as an array or in a window."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw

from coopsim.errors import InvalidValueError
from coopsim.geometry.boxes import Boxes3D
from coopsim.geometry.se3 import Floats
from coopsim.types import NS_PER_S, Tracks
from coopsim.types.lies import Lie
from coopsim.viz import palette
from coopsim.viz.false_tracks import is_false
from coopsim.viz.from_above import FromAbove, on_halo
from coopsim.viz.from_above import outlines as outlines
from coopsim.world.snapshot import Actors, AgentBody, RoadMap

SPAN_M = 160.0
"""Width of the world that the image shows."""

SCALE_BAR_M = 20.0
_FONT_PX = 13


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


class BevRenderer:
    """Renderer of frames over a map, for people: truth grey, the ego orange, other agents blue, the ego's tracks green.

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
        self._window: Any = None
        self._ground: tuple[tuple[float, float], FromAbove] | None = None

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
        return np.array(self._paint(frame))

    def show(self, frame: BevFrame) -> None:
        """Show the image in a window, which opens at the first call.

        Raises:
            InvalidValueError: there is no screen to open it on.
        """
        if self._window is None:
            self._window = self._open()
        self._pygame.event.pump()  # a window that handles no events counts as hanging
        picture = self._pygame.image.frombytes(self._paint(frame).tobytes(), self._size, "RGB")
        self._window.get_surface().blit(picture, (0, 0))
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

    def _paint(self, frame: BevFrame) -> Image.Image:
        view = self._view(frame)
        view.begin()
        view.lights(self._map.stop_lines, self._map.lights)
        view.points(frame.points[:, :2])
        riding = {name: body.actor_id for name, body in frame.agents.items() if body.actor_id is not None}
        connected = np.isin(frame.actors.id, list(riding.values()))
        mine = frame.actors.id == riding.get(frame.about or "", -1)
        parts = ((~connected, palette.TRUTH, 1), (connected & ~mine, palette.CONNECTED, 1), (mine, palette.AGENT, 0))
        for rows, color, width in parts:
            for corners in outlines(frame.actors.boxes[rows]):
                view.box(corners, color, width)
        for name, tracks in frame.tracks.items() if self._all_tracks else ():
            if name != frame.about:
                _draw_tracks(view, frame, tracks.boxes, palette.OTHER_TRACK, width=1)
        own = frame.tracks.get(frame.about or "")
        if own is not None:
            _draw_tracks(view, frame, own.boxes, palette.TRACK, width=2)
        for lie in frame.lies:
            for corners in outlines(lie.claimed):
                view.box(corners, palette.LIE, 2)
        self._names(view, frame)
        picture = view.done()
        self._legend(ImageDraw.Draw(picture), frame)
        return picture

    def _names(self, view: FromAbove, frame: BevFrame) -> None:
        for name, body in frame.agents.items():
            place, color = body.world_SE3_base.translation[:2], _color_of(name, frame)
            if body.actor_id is None:
                view.dot(place, color, 5)
            view.write(name, place, (8, -18), color)

    def _legend(self, draw: ImageDraw.ImageDraw, frame: BevFrame) -> None:
        """Write the time and the meaning of what is drawn, with a mark before each."""
        on_halo(draw, (10, 8), f"{frame.time_ns / NS_PER_S:.1f} s", palette.TEXT, _FONT_PX)
        for k, (text, color, width, crossed) in enumerate(self._keys(frame)):
            top = 31 + 18 * k
            mark = (10, top, 25, top + 9)
            draw.rectangle(mark, None if width else color, color, width=width or 1)
            if crossed:
                draw.line((10, top, 25, top + 9), color)
                draw.line((10, top + 9, 25, top), color)
            on_halo(draw, (32, top - 3), text, palette.TEXT, _FONT_PX)
        right, bottom = self._size[0] - 14, self._size[1] - 16
        left = right - SCALE_BAR_M * self._size[0] / SPAN_M
        draw.line((left, bottom, right, bottom), palette.TEXT, 3)
        on_halo(draw, (left, bottom - 22), f"{SCALE_BAR_M:.0f} m", palette.TEXT, _FONT_PX)

    def _keys(self, frame: BevFrame) -> list[tuple[str, palette.RGB, int, bool]]:
        """Return the legend's words, each with colour and width of its mark (0: filled), and whether it is crossed."""
        keys = [("object", palette.TRUTH, 1, False)]
        if frame.about is not None:
            keys.append((frame.about, palette.AGENT, 0, False))
        if len(frame.agents) > 1:
            keys.append(("other agent", palette.CONNECTED, 1, False))
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

    def _view(self, frame: BevFrame) -> FromAbove:
        centre = self._centre(frame)
        if self._ground is None or self._ground[0] != centre:
            self._ground = centre, FromAbove(self._map, centre, self._size[0] / SPAN_M, self._size)
        return self._ground[1]


def _color_of(name: str, frame: BevFrame) -> palette.RGB:
    return palette.AGENT if name == frame.about else palette.CONNECTED


def _draw_tracks(view: FromAbove, frame: BevFrame, boxes: Boxes3D, color: palette.RGB, width: int) -> None:
    """Draw tracks, those where nothing is as false ones."""
    false = is_false(footprints(boxes), footprints(frame.actors.boxes))
    for corners in outlines(boxes[false]):
        view.false(corners)
    for corners in outlines(boxes[~false]):
        view.box(corners, color, width)
