"""Pictures of a clip as named arrays, and back.

| array | content |
|---|---|
| `cameras` | of each agent, the number of its pictures |
| `size`, `matrix`, `distortion` | of each picture: (2,) height and width, (3, 3), (5,) |
| `rotation`, `translation` | of each picture: (3, 3), (3,) of base_SE3_camera |
| `rgb`, `depth_m`, `nearest_label` | picture by picture, each row by row |

Colours are not changed before they are compressed: they are flat, and differences between pixels take more bytes.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from coopsim.geometry.se3 import SE3
from coopsim.learn.clips.clip import BLOCK, AgentScene, Picture
from coopsim.learn.clips.split_rows import split_rows
from coopsim.types import CLASS_NAMES, CameraCalibration

_ROWS = {"matrix": (3, 3), "distortion": (5,), "rotation": (3, 3), "translation": (3,)}
_PIXELS = {"rgb": np.uint8, "depth_m": np.float16, "nearest_label": np.uint8}
_NO_CLASS = 255


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
        **{name: np.array(rows[name], np.float64).reshape(-1, *shape) for name, shape in _ROWS.items()},
        "rgb": _flat([picture.rgb for picture in pictures], np.uint8),
        "depth_m": _flat([picture.depth_m for picture in pictures], np.float16),
        "nearest_label": _flat([picture.label for picture in pictures], np.uint8),
    }


def pictures_of(arrays: Mapping[str, NDArray[Any]]) -> list[tuple[Picture, ...]]:
    """Return each agent's pictures.

    Raises:
        ValueError: the arrays are not those of pictures; says why.
        KeyError: one is missing.
    """
    _check(arrays)
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


def _check(arrays: Mapping[str, NDArray[Any]]) -> None:
    cameras, size = arrays["cameras"], arrays["size"]
    if cameras.dtype != np.int64 or cameras.ndim != 1 or (cameras < 0).any():
        raise ValueError("cameras must be integers >= 0 of 64 bits in a row")
    if size.dtype != np.int64 or size.ndim != 2 or size.shape[1] != 2 or (size < 1).any():
        raise ValueError("size must be rows of 2 integers >= 1 of 64 bits")
    for name, shape in _ROWS.items():
        array = arrays[name]
        if array.dtype != np.float64 or array.shape[1:] != shape or not np.isfinite(array).all():
            raise ValueError(f"{name} must be finite numbers of 64 bits, {shape} of each picture")
    for name, dtype in _PIXELS.items():
        if arrays[name].dtype != dtype or arrays[name].ndim != 1:
            raise ValueError(f"{name} must be {np.dtype(dtype)} in a row")
    if {len(arrays[name]) for name in ("size", *_ROWS)} != {cameras.sum()}:
        raise ValueError("its arrays have different lengths")
    depth_m, label = arrays["depth_m"], arrays["nearest_label"]
    if not (np.isfinite(depth_m) & (depth_m >= 0)).all():
        raise ValueError("depth_m must be finite numbers >= 0")
    if not ((label < len(CLASS_NAMES)) | (label == _NO_CLASS)).all():
        raise ValueError(f"nearest_label must be in 0..{len(CLASS_NAMES) - 1}, or {_NO_CLASS}")
