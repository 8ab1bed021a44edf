"""The scene of a demonstration in its report: runs in the same traffic, from above and through the cameras."""

from __future__ import annotations

import base64
import html
import io
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from string import Template
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from coopsim.bench.films.film import FilmFrame, Rows
from coopsim.bench.report.film_data import frame_data, home_of, map_data, news_data, tracks_data
from coopsim.bench.report.formats import template
from coopsim.bench.report.keys import FALSE_NOTE, SCENE, keys_html
from coopsim.bench.report.space_data import SpaceView, space_html
from coopsim.geometry.se3 import Floats
from coopsim.types import NS_PER_S
from coopsim.world.snapshot import RoadMap


@dataclass(frozen=True, slots=True, eq=False)
class SceneRun:
    """Run of one policy: its label ("late_fusion, 300 ms"), mean rewards over agents (F,), and tracks in the world
    frame, per frame and by reporting agent, and news (`Film.news`), too. Runs of one policy have one colour.
    """

    label: str
    policy: str
    rewards: Floats
    tracks: Sequence[Mapping[str, Rows]]
    news: Sequence[Mapping[str, Mapping[int, float]]] = ()


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
        space: the runs in three dimensions; None: they were filmed from above alone.
    """

    dt_s: float
    road_map: RoadMap
    frames: Sequence[FilmFrame]
    runs: Sequence[SceneRun]
    cameras: Mapping[str, Mapping[str, NDArray[np.uint8]]] = field(default_factory=dict)
    camera_time_ns: int = 0
    space: SpaceView | None = None

    def html(self) -> str:
        """Return the sections of the page that `scene.js` fills, and the images."""
        return Template(template("scene.html")).substitute(
            space=space_html(self.space), cameras=self._mosaic(), keys=keys_html(SCENE), false_note=FALSE_NOTE
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
                    "news": [news_data(frame) for frame in run.news],
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
