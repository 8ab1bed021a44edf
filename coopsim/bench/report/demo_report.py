"""The demonstration as one HTML file: opens without a network, and carries all it needs."""

from __future__ import annotations

import base64
import html
import io
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from coopsim.bench.report.bev_data import DRAWING, frame_data, home_of, map_data, tracks_data
from coopsim.bench.report.formats import definitions, fill_page
from coopsim.bench.report.table import BYTES_TITLE, COLUMNS, format_value
from coopsim.errors import InvalidValueError
from coopsim.geometry.se3 import Floats
from coopsim.metrics.built_in import BUILT_IN, BYTES, less_is_better
from coopsim.support.files import write_whole
from coopsim.types import NS_PER_S, Tracks
from coopsim.viz.bev import BevFrame
from coopsim.world.snapshot import RoadMap

MEANING: Mapping[str, str] = {
    **{name: BUILT_IN[name].meaning for name, _ in COLUMNS if name in BUILT_IN},
    BYTES_TITLE: BUILT_IN[BYTES].meaning,
    "frames/s": "frames of environment and policy per second of wall time",
}
_NOT_COMPARED = ("frames/s",)
"""Timing says more about the machine than about the policy."""


@dataclass(frozen=True, slots=True, eq=False)
class ReportRun:
    """One run of one policy.

    Attributes:
        label: as "late_fusion, 300 ms".
        about: what the run is, heading to text, the policy first; the same headings in every run.
        row: values by column name (see `table.COLUMNS`).
        frame_score: (F,) mean reward per frame.
        tracks: per frame of the scene, by reporting agent, in the world frame.
    """

    label: str
    about: Mapping[str, str]
    row: Mapping[str, float]
    frame_score: Floats
    tracks: Sequence[Mapping[str, Tracks]]


@dataclass(frozen=True, slots=True, eq=False)
class ReportScene:
    """What all runs share.

    Attributes:
        title: of the report.
        dt_s: between frames.
        road_map: outlines.
        frames: at least one: truth, agents and points; tracks in them are not read.
        cameras: (H, W, 3) uint8 by agent and camera, of one moment; may be empty.
        camera_time_ns: that moment.
        settings: names and values for the reader.
    """

    title: str
    dt_s: float
    road_map: RoadMap
    frames: Sequence[BevFrame]
    cameras: Mapping[str, Mapping[str, NDArray[np.uint8]]]
    camera_time_ns: int
    settings: Mapping[str, str]


def write_report(path: str | os.PathLike[str], scene: ReportScene, runs: Sequence[ReportRun]) -> Path:
    """Write the report; the file appears whole or not at all.

    Args:
        path: of the HTML file, in an existing folder.
        scene: what all runs share.
        runs: at least one.

    Raises:
        InvalidValueError: there is nothing to show, or the file cannot be written.
    """
    return write_whole(path, render_report(scene, runs))


def render_report(scene: ReportScene, runs: Sequence[ReportRun]) -> str:
    """The report's HTML."""
    frames = len(scene.frames)
    if not runs or not frames:
        raise InvalidValueError(f"a report needs at least one run and one frame, got {len(runs)} and {frames}")
    for run in runs:
        if not frames == len(run.tracks) == len(run.frame_score):
            raise InvalidValueError(
                f"run {run.label!r} must have tracks and scores for the scene's {frames} frames, "
                f"got {len(run.tracks)} and {len(run.frame_score)}"
            )
    counted = f"{len(runs)} run{'s' * (len(runs) > 1)} of {frames} frames ({frames * scene.dt_s:g} s)"
    return fill_page(
        "demo.html",
        style=("page.css",),
        script=("bev.js", "demo.js"),
        data=_data(scene, runs),
        title=scene.title,
        summary=counted + " in the same traffic" * (len(runs) > 1),
        table=_table(runs),
        meaning=definitions(MEANING),
        cameras=_mosaic(scene),
        settings=definitions(scene.settings),
    )


def _table(runs: Sequence[ReportRun]) -> str:
    best = {name: _best([format_value(run.row[name], form) for run in runs], name) for name, form in COLUMNS}
    heads = [f'<th class="about">{html.escape(name)}</th>' for name in runs[0].about]
    heads += [f'<th title="{html.escape(MEANING[name])}">{html.escape(name)}</th>' for name, _ in COLUMNS]
    rows = []
    for run in runs:
        cells = [f'<td class="about">{html.escape(text)}</td>' for text in run.about.values()]
        for name, form in COLUMNS:
            text = format_value(run.row[name], form)
            cells.append(f"<td{' class=best' if text == best[name] else ''}>{text}</td>")
        rows.append(f"<tr>{''.join(cells)}</tr>")
    return f"<table><thead><tr>{''.join(heads)}</tr></thead><tbody>{''.join(rows)}</tbody></table>"


def _best(shown: Sequence[str], column: str) -> str | None:
    """The best text of a column; None where all are alike, or are not to be compared."""
    numbers = [text for text in shown if text != "-"]
    if column in _NOT_COMPARED or len(set(numbers)) < 2:
        return None
    return (min if less_is_better(BYTES if column == BYTES_TITLE else column) else max)(numbers, key=float)


def _mosaic(scene: ReportScene) -> str:
    if not scene.cameras:
        return '<p class="note">No camera pictures were taken in this run.</p>'
    columns = max(len(images) for images in scene.cameras.values())
    figures = []
    for agent, images in scene.cameras.items():
        for camera, image in images.items():
            caption = html.escape(f"{agent} {camera}")
            source = f"data:image/jpeg;base64,{_jpeg(image)}"
            figures.append(f'<figure><img src="{source}" alt="{caption}"><figcaption>{caption}</figcaption></figure>')
    when = f"All cameras at {scene.camera_time_ns / NS_PER_S:.1f} s."
    return f'<div class="mosaic" style="--columns:{columns}">{"".join(figures)}</div><p class="note">{when}</p>'


def _jpeg(image: NDArray[np.uint8]) -> str:
    buffer = io.BytesIO()
    Image.fromarray(image).save(buffer, "JPEG", quality=85)
    return base64.b64encode(buffer.getvalue()).decode()


def _data(scene: ReportScene, runs: Sequence[ReportRun]) -> dict[str, Any]:
    home = home_of(scene.frames)
    return {
        **DRAWING,
        "dt_s": scene.dt_s,
        "map": map_data(scene.road_map, home),
        "frames": [frame_data(frame, home) for frame in scene.frames],
        "runs": [
            {
                "label": run.label,
                "group": next(iter(run.about.values()), ""),
                "score": np.round(run.frame_score, 4).tolist(),
                "tracks": [tracks_data(frame, home) for frame in run.tracks],
            }
            for run in runs
        ],
    }
