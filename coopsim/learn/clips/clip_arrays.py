"""Clips as named arrays without pickled objects, and back.

Arrays of all frames stand end to end. Points stand in a sweep's order, in which neighbours are near each other, so the
differences between them are kept: compressed they are half as large, in half the time.

| array | content |
|---|---|
| `format` | 2; 1 has no pictures and no pixels |
| `key`, `dt_s`, `time_ns` (F,) | of the clip and its frames |
| `agents` (F,), `objects` (F,) | numbers of agents and of objects of each frame |
| `name`, `kind`, `xyz_yaw`, `odometry`, `actor_id`, `points` | of each agent; actor 0: none; number of points |
| `steps_cm` (3, P) int16, `intensity` (P,) uint8 | from each point to the next, modulo 2^16; 255ths |
| `object_id`, `boxes`, `velocity`, `label` | of each object |
| `returns` | frame by frame, each (N, A) row by row |
| `counted` (F,), `pixels` | 1 for frames with numbers of pixels, 0 for others; as `returns`, of the frames with 1 |
| | and the arrays of `coopsim.learn.clips.picture_arrays` |
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from coopsim.errors import InvalidValueError
from coopsim.learn.clips.clip import AgentScene, Clip, Scene
from coopsim.learn.clips.compact_points import pack_points, unpack_points
from coopsim.learn.clips.picture_arrays import picture_arrays, pictures_of
from coopsim.learn.clips.split_rows import split_rows
from coopsim.types import CLASS_NAMES

_FORMAT, _WITHOUT_PICTURES = 2, 1
_NO_ACTOR = 0
_COUNTS = ("time_ns", "agents", "objects", "actor_id", "points", "object_id", "label", "returns", "counted", "pixels")
_ROWS = {"xyz_yaw": 4, "odometry": 4, "boxes": 7, "velocity": 2}

Arrays = Mapping[str, NDArray[Any]]


def arrays_of(clip: Clip) -> Arrays:
    """Return a clip as arrays.

    Raises:
        InvalidValueError: it has no frames, or points that cannot be packed.
    """
    if not clip.scenes:
        raise InvalidValueError("a clip must have at least one frame, got none")
    scenes = clip.scenes
    agents = [agent for scene in scenes for agent in scene.agents]
    pixels = [scene.pixels for scene in scenes if scene.pixels is not None]
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
        "object_id": np.concatenate([scene.object_id for scene in scenes], dtype=np.int64),
        "boxes": np.concatenate([scene.boxes for scene in scenes], dtype=np.float64),
        "velocity": np.concatenate([scene.velocity for scene in scenes], dtype=np.float64),
        "label": np.concatenate([scene.label for scene in scenes], dtype=np.int64),
        "returns": np.concatenate([scene.returns.reshape(-1) for scene in scenes], dtype=np.int64),
        "counted": np.array([scene.pixels is not None for scene in scenes], np.int64),
        "pixels": np.concatenate([np.zeros(0, np.int64), *(counts.reshape(-1) for counts in pixels)], dtype=np.int64),
        **picture_arrays(agents),
    }


def clip_of(arrays: Arrays) -> Clip:
    """Return the clip of arrays.

    Raises:
        ValueError: they are not those of a clip; says why.
        KeyError: one is missing.
    """
    version = int(arrays["format"])
    if version not in (_WITHOUT_PICTURES, _FORMAT):
        accepted = f"{_WITHOUT_PICTURES} and {_FORMAT}"
        raise ValueError(f"its format is {version}, and this version of coopsim reads {accepted}")
    if version == _WITHOUT_PICTURES:
        arrays = {**arrays, **_no_pictures(arrays)}
    _check(arrays)
    agents = list(_agents(arrays))
    after = np.cumsum(arrays["agents"]).tolist()
    last = np.cumsum(arrays["objects"])
    parts = {name: split_rows(arrays[name], last) for name in ("object_id", "boxes", "velocity", "label")}
    if after[-1:] != [len(agents)]:
        raise ValueError("its arrays have different lengths")
    each_agents = [agents[end - count : end] for end, count in zip(after, arrays["agents"].tolist(), strict=True)]
    pairs = arrays["objects"] * arrays["agents"]
    returns = split_rows(arrays["returns"], np.cumsum(pairs))
    counted = arrays["counted"]
    pixels = split_rows(arrays["pixels"], np.cumsum(pairs * counted))
    scenes = [
        Scene(
            time_ns=int(time_ns),
            agents=tuple(there),
            object_id=parts["object_id"][k],
            boxes=parts["boxes"][k],
            velocity=parts["velocity"][k],
            label=parts["label"][k],
            returns=returns[k].reshape(len(parts["object_id"][k]), len(there)),
            pixels=pixels[k].reshape(len(parts["object_id"][k]), len(there)) if counted[k] else None,
        )
        for k, (time_ns, there) in enumerate(zip(arrays["time_ns"], each_agents, strict=True))
    ]
    return Clip(str(arrays["key"]), float(arrays["dt_s"]), tuple(scenes))


def _agents(arrays: Arrays) -> Iterator[AgentScene]:
    centimetres = np.cumsum(arrays["steps_cm"], axis=1, dtype=np.int16).T
    points = unpack_points(centimetres, arrays["intensity"])
    each = split_rows(points, np.cumsum(arrays["points"]))
    columns = zip(
        arrays["name"], arrays["kind"], arrays["xyz_yaw"], arrays["odometry"], arrays["actor_id"], strict=True
    )
    for (name, kind, at, odometry, actor), own, pictures in zip(columns, each, pictures_of(arrays), strict=True):
        actor_id = None if actor == _NO_ACTOR else int(actor)
        yield AgentScene(str(name), str(kind), at, odometry, own, actor_id, pictures)


def _no_pictures(arrays: Arrays) -> Arrays:
    """Return the arrays that a file of the first format lacks."""
    frames, agents = len(arrays["time_ns"]), len(arrays["name"])
    nothing = {"counted": np.zeros(frames, np.int64), "pixels": np.zeros(0, np.int64)}
    return {**nothing, **picture_arrays([]), "cameras": np.zeros(agents, np.int64)}


def _check(arrays: Arrays) -> None:
    """Check what nobody would notice before a training fails of it."""
    for name in _COUNTS:
        if arrays[name].dtype != np.int64 or arrays[name].ndim != 1:
            raise ValueError(f"{name} must be integers of 64 bits in a row")
    for name, width in _ROWS.items():
        array = arrays[name]
        if array.dtype != np.float64 or array.ndim != 2 or array.shape[1] != width or not np.isfinite(array).all():
            raise ValueError(f"{name} must be rows of {width} finite numbers of 64 bits")
    steps, intensity = arrays["steps_cm"], arrays["intensity"]
    if steps.dtype != np.int16 or intensity.dtype != np.uint8 or steps.shape != (3, *intensity.shape):
        raise ValueError("steps_cm must be (3, P) int16, and intensity (P,) uint8")
    if not np.isin(arrays["counted"], (0, 1)).all() or arrays["counted"].shape != arrays["time_ns"].shape:
        raise ValueError("counted must be 0 or 1 of each frame")
    if (
        len({len(arrays[name]) for name in ("name", "kind", "xyz_yaw", "odometry", "actor_id", "points", "cameras")})
        > 1
    ):
        raise ValueError("its arrays have different lengths")
    if not ((arrays["label"] >= 0) & (arrays["label"] < len(CLASS_NAMES))).all():
        raise ValueError(f"label must be in 0..{len(CLASS_NAMES) - 1}")
    if not (arrays["boxes"][:, 3:6] > 0).all():
        raise ValueError("boxes must have sizes > 0")
