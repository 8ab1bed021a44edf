"""Files of films: compressed NumPy arrays without pickles, and a description in JSON, with a checksum of all."""

from __future__ import annotations

import hashlib
import io
import json
import struct
import zipfile
import zlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import fields
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from coopsim.bench.films.film import Film, FilmedDrive, FilmFrame, Place, ShownLie
from coopsim.errors import StoreError
from coopsim.metrics.drive_log import Drive, ReportedTracks, WayAhead
from coopsim.support.plain_arrays import read_npz
from coopsim.world.snapshot import RoadMap

FORMAT = 1
"""Raise this number when films are stored otherwise."""

_ABOUT, _CHECKSUM = "about", "checksum"
_LARGEST_BYTES = 2**30  # of a film's arrays: a file that names more is broken
_WAY_M = 0.05
_BROKEN = (
    *(OSError, ValueError, KeyError, IndexError, TypeError, EOFError, ArithmeticError, MemoryError, AttributeError),
    *(RuntimeError, NotImplementedError, struct.error, zipfile.BadZipFile, zlib.error),
)
"""Errors of reading a broken file: all that zipfile, json and numpy raise."""

Arrays = dict[str, NDArray[Any]]
Take = Callable[[int], NDArray[Any]]


def film_bytes(film: Film, key: str) -> bytes:
    """Return the content of a film's file, of the run with this key; equal films give equal bytes."""
    boxes, points, outlines = list[NDArray[Any]](), list[NDArray[Any]](), list[NDArray[Any]]()

    def count(rows: NDArray[Any], into: list[NDArray[Any]]) -> int:
        into.append(rows)
        return len(rows)

    about = {
        "format": FORMAT,
        "key": key,
        "dt_s": film.dt_s,
        "map": {
            each.name: [count(line, outlines) for line in getattr(film.road_map, each.name)] for each in fields(RoadMap)
        },
        "frames": [
            {
                "time_ns": frame.time_ns,
                "agents": frame.agents,
                "truth": count(frame.truth, boxes),
                "tracks": {name: count(rows, boxes) for name, rows in frame.tracks.items()},
                "points": {name: count(rows, points) for name, rows in frame.points.items()},
                "lies": [[lie.agent, *(count(r, boxes) for r in lie[1:3]), lie.stated_m] for lie in frame.lies],
            }
            for frame in film.frames
        ],
        "arrived": [{name: sorted(each) for name, each in senders.items()} for senders in film.arrived],
    }
    arrays = {
        "boxes": _columns(boxes, 6, np.int32),
        "points": _columns(points, 2, np.int16),
        "map": _columns(outlines, 2, np.float64),
    }
    if film.drive is not None:
        about["drive"] = {"agent": film.drive.agent, "first_seen": dict(film.drive.first_seen)}
        arrays |= _drive_arrays(film.drive.drive)
    arrays[_ABOUT] = np.frombuffer(json.dumps(about, separators=(",", ":")).encode(), np.uint8)
    content = io.BytesIO()
    np.savez_compressed(content, **arrays, **{_CHECKSUM: _checksum(arrays)})  # type: ignore[arg-type]
    return content.getvalue()


def read_film(path: Path) -> Film:
    """Read a film; the name of its file is the run's key.

    Raises:
        StoreError: the file is missing or broken; names it.
    """
    try:
        arrays = read_npz(path, _LARGEST_BYTES)
        if arrays.pop(_CHECKSUM).tobytes() != _checksum(arrays).tobytes():
            raise ValueError("its checksum is another")
        about = json.loads(arrays[_ABOUT].tobytes(), parse_constant=_refuse)
        if about["format"] != FORMAT or about["key"] != path.stem:
            raise ValueError("it is of another format, or of another run")
        return _film(about, arrays)
    except _BROKEN as error:
        why = error.strerror if isinstance(error, OSError) and error.strerror else f"{error}"
        raise StoreError(f"the film {path} is broken: {why}") from error


def _film(about: Mapping[str, Any], arrays: Arrays) -> Film:
    boxes, points, outlines = (_taking(arrays[name].T) for name in ("boxes", "points", "map"))
    road_map = {name: tuple(outlines(n) for n in counts) for name, counts in about["map"].items()}
    drive = about.get("drive")
    return Film(
        float(about["dt_s"]),
        RoadMap(**road_map),
        [_frame(each, boxes, points) for each in about["frames"]],
        [{name: frozenset(senders) for name, senders in each.items()} for each in about["arrived"]],
        None if drive is None else FilmedDrive(drive["agent"], _drive(arrays), drive["first_seen"]),
    )


