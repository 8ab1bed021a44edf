"""Clips as named arrays without pickled objects, and back.

Arrays of all frames stand end to end. Points stand in a sweep's order, in which neighbours are near each other, so the
differences between them are kept: compressed they are half as large, in half the time.

| array | content |
|---|---|
| `format` | 3 with doubtful boxes, else 2; 1 has no images and no pixels |
| `key`, `dt_s`, `time_ns` (F,) | the clip and its frames |
| `agents` (F,), `objects` (F,) | numbers of agents and of objects in each frame |
| `name`, `kind`, `xyz_yaw`, `odometry`, `actor_id`, `points`, `cameras` | per agent; actor 0: none |
| `steps_cm` (3, P) int16, `intensity` (P,) uint8 | from each point to the next, modulo 2^16; 255ths |
| `object_id`, `boxes`, `velocity`, `label` | per object |
| `returns` | frame by frame, each (N, A) row by row |
| `counted` (F,), `pixels` | 1 for frames with numbers of pixels, 0 for others; like `returns`, for the frames with 1 |
| `doubts` (F,), `doubtful` (K, 7) | numbers of doubtful boxes in each frame, and these; where a frame has any |
| `size`, `matrix`, `distortion` | per image: (2,) height and width, (3, 3), (5,) |
| `rotation`, `translation` | per image: (3, 3), (3,) of base_SE3_camera |
| `rgb`, `depth_m`, `nearest_label` | image by image, each row by row |

Colours are not changed before they are compressed: they are flat, and differences between pixels take more bytes.
Points are in seven bytes: centimetres in 16 bits, less than the range noise of any LiDAR here, and intensities in 8.
Clips hold points that were rounded so already: a clip from a folder is, bit by bit, the clip that was stored.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from coopsim.errors import InvalidValueError
from coopsim.geometry.se3 import SE3
from coopsim.learn.clips.clip import BLOCK, NO_CLASS, AgentScene, Clip, Picture, Scene
from coopsim.types import CLASS_NAMES, CameraCalibration

_WITH_DOUBTS, _FORMAT, _WITHOUT_PICTURES = 3, 2, 1
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
        "format": np.array(_WITH_DOUBTS if _doubts(scenes) else _FORMAT),
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
        **_doubts(scenes),
        **picture_arrays(agents),
    }


def _doubts(scenes: Sequence[Scene]) -> dict[str, NDArray[Any]]:
    """Return the arrays of doubtful boxes; none where there are no such boxes."""
    each = [np.zeros((0, 7)) if scene.doubtful is None else scene.doubtful for scene in scenes]
    counts = np.array([len(boxes) for boxes in each], np.int64)
    return {"doubts": counts, "doubtful": np.concatenate(each, dtype=np.float64)} if counts.any() else {}


def clip_of(arrays: Arrays) -> Clip:
    """Return the clip of arrays.

    Raises:
        ValueError: they are not those of a clip; says why.
        KeyError: one is missing.
    """
    version = int(arrays["format"])
    if version not in (_WITHOUT_PICTURES, _FORMAT, _WITH_DOUBTS):
        accepted = f"{_WITHOUT_PICTURES} to {_WITH_DOUBTS}"
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
    doubtful = _doubtful(arrays) if version == _WITH_DOUBTS else [None] * len(pixels)
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
            doubtful=doubtful[k],
        )
        for k, (time_ns, there) in enumerate(zip(arrays["time_ns"], each_agents, strict=True))
    ]
    return Clip(str(arrays["key"]), float(arrays["dt_s"]), tuple(scenes))


def _doubtful(arrays: Arrays) -> list[NDArray[Any] | None]:
    """Return the doubtful boxes of each frame; None: it has none."""
    counts, boxes = arrays["doubts"], arrays["doubtful"]
    if counts.dtype != np.int64 or counts.shape != arrays["time_ns"].shape or (counts < 0).any():
        raise ValueError("doubts must be an integer >= 0 of each frame")
    if boxes.dtype != np.float64 or boxes.shape[1:] != (7,) or not np.isfinite(boxes).all():
        raise ValueError("doubtful must be rows of 7 finite numbers of 64 bits")
    return [part if len(part) else None for part in split_rows(boxes, np.cumsum(counts))]


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
    """Check arrays whose errors would show late, in a training."""
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


_IMAGE_ROWS = {"matrix": (3, 3), "distortion": (5,), "rotation": (3, 3), "translation": (3,)}
_PIXELS = {"rgb": np.uint8, "depth_m": np.float16, "nearest_label": np.uint8}


def picture_arrays(agents: Sequence[AgentScene]) -> dict[str, NDArray[Any]]:
    """Return the pictures of agents as arrays."""
    pictures = [picture for agent in agents for picture in agent.pictures]
    cameras = [picture.calibration for picture in pictures]
    rows = {
        "matrix": [camera.matrix for camera in cameras],
        "distortion": [camera.distortion for camera in cameras],
        "rotation": [camera.base_SE3_camera.rotation for camera in cameras],
        "translation": [camera.base_SE3_camera.translation for camera in cameras],
    }
    return {
        "cameras": np.array([len(agent.pictures) for agent in agents], np.int64),
        "size": np.array([camera.size for camera in cameras], np.int64).reshape(-1, 2),
        **{name: np.array(rows[name], np.float64).reshape(-1, *shape) for name, shape in _IMAGE_ROWS.items()},
        "rgb": _flat([picture.rgb for picture in pictures], np.uint8),
        "depth_m": _flat([picture.depth_m for picture in pictures], np.float16),
        "nearest_label": _flat([picture.label for picture in pictures], np.uint8),
    }


def pictures_of(arrays: Mapping[str, NDArray[Any]]) -> list[tuple[Picture, ...]]:
    """Return each agent's pictures."""
    _check_images(arrays)
    size = arrays["size"]
    blocks = -(-size // BLOCK)
    rgb = split_rows(arrays["rgb"], np.cumsum(3 * size.prod(axis=1)))
    depth_m, label = (split_rows(arrays[name], np.cumsum(blocks.prod(axis=1))) for name in ("depth_m", "nearest_label"))
    pictures = [
        Picture(
            _calibration(arrays, k),
            rgb[k].reshape(*size[k], 3),
            depth_m[k].reshape(blocks[k]),
            label[k].reshape(blocks[k]),
        )
        for k in range(len(size))
    ]
    last = np.cumsum(arrays["cameras"]).tolist()
    return [tuple(pictures[end - count : end]) for end, count in zip(last, arrays["cameras"].tolist(), strict=True)]


def _flat(parts: list[NDArray[Any]], dtype: type[np.generic]) -> NDArray[Any]:
    return np.concatenate([np.zeros(0, dtype), *(part.reshape(-1) for part in parts)])


def _calibration(arrays: Mapping[str, NDArray[Any]], k: int) -> CameraCalibration:
    height, width = arrays["size"][k].tolist()
    pose = SE3(arrays["rotation"][k], arrays["translation"][k])
    return CameraCalibration((height, width), arrays["matrix"][k], arrays["distortion"][k], pose)


def _check_images(arrays: Mapping[str, NDArray[Any]]) -> None:
    cameras, size = arrays["cameras"], arrays["size"]
    if cameras.dtype != np.int64 or cameras.ndim != 1 or (cameras < 0).any():
        raise ValueError("cameras must be integers >= 0 of 64 bits in a row")
    if size.dtype != np.int64 or size.ndim != 2 or size.shape[1] != 2 or (size < 1).any():
        raise ValueError("size must be rows of 2 integers >= 1 of 64 bits")
    for name, shape in _IMAGE_ROWS.items():
        array = arrays[name]
        if array.dtype != np.float64 or array.shape[1:] != shape or not np.isfinite(array).all():
            raise ValueError(f"{name} must be finite numbers of 64 bits, {shape} of each picture")
    for name, dtype in _PIXELS.items():
        if arrays[name].dtype != dtype or arrays[name].ndim != 1:
            raise ValueError(f"{name} must be {np.dtype(dtype)} in a row")
    if {len(arrays[name]) for name in ("size", *_IMAGE_ROWS)} != {cameras.sum()}:
        raise ValueError("its arrays have different lengths")
    depth_m, label = arrays["depth_m"], arrays["nearest_label"]
    if not (np.isfinite(depth_m) & (depth_m >= 0)).all():
        raise ValueError("depth_m must be finite numbers >= 0")
    if not ((label < len(CLASS_NAMES)) | (label == NO_CLASS)).all():
        raise ValueError(f"nearest_label must be in 0..{len(CLASS_NAMES) - 1}, or {NO_CLASS}")


def split_rows(array: NDArray[Any], last: NDArray[np.int64]) -> list[NDArray[Any]]:
    """Split a whole array after the rows of these numbers, which must rise to its length."""
    if len(array) != (last[-1] if len(last) else 0) or (np.diff(last, prepend=0) < 0).any():
        raise ValueError("its arrays have different lengths")
    return np.split(array, last[:-1]) if len(last) else []


_PER_M = np.float32(100.0)
_PER_INTENSITY = np.float32(255.0)
MOST_M = 327.0
"""Farthest coordinate of a point."""


def pack_points(points: NDArray[np.float32]) -> tuple[NDArray[np.int16], NDArray[np.uint8]]:
    """Return the coordinates of points (P, 4) as (P, 3) cm, at most 327 m, and their intensities as (P,) 255ths."""
    far, intensity = np.abs(points[:, :3]), points[:, 3]
    if not ((far <= MOST_M).all() and ((intensity >= 0) & (intensity <= 1)).all()):
        raise InvalidValueError(f"points of clips must be within {MOST_M:g} m, with intensities in [0, 1]")
    return np.rint(points[:, :3] * _PER_M).astype(np.int16), np.rint(intensity * _PER_INTENSITY).astype(np.uint8)


def unpack_points(centimetres: NDArray[np.int16], intensity: NDArray[np.uint8]) -> NDArray[np.float32]:
    """Return packed points as (P, 4) float32: x, y, z m and intensity."""
    points = np.empty((len(centimetres), 4), np.float32)
    points[:, :3] = centimetres / _PER_M
    points[:, 3] = intensity / _PER_INTENSITY
    return points


def round_points(points: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return points after packing and unpacking; errors as in `pack_points`."""
    return unpack_points(*pack_points(points))
