"""Flatten: all arrays of an observation, end to end."""

from __future__ import annotations

from typing import Any

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from coopsim.envs.wrappers.forms import AnySpace, ObservationForm, kind_of
from coopsim.errors import InvalidValueError

_PICTURE_AXES = 3


class FlatForm(ObservationForm):
    """One (N,) float32 array of all arrays, in the alphabetical order of their names; a picture by itself stays one."""

    def space(self, inner: AnySpace) -> AnySpace:
        parts = [inner] if isinstance(inner, spaces.Box) else _parts(inner)
        if isinstance(inner, spaces.Box) and len(inner.shape) == _PICTURE_AXES:
            return spaces.Box(inner.low, inner.high, dtype=inner.dtype.type)
        low, high = ([getattr(part, side).reshape(-1) for part in parts] for side in ("low", "high"))
        return spaces.Box(np.concatenate(low, dtype=np.float32), np.concatenate(high, dtype=np.float32))

    def observe(self, agent: str, observation: Any) -> NDArray[Any]:
        if isinstance(observation, dict):
            return np.concatenate([observation[name].reshape(-1) for name in sorted(observation)], dtype=np.float32)
        picture: NDArray[Any] = observation
        return picture if picture.ndim == _PICTURE_AXES else picture.reshape(-1).astype(np.float32)


def _parts(space: AnySpace) -> list[spaces.Box]:
    """Return the boxes of a space, by the alphabetical order of their names."""
    parts = [space[name] for name in sorted(space.spaces)] if isinstance(space, spaces.Dict) else [space]
    boxes = [part for part in parts if isinstance(part, spaces.Box)]
    if len(boxes) < len(parts):
        raise InvalidValueError(f"env must be wrapped in FixedSize or BevImage before Flatten: it has {kind_of(space)}")
    return boxes
