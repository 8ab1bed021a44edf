"""Files of films: compressed NumPy arrays without pickles, and a description in JSON, with a checksum of all."""

from __future__ import annotations

import hashlib
import io
import json
import math
import struct
import zipfile
import zlib
from collections import defaultdict
from collections.abc import Callable, Mapping
from dataclasses import fields, is_dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from coopsim.bench.films.film import Film, FilmedDrive, FilmFrame, Place, ShownLie
from coopsim.bench.films.space import Solid, SpaceFrame
from coopsim.errors import StoreError
from coopsim.metrics.drive_log import Drive, ReportedTracks, WayAhead
from coopsim.support.plain_arrays import read_npz
from coopsim.world.snapshot import RoadMap

FORMAT = 1
"""Raise this number when films are stored otherwise."""

_ABOUT, _CHECKSUM, _ARRAY = "about", "checksum", "\0array"
_LARGEST_BYTES = 2**30  # of a film's arrays: a file that names more is broken
_WAY_M = 0.05
_BROKEN = (
    *(OSError, ValueError, KeyError, IndexError, TypeError, EOFError, ArithmeticError, MemoryError, AttributeError),
    *(RuntimeError, NotImplementedError, struct.error, zipfile.BadZipFile, zlib.error),
)
"""Errors of reading a broken file: all that zipfile, json and numpy raise."""

Arrays = Mapping[str, NDArray[Any]]


def film_bytes(film: Film, key: str) -> bytes:
    """Return the content of a film's file, of the run with this key; equal films give equal bytes."""
    pools: defaultdict[str, list[NDArray[Any]]] = defaultdict(list)
    small = film if film.drive is None else replace(film, drive=replace(film.drive, drive=_small(film.drive.drive)))
    about = {"format": FORMAT, "key": key, "film": _packed(small, pools)}
    # Column by column: neighbours are alike, which makes files half as large.
    arrays: dict[str, NDArray[Any]] = {n: np.ascontiguousarray(np.concatenate(each).T) for n, each in pools.items()}
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
        about = json.loads(arrays.pop(_ABOUT).tobytes(), parse_constant=_refuse)
        if about["format"] != FORMAT or about["key"] != path.stem:
            raise ValueError("it is of another format, or of another run")
        return _film(_unpacked(about["film"], {name: _taking(each.T) for name, each in arrays.items()}))
    except _BROKEN as error:
        why = error.strerror if isinstance(error, OSError) and error.strerror else f"{error}"
        raise StoreError(f"the film {path.parent.name}/{path.name} is broken: {why}") from error


def _packed(value: Any, pools: defaultdict[str, list[NDArray[Any]]]) -> Any:
    """Return a value as JSON has it; arrays go to the pool of those with their type and number of columns."""
    if isinstance(value, np.ndarray):
        rows = value.reshape(-1, value.shape[-1] if value.ndim > 1 else 1)
        name = f"{value.dtype.name}_{rows.shape[1]}"
        pools[name].append(rows)
        return {_ARRAY: [name, *value.shape]}
    if is_dataclass(value):
        return {each.name: _packed(getattr(value, each.name), pools) for each in fields(value)}
    if isinstance(value, Mapping):
        return {name: _packed(each, pools) for name, each in value.items()}
    if isinstance(value, (list, tuple, frozenset)):
        return [_packed(each, pools) for each in (sorted(value) if isinstance(value, frozenset) else value)]
    return value


def _unpacked(value: Any, pools: Mapping[str, Callable[[int], NDArray[Any]]]) -> Any:
    """Return a value with its arrays, which are taken in the order in which they were packed; lists are tuples."""
    if isinstance(value, dict) and _ARRAY in value:
        name, *shape = value[_ARRAY]
        return pools[name](math.prod(shape[:-1] if len(shape) > 1 else shape)).reshape(shape)
    if isinstance(value, dict):
        return {name: _unpacked(each, pools) for name, each in value.items()}
    return tuple(_unpacked(each, pools) for each in value) if isinstance(value, list) else value


def _taking(array: NDArray[Any]) -> Callable[[int], NDArray[Any]]:
    """Return a function that returns the next rows of an array at each call; places of 32 bits get 64."""
    # In rows: kernels take no array with gaps.
    wide, at = np.ascontiguousarray(array, np.float64 if array.dtype == np.float32 else array.dtype), 0

    def take(count: int) -> NDArray[Any]:
        nonlocal at
        at += count
        if not 0 <= count <= at <= len(wide):
            raise ValueError("its arrays are shorter than it says")
        return wide[at - count : at]

    return take


def _film(told: Mapping[str, Any]) -> Film:
    frames = [
        FilmFrame(
            **frame
            | {
                "agents": {name: Place(*place) for name, place in frame["agents"].items()},
                "lies": [ShownLie(*lie) for lie in frame["lies"]],
                "space": SpaceFrame(**frame["space"]) if frame.get("space") else None,
            }
        )
        for frame in told["frames"]
    ]
    arrived = [{name: frozenset(senders) for name, senders in each.items()} for each in told["arrived"]]
    drive = told["drive"] and FilmedDrive(**told["drive"] | {"drive": _drive(told["drive"]["drive"])})
    solids = tuple(Solid(**each) for each in told.get("solids", ()))  # older films have none
    return Film(float(told["dt_s"]), RoadMap(**told["road_map"]), frames, arrived, drive, solids)


def _small(drive: Drive) -> Drive:
    """Return a drive with places of 32 bits, as its log had them, and ways ahead in steps of `_WAY_M`."""
    places = {name: getattr(drive, name).astype(np.float32) for name in ("car", "boxes", "velocity")}
    ways = [
        WayAhead(np.diff(np.round(points / _WAY_M).astype(np.int32), axis=0, prepend=0), spacing_m, limits)
        for points, spacing_m, limits in drive.ways
    ]
    tracks = [ReportedTracks(boxes.astype(np.float32), labels) for boxes, labels in drive.tracks]
    return replace(drive, **places, tracks=tuple(tracks), ways=tuple(ways))


def _drive(columns: Mapping[str, Any]) -> Drive:
    """Return the drive of `_small`, with the ways' points."""
    if not (np.isfinite(columns["car"]).all() and np.isfinite(columns["time_s"]).all()):
        raise ValueError("its car has no place")
    ways = tuple(WayAhead(np.cumsum(steps, axis=0) * _WAY_M, *rest) for steps, *rest in columns["ways"])
    tracks = tuple(ReportedTracks(*each) for each in columns["tracks"])
    return Drive(**{**columns, "ways": ways, "tracks": tracks})


def _checksum(arrays: Arrays) -> NDArray[np.uint8]:
    """Digest arrays with their names and types."""
    whole = hashlib.sha256()
    for name in sorted(arrays):
        whole.update(f"{name} {arrays[name].dtype} {arrays[name].shape}".encode() + arrays[name].tobytes())
    return np.frombuffer(whole.digest(), np.uint8)


def _refuse(constant: str) -> float:
    raise ValueError(f"it has a place {constant}")
