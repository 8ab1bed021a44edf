"""Logs of drones by levelX: inD, rounD, exiD and uniD, and highD, which has other columns.

A recording is `NN_tracks.csv` beside `NN_tracksMeta.csv` and `NN_recordingMeta.csv`; any of the three names it.

| column | read as |
|---|---|
| `frame`, `frameRate` | time = frame / rate |
| `xCenter`, `yCenter`, `heading` | m, and degrees counter-clockwise from x |
| `width`, `length` | of people both are 0: their class's size is taken |
| highD: `x`, `y` | corner of the box with the least x and y; y is down, and becomes -y |
| highD: `width`, `height` | the box's length along x, and its width |
| highD: `drivingDirection` | 1 is towards -x, 2 towards x: the heading, for highD has none |
"""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from coopsim.data.logs.filling import Columns
from coopsim.data.logs.tables import Table
from coopsim.errors import LogFileError
from coopsim.geometry.se3 import Floats

_NAME = re.compile(r"(.*)_(tracks|tracksMeta|recordingMeta)\.csv")
_CLASSES = {"truck_bus": "truck", "trailer": "truck", "animal": "animal"}


def is_level_x(path: Path) -> bool:
    """Return whether a file's name is of such a recording."""
    return _NAME.fullmatch(path.name) is not None


def level_x_columns(path: Path) -> Columns:
    """Return the columns of a recording.

    Raises:
        LogFileError: one of its three files is missing or broken.
    """
    found = _NAME.fullmatch(path.name)
    if found is None:
        raise LogFileError(f"{path} must be named NN_tracks.csv")
    tracks, about, recording = (
        Table(path.with_name(f"{found[1]}_{part}.csv")) for part in ("tracks", "tracksMeta", "recordingMeta")
    )
    rate_hz = float(recording.numbers("frameRate")[0]) if recording.rows else 0.0
    if not 1.0 <= rate_hz <= 1000.0:
        raise LogFileError(f"{recording.path}: frameRate must be from 1 to 1000 Hz, got {rate_hz:g}")
    high = "xCenter" not in tracks.names
    key = "id" if high else "trackId"
    own, named = tracks.texts(key), about.texts(key)
    order = np.argsort(named)
    place = np.minimum(np.searchsorted(named, own, sorter=order), len(named) - 1)
    at = order[place] if len(named) else place
    missing = np.flatnonzero(named[at] != own) if len(named) else np.arange(min(1, len(own)))
    if len(missing):
        raise LogFileError(f"{about.path} has no row of {key} {own[missing[0]]}, which {tracks.path.name} has")
    label = about.classes("class", _CLASSES)[at]
    columns = _high_d(tracks, about.numbers("drivingDirection")[at]) if high else _others(tracks)
    columns.time_s = tracks.numbers("frame") / rate_hz
    columns.label, columns.step_s = label, 1.0 / rate_hz
    return columns


def _others(tracks: Table) -> Columns:
    length, width = tracks.numbers("length", "width").T
    return Columns(
        where=tracks.first_line,
        time_s=np.zeros(0),
        id=tracks.texts("trackId"),
        label=np.zeros(0, np.int64),
        xy=tracks.numbers("xCenter", "yCenter"),
        heading=np.radians(tracks.numbers("heading")),
        velocity=tracks.numbers("xVelocity", "yVelocity"),
        size=_size(length, width),
    )


def _high_d(tracks: Table, direction: Floats) -> Columns:
    x, y, along, across = tracks.numbers("x", "y", "width", "height").T
    velocity = tracks.numbers("xVelocity", "yVelocity")
    return Columns(
        where=tracks.first_line,
        time_s=np.zeros(0),
        id=tracks.texts("id"),
        label=np.zeros(0, np.int64),
        xy=np.column_stack([x + along / 2, -(y + across / 2)]),
        heading=np.where(direction == 1, np.pi, 0.0),
        velocity=velocity * [1.0, -1.0],
        size=_size(along, across),
    )


def _size(length: Floats, width: Floats) -> Floats:
    """Return sizes (N, 3), nan where unknown: no file has heights, and those of people are 0."""
    size = np.column_stack([length, width, np.full(len(length), np.nan)])
    size[size == 0] = np.nan
    return size
