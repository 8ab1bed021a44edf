"""Clips as files: compressed arrays (npz) without pickled objects.

Arrays of all frames stand end to end. Points stand in a sweep's order, in which neighbours are near each other, so the
differences between them are stored: half the size, and twice as fast to compress.

| array | content |
|---|---|
| `format` | 1 |
| `key`, `dt_s`, `time_ns` (F,) | of the clip and its frames |
| `agents` (F,), `objects` (F,) | numbers of agents and of objects of each frame |
| `name`, `kind`, `xyz_yaw`, `odometry`, `actor_id`, `points` | of each agent; actor 0: none; number of points |
| `steps_cm` (3, P) int16, `intensity` (P,) uint8 | from each point to the next, modulo 2^16; 255ths |
| `object_id`, `boxes`, `velocity`, `label` | of each object |
| `returns` | frame by frame, each (N, A) row by row |
"""

from __future__ import annotations

import io
import zipfile
import zlib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.lib import format as npy
from numpy.typing import NDArray

from coopsim.errors import InvalidValueError, RecordingError
from coopsim.learn.compact_points import pack_points, unpack_points
from coopsim.learn.scene import AgentScene, Clip, Scene
from coopsim.support.files import write_durably

_FORMAT = 1
_LEVEL = 3  # of deflate: higher ones take several times as long for 3 %
_LARGEST_BYTES = 4 * 2**30  # of a file's arrays: what says it has more is broken
_DAY = (1980, 1, 1, 0, 0, 0)  # no clock: the same clip gives the same file
_BROKEN = (OSError, ValueError, KeyError, IndexError, TypeError, EOFError, zipfile.BadZipFile, zlib.error)
_NO_ACTOR = 0

Arrays = dict[str, NDArray[Any]]


def save_clip(path: Path, clip: Clip) -> None:
    """Write a clip whole or not at all; its points are rounded as those of `SimulatedClips` are already.

    Raises:
        InvalidValueError: the file cannot be written, or the clip has no frames or points beyond 327 m.
    """
    write_durably(path, clip_bytes(clip))


def load_clip(path: Path) -> Clip:
    """Read a clip.

    Raises:
        RecordingError: the file is missing or broken; names it.
    """
    try:
        return _clip(_read(path))
    except (*_BROKEN, NotImplementedError, RuntimeError) as error:
        why = error.strerror if isinstance(error, OSError) and error.strerror else error
        raise RecordingError(f"{path} is no clip: {why}") from error


def clip_bytes(clip: Clip) -> bytes:
    """Return the content of a clip's file; errors as `save_clip`."""
    if not clip.scenes:
        raise InvalidValueError("a clip must have at least one frame, got none")
    packed = io.BytesIO()
    with zipfile.ZipFile(packed, "w", zipfile.ZIP_DEFLATED, compresslevel=_LEVEL) as archive:
        for name, array in _arrays(clip).items():
            member = io.BytesIO()
            npy.write_array(member, array, allow_pickle=False)
            entry = zipfile.ZipInfo(f"{name}.npy", _DAY)
            archive.writestr(entry, member.getvalue(), zipfile.ZIP_DEFLATED, _LEVEL)
    return packed.getvalue()


def _arrays(clip: Clip) -> Arrays:
    scenes = clip.scenes
    agents = [agent for scene in scenes for agent in scene.agents]
    packed = [pack_points(agent.points) for agent in agents]
    centimetres = np.concatenate([np.zeros((0, 3), np.int16), *(part for part, _ in packed)])
    return {
        "format": np.array(_FORMAT),
        "key": np.array(clip.key),
        "dt_s": np.array(clip.dt_s, np.float64),
        "time_ns": np.array([scene.time_ns for scene in scenes], np.int64),
        "agents": np.array([len(scene.agents) for scene in scenes], np.int64),
        "objects": np.array([len(scene.object_id) for scene in scenes], np.int64),
        "name": np.array([agent.name for agent in agents], np.str_),
        "kind": np.array([agent.kind for agent in agents], np.str_),
        "xyz_yaw": np.array([agent.xyz_yaw for agent in agents], np.float64).reshape(-1, 4),
        "odometry": np.array([agent.odometry for agent in agents], np.float64).reshape(-1, 4),
        "actor_id": np.array([agent.actor_id or _NO_ACTOR for agent in agents], np.int64),
        "points": np.array([len(agent.points) for agent in agents], np.int64),
        "steps_cm": np.diff(centimetres.T, axis=1, prepend=np.int16(0)),
        "intensity": np.concatenate([np.zeros(0, np.uint8), *(part for _, part in packed)]),
        "object_id": np.concatenate([scene.object_id for scene in scenes]),
        "boxes": np.concatenate([scene.boxes for scene in scenes]),
        "velocity": np.concatenate([scene.velocity for scene in scenes]),
        "label": np.concatenate([scene.label for scene in scenes]),
        "returns": np.concatenate([scene.returns.reshape(-1) for scene in scenes]),
    }


