"""The view from above of the frame that was scored last, as data and as a picture."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from coopsim.envs.frames import Frame, world_points
from coopsim.types import Tracks
from coopsim.viz.bev import BevFrame, BevRenderer
from coopsim.world.snapshot import RoadMap


class ScoredView:
    """The frame that was scored last, and the tracks that were reported for it."""

    def __init__(self) -> None:
        self._renderer: BevRenderer | None = None
        self._road_map: RoadMap
        self._frame: Frame
        self._tracks: Mapping[str, Tracks]

    def begin(self, road_map: RoadMap, frame: Frame) -> None:
        """Begin an episode: take over the outlines of its place and its first frame, for which nothing is reported."""
        self._road_map = road_map
        self.update(frame, {})

    def update(self, frame: Frame, tracks: Mapping[str, Tracks]) -> None:
        """Take over a frame and the tracks reported for it, in each agent's base frame."""
        self._frame, self._tracks = frame, tracks

    def bev_frame(self, *, points: bool) -> BevFrame:
        """Return the frame with its tracks, in the world frame; `points` adds those of all sweeps."""
        bodies = {name: agent.body for name, agent in self._frame.agents.items()}
        placed = {name: tracks.transform(bodies[name].world_SE3_base) for name, tracks in self._tracks.items()}
        cloud = world_points(self._frame) if points else np.zeros((0, 3))
        return BevFrame(self._frame.time_ns, self._frame.actors, bodies, cloud, placed)

    def render(self, mode: str) -> NDArray[np.uint8] | None:
        """Return a picture (H, W, 3) for the mode "rgb_array"; show it in a window for "human"."""
        if self._renderer is None:
            self._renderer = BevRenderer(self._road_map)
        self._renderer.show_map(self._road_map)
        frame = self.bev_frame(points=True)
        if mode == "human":
            self._renderer.show(frame)
            return None
        return self._renderer.draw(frame)

    def close(self) -> None:
        """Close the window."""
        if self._renderer is not None:
            self._renderer.close()
            self._renderer = None
