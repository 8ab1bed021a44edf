"""One HTML file that shows what happened: opens without a network, and carries all it needs."""

from __future__ import annotations

import base64
import html
import io
import json
import os
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from importlib import resources
from pathlib import Path
from string import Template
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from coopsim.bench.table import COLUMNS
from coopsim.geometry.boxes import Boxes3D
from coopsim.geometry.se3 import Floats
from coopsim.types import NS_PER_S, Ints, Tracks
from coopsim.viz.bev import BevFrame
from coopsim.world.snapshot import RoadMap

UNIT_M = 0.05
TURN_RAD = 1e-4
_REACH_M = 32767 * UNIT_M

MEANING: Mapping[str, str] = {
    "sAMOTA": "MOTA scaled by what is possible at each of 40 levels of recall, averaged (Weng 2020)",
    "AMOTA": "MOTA averaged over 40 levels of recall (Weng 2020)",
    "AMOTP": "mean 3D IoU of matches, averaged over 40 levels of recall",
    "MOTA": "1 - (false positives + misses + identity switches) / ground truth, at the best level of recall",
    "MOTP": "mean 3D IoU of matches, at the same level",
    "IDS": "identity switches, at the same level",
    "FP": "false positives, at the same level",
    "FN": "misses, at the same level",
    "bytes/s": "what an agent broadcasts per second, envelope included",
    "frames/s": "frames of environment and policy per second of wall time",
}
_LESS_IS_BETTER = ("IDS", "FP", "FN", "bytes/s")


@dataclass(frozen=True, slots=True, eq=False)
class ReportRun:
    """One run of one policy.

    Attributes:
        label: as "late_fusion, 300 ms".
        about: what the run is, heading to text, the policy first; the same headings in every run.
        row: values by column name (see `table.COLUMNS`).
        frame_score: (F,) mean reward per frame.
        tracks: per frame, by reporting agent, in the world frame.
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
        frames: truth, agents and points per frame; tracks in them are not read.
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
    """
    target = Path(path)
    text = render_report(scene, runs)
    handle, temporary = tempfile.mkstemp(dir=target.absolute().parent, suffix=".tmp")
    try:
        with os.fdopen(handle, "w", encoding="utf-8") as file:
            file.write(text)
        os.chmod(temporary, 0o644)
        os.replace(temporary, target)
    except BaseException:
        os.unlink(temporary)
        raise
    return target


def render_report(scene: ReportScene, runs: Sequence[ReportRun]) -> str:
    """The report's HTML."""
    frames = len(scene.frames)
    return Template(_template("report.html")).substitute(
        title=html.escape(scene.title),
        summary=html.escape(f"{len(runs)} runs of {frames} frames ({frames * scene.dt_s:g} s) in the same traffic"),
        style=_template("report.css"),
        script=_template("report.js"),
        table=_table(runs),
        cameras=_mosaic(scene),
        settings="".join(
            f"<dt>{html.escape(name)}</dt><dd>{html.escape(value)}</dd>" for name, value in scene.settings.items()
        ),
        # "</" would end the script element, whatever string it stands in.
        data=json.dumps(_data(scene, runs), separators=(",", ":")).replace("</", "<\\/"),
    )


def _template(name: str) -> str:
    return (resources.files("coopsim.bench") / "template" / name).read_text(encoding="utf-8")


def _table(runs: Sequence[ReportRun]) -> str:
    best = {}
    for name, form in COLUMNS:
        shown = [format(run.row[name], form) for run in runs]
        pick = min if name in _LESS_IS_BETTER else max
        best[name] = pick(shown, key=float) if len(set(shown)) > 1 else None
    heads = [f'<th class="about">{html.escape(name)}</th>' for name in runs[0].about]
    heads += [f'<th title="{html.escape(MEANING[name])}">{html.escape(name)}</th>' for name, _ in COLUMNS]
    rows = []
    for run in runs:
        cells = [f'<td class="about">{html.escape(text)}</td>' for text in run.about.values()]
        for name, form in COLUMNS:
            text = format(run.row[name], form)
            cells.append(f"<td{' class=best' if text == best[name] else ''}>{text}</td>")
        rows.append(f"<tr>{''.join(cells)}</tr>")
    return f"<table><thead><tr>{''.join(heads)}</tr></thead><tbody>{''.join(rows)}</tbody></table>"


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
    origin = _origin(scene)
    road_map = scene.road_map
    outlines = {
        name: [(polygon - origin).clip(-_REACH_M, _REACH_M).round(2).tolist() for polygon in getattr(road_map, name)]
        for name in ("pavements", "lanes", "crosswalks", "buildings")
    }
    numbers: dict[int, int] = {}
    return {
        "dt_s": scene.dt_s,
        "unit": UNIT_M,
        "turn": TURN_RAD,
        "centre": [0.0, 0.0],
        "span": 150.0,
        "agents": list(scene.frames[0].agents) if scene.frames else [],
        "map": outlines,
        "frames": [_frame(frame, origin, numbers) for frame in scene.frames],
        "runs": [
            {
                "label": run.label,
                "group": next(iter(run.about.values()), ""),
                "score": np.round(run.frame_score, 4).tolist(),
                "tracks": [
                    {agent: _boxes(tracks.id % 32768, tracks.boxes, origin) for agent, tracks in frame.items()}
                    for frame in run.tracks
                ],
            }
            for run in runs
        ],
    }


def _frame(frame: BevFrame, origin: Floats, numbers: dict[int, int]) -> dict[str, Any]:
    short = [numbers.setdefault(actor, len(numbers) % 32768) for actor in frame.actors.id.tolist()]
    return {
        "truth": _boxes(np.array(short, dtype=np.int64), frame.actors.boxes, origin),
        "points": _int16((frame.points[:, :2] - origin) / UNIT_M),
        "agents": [
            [name, *(body.world_SE3_base.translation[:2] - origin).round(2).tolist(), body.actor_id is not None]
            for name, body in frame.agents.items()
        ],
    }


def _origin(scene: ReportScene) -> Floats:
    """The middle of where the agents are in the middle of the episode; all coordinates are relative to it."""
    if not scene.frames:
        return np.zeros(2)
    bodies = scene.frames[len(scene.frames) // 2].agents.values()
    middle: Floats = np.mean([body.world_SE3_base.translation[:2] for body in bodies] or [np.zeros(2)], axis=0)
    return middle.round()


def _boxes(ids: Ints, boxes: Boxes3D, origin: Floats) -> str:
    """id, x, y, length, width, yaw by box."""
    spots = (boxes.center[:, :2] - origin) / UNIT_M
    return _int16(np.column_stack([ids, spots, boxes.size[:, :2] / UNIT_M, boxes.yaw / TURN_RAD]))


def _int16(values: Floats) -> str:
    return base64.b64encode(np.clip(np.round(values), -32768, 32767).astype("<i2").tobytes()).decode()
