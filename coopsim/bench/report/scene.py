"""Data of the bird's-eye views in pages: frames of a scene as small integers, for JSON."""

from __future__ import annotations

import base64
import html
import io
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from string import Template
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from coopsim.bench.report.formats import template
from coopsim.bench.report.keys import FALSE_NOTE, SCENE, keys_html
from coopsim.episode import Episode, Recorder
from coopsim.geometry.boxes import Boxes3D
from coopsim.geometry.se3 import Floats, wrap_angle
from coopsim.types import NS_PER_S, Ints, Tracks
from coopsim.viz import palette
from coopsim.viz.bev import BevFrame
from coopsim.world.snapshot import RoadMap

if TYPE_CHECKING:
    pass

UNIT_M, TURN_RAD = 0.05, 1e-4
"""Units of the integers that store lengths and headings."""
_INT16_MAX, _IDS = 2**15 - 1, 2**31

_COLORS: Mapping[str, palette.RGB] = palette.MAP | {
    "background": palette.BACKGROUND,
    "point": palette.POINT,
    "truth": palette.TRUTH,
    "agent": palette.AGENT,
    "text": palette.TEXT,
    "lie": palette.LIE,
    "track": palette.TRACK,
    "false": palette.FALSE_TRACK,
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


def thinned(points: Floats, count: int) -> Floats:
    """Return about `count` of the points (N, 3): every n-th in the order of the sweep, which runs around the sensor."""
    stride = max(1, -(-len(points) // count))
    return points[::stride].copy()  # a view would keep all of them in memory


class Film(Recorder):
    """The frames of a run from above, with about `points` points each.

    The points are those of `agent`; None: of all agents.

    Attributes:
        frames: F frames.
        arrived: senders whose messages reached `agent`, of F + 1 frames.
    """

    def __init__(self, points: int, agent: str | None = None) -> None:
        self._points, self._agent = points, agent
        self.frames: list[BevFrame] = []
        self.arrived: list[frozenset[str]] = []
        self._delivered: dict[str, int] = {}
        self.dt_s = 0.0
        self.road_map: RoadMap

    def on_step(self, episode: Episode) -> None:
        env = episode.env
        frame = env.bev_frame(points=self._points > 0, agent=self._agent)
        self.frames.append(replace(frame, points=thinned(frame.points, self._points)) if self._points else frame)
        self.dt_s = next(iter(env.agent_specs.values())).dt_s
        self.road_map = env.road_map
        links = {sender: counts.delivered for (sender, to), counts in env.link_counts.items() if to == self._agent}
        if not self.arrived:  # the first call comes after two frames, and each has one message of a sender
            self.arrived.append(frozenset(name for name, n in links.items() if n > 1))
        self.arrived.append(frozenset(name for name, n in links.items() if n > self._delivered.get(name, 0)))
        self._delivered = links


def home_of(frames: Sequence[BevFrame]) -> Floats:
    """Return the origin (2,) m of a scene's coordinates: the middle of the agents at half time."""
    return _middle(frames[len(frames) // 2])


def map_data(road_map: RoadMap, home: Floats) -> dict[str, Any]:
    """Return the outlines of a road map, by field."""
    return {name: [(polygon - home).round(2).tolist() for polygon in getattr(road_map, name)] for name in palette.MAP}


def frame_data(frame: BevFrame, home: Floats) -> dict[str, Any]:
    """Return truth, agents and points of a frame."""
    middle = _middle(frame)
    # Points are most of the file. Two bytes from the agents' current place reach 1.6 km, however far they have driven.
    points = np.round((frame.points[:, :2] - middle) / UNIT_M)
    return {
        "origin": (middle - home).tolist(),
        "truth": boxes_data(frame.actors.id, frame.actors.boxes, home),
        "points": _base64(points[(np.abs(points) <= _INT16_MAX).all(axis=1)], "<i2"),
        "agents": [
            [name, *(body.world_SE3_base.translation[:2] - home).round(2).tolist(), body.actor_id is not None]
            for name, body in frame.agents.items()
        ],
    }


def tracks_data(tracks: Mapping[str, Tracks], home: Floats) -> dict[str, str]:
    """Return the tracks of a frame, by reporting agent."""
    return {agent: boxes_data(each.id, each.boxes, home) for agent, each in tracks.items()}


def _middle(frame: BevFrame) -> Floats:
    """Return the middle of the frame's agents, (2,) m."""
    places = [body.world_SE3_base.translation[:2] for body in frame.agents.values()]
    middle: Floats = np.mean(places or [np.zeros(2)], axis=0)
    return middle.round()


def boxes_data(ids: Ints, boxes: Boxes3D, home: Floats) -> str:
    """Encode id, x, y, length, width, yaw of each box."""
    spots = (boxes.center[:, :2] - home) / UNIT_M
    rows = [ids % _IDS, spots, boxes.size[:, :2] / UNIT_M, wrap_angle(boxes.yaw) / TURN_RAD]
    return _base64(np.round(np.column_stack(rows)), "<i4")


def _base64(values: NDArray[Any], dtype: str) -> str:
    return base64.b64encode(values.astype(dtype).tobytes()).decode()


@dataclass(frozen=True, slots=True, eq=False)
class SceneRun:
    """Run of one policy: its label ("late_fusion, 300 ms"), mean rewards over agents (F,), and tracks in the world
    frame, per frame and by reporting agent. Runs of one policy have one colour.
    """

    label: str
    policy: str
    rewards: Floats
    tracks: Sequence[Mapping[str, Tracks]]


@dataclass(frozen=True, slots=True, eq=False)
class Scene:
    """Runs in the same traffic, from above and through the cameras.

    Attributes:
        dt_s: time between frames.
        road_map: outlines.
        frames: at least one: truth, agents and points; tracks in them are not read.
        runs: at least one.
        cameras: images (H, W, 3) uint8 by agent and camera, of one moment; may be empty.
        camera_time_ns: time of that moment.
    """

    dt_s: float
    road_map: RoadMap
    frames: Sequence[BevFrame]
    runs: Sequence[SceneRun]
    cameras: Mapping[str, Mapping[str, NDArray[np.uint8]]] = field(default_factory=dict)
    camera_time_ns: int = 0

    def html(self) -> str:
        """Return the sections of the page that `scene.js` fills, and the images."""
        return Template(template("scene.html")).substitute(
            cameras=self._mosaic(), keys=keys_html(SCENE), false_note=FALSE_NOTE
        )

    def data(self) -> dict[str, Any]:
        """Return plain data for `scene.js`, ready for JSON."""
        home = home_of(self.frames)
        return {
            "dt_s": self.dt_s,
            "map": map_data(self.road_map, home),
            "frames": [frame_data(frame, home) for frame in self.frames],
            "runs": [
                {
                    "label": run.label,
                    "group": run.policy,
                    "score": np.round(run.rewards, 4).tolist(),
                    "tracks": [tracks_data(frame, home) for frame in run.tracks],
                }
                for run in self.runs
            ],
        }

    def _mosaic(self) -> str:
        if not self.cameras:
            return '<p class="note">No camera images were taken in this run.</p>'
        columns = max(len(images) for images in self.cameras.values())
        figures = []
        for agent, images in self.cameras.items():
            for camera, image in images.items():
                caption = html.escape(f"{agent} {camera}")
                source = f"data:image/jpeg;base64,{_jpeg(image)}"
                figures.append(
                    f'<figure><img src="{source}" alt="{caption}"><figcaption>{caption}</figcaption></figure>'
                )
        when = f"All cameras at {self.camera_time_ns / NS_PER_S:.1f} s."
        return f'<div class="mosaic" style="--columns:{columns}">{"".join(figures)}</div><p class="note">{when}</p>'


def _jpeg(image: NDArray[np.uint8]) -> str:
    buffer = io.BytesIO()
    Image.fromarray(image).save(buffer, "JPEG", quality=85)
    return base64.b64encode(buffer.getvalue()).decode()