def _frame(about: Mapping[str, Any], boxes: Take, points: Take) -> FilmFrame:
    return FilmFrame(
        int(about["time_ns"]),
        {name: Place(float(x), float(y), bool(rides)) for name, (x, y, rides) in about["agents"].items()},
        boxes(about["truth"]),
        tracks={name: boxes(count) for name, count in about["tracks"].items()},
        points={name: points(count) for name, count in about["points"].items()},
        lies=[ShownLie(agent, boxes(n), boxes(m), stated_m) for agent, n, m, stated_m in about["lies"]],
    )


def _taking(array: NDArray[Any]) -> Take:
    """Return a function that returns the next rows of an array at each call."""
    at = 0

    def take(count: int) -> NDArray[Any]:
        nonlocal at
        at += count
        if not 0 <= count <= at <= len(array):
            raise ValueError("its arrays are shorter than it says")
        return array[at - count : at]

    return take


def _columns(parts: Sequence[NDArray[Any]], width: int, dtype: type) -> NDArray[Any]:
    """Return the rows of all parts, column by column: neighbours are alike, which makes files half as large."""
    return np.ascontiguousarray(np.concatenate([np.zeros((0, width), dtype), *parts]).T)


def _checksum(arrays: Arrays) -> NDArray[np.uint8]:
    """Digest arrays with their names and types."""
    whole = hashlib.sha256()
    for name in sorted(arrays):
        whole.update(f"{name} {arrays[name].dtype} {arrays[name].shape}".encode() + arrays[name].tobytes())
    return np.frombuffer(whole.digest(), np.uint8)


def _refuse(constant: str) -> float:
    raise ValueError(f"it has a place {constant}")


_PLAIN = tuple(each.name for each in fields(Drive) if each.name not in ("tracks", "ways"))
_EXACT = "time_s"


def _drive_arrays(drive: Drive) -> Arrays:
    """Return a drive as arrays: places with 32 bits, as its log had them, and the way ahead in steps of `_WAY_M`."""
    arrays = {f"drive_{name}": getattr(drive, name) for name in _PLAIN}
    arrays |= {
        "track_counts": np.array([len(each.label) for each in drive.tracks]),
        "track_boxes": np.concatenate([each.boxes for each in drive.tracks]),
        "track_labels": np.concatenate([each.label for each in drive.tracks]),
        "way_counts": np.array([len(each.points) for each in drive.ways]),
        "way_spacings_m": np.array([each.spacing_m for each in drive.ways]),
        "way_limits": np.concatenate([each.speed_limit_m_s for each in drive.ways]),
    }
    ways = np.round(np.concatenate([each.points for each in drive.ways]) / _WAY_M).astype(np.int32)
    small = {np.dtype(np.float64): np.float32, np.dtype(np.int64): np.int32}
    arrays = {
        name: each.astype(small.get(each.dtype, each.dtype)) if not name.endswith(_EXACT) else each
        for name, each in arrays.items()
    }
    return {**arrays, "way_steps": np.diff(ways.T, prepend=0)}


def _drive(arrays: Arrays) -> Drive:
    large = {np.dtype(np.float32): np.float64, np.dtype(np.int32): np.int64}
    whole = {name: each.astype(large.get(each.dtype, each.dtype)) for name, each in arrays.items()}
    if not (np.isfinite(whole["drive_car"]).all() and np.isfinite(whole["drive_time_s"]).all()):
        raise ValueError("its car has no place")
    boxes, labels = _taking(whole["track_boxes"]), _taking(whole["track_labels"])
    points, limits = _taking(np.cumsum(whole["way_steps"], axis=1).T * _WAY_M), _taking(whole["way_limits"])
    return Drive(
        **{name: whole[f"drive_{name}"] for name in _PLAIN},
        tracks=tuple(ReportedTracks(boxes(n), labels(n)) for n in whole["track_counts"].tolist()),
        ways=tuple(
            WayAhead(points(n), spacing_m, limits(n))
            for n, spacing_m in zip(whole["way_counts"].tolist(), whole["way_spacings_m"].tolist(), strict=True)
        ),
    )