def _read(path: Path) -> Arrays:
    with zipfile.ZipFile(path) as archive:
        if sum(entry.file_size for entry in archive.infolist()) > _LARGEST_BYTES:
            raise ValueError("its arrays are too large")
        names = archive.namelist()
        return {name.removesuffix(".npy"): _member(archive, name) for name in names}


def _member(archive: zipfile.ZipFile, name: str) -> NDArray[Any]:
    content = archive.read(name)
    array: NDArray[Any] = npy.read_array(io.BytesIO(content), allow_pickle=False)
    return array


def _clip(arrays: Arrays) -> Clip:
    if int(arrays["format"]) != _FORMAT:
        raise ValueError(f"its format is {arrays['format']}, and this version of coopsim reads {_FORMAT}")
    agents = list(_agents(arrays))
    after = np.cumsum(arrays["agents"]).tolist()
    last = np.cumsum(arrays["objects"])
    parts = {name: _parts(arrays[name], last) for name in ("object_id", "boxes", "velocity", "label")}
    if after[-1:] != [len(agents)]:
        raise ValueError("its arrays have different lengths")
    each_agents = [agents[end - count : end] for end, count in zip(after, arrays["agents"].tolist(), strict=True)]
    returns = _parts(arrays["returns"], np.cumsum(arrays["objects"] * arrays["agents"]))
    scenes = [
        Scene(
            time_ns=int(time_ns),
            agents=tuple(there),
            object_id=parts["object_id"][k],
            boxes=_rows(parts["boxes"][k], 7),
            velocity=_rows(parts["velocity"][k], 2),
            label=parts["label"][k],
            returns=returns[k].reshape(len(parts["object_id"][k]), len(there)),
        )
        for k, (time_ns, there) in enumerate(zip(arrays["time_ns"], each_agents, strict=True))
    ]
    return Clip(str(arrays["key"]), float(arrays["dt_s"]), tuple(scenes))


def _agents(arrays: Arrays) -> Iterator[AgentScene]:
    centimetres = np.cumsum(arrays["steps_cm"], axis=1, dtype=np.int16).T
    points = unpack_points(centimetres, arrays["intensity"])
    each = _parts(points, np.cumsum(arrays["points"]))
    columns = zip(
        arrays["name"], arrays["kind"], arrays["xyz_yaw"], arrays["odometry"], arrays["actor_id"], strict=True
    )
    for (name, kind, at, odometry, actor), own in zip(columns, each, strict=True):
        actor_id = None if actor == _NO_ACTOR else int(actor)
        yield AgentScene(str(name), str(kind), _rows(at, 4), _rows(odometry, 4), own, actor_id)


def _parts(array: NDArray[Any], last: NDArray[np.int64]) -> list[NDArray[Any]]:
    """Split an array after the rows of these numbers, all of it."""
    if len(array) != (last[-1] if len(last) else 0) or (np.diff(last, prepend=0) < 0).any():
        raise ValueError("its arrays have different lengths")
    return np.split(array, last[:-1]) if len(last) else []


def _rows(array: NDArray[Any], width: int) -> NDArray[np.float64]:
    if array.shape[-1] != width or array.dtype != np.float64:
        raise ValueError(f"it has rows {array.dtype} of {array.shape[-1]} for {width} numbers")
    return array
