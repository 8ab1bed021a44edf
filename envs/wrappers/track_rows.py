"""FixedTracks: the action as numbers in [-1, 1], for learners that track.

The action is one (N,) float32 array: `tracks` rows of 20 columns, end to end, and then, for a car that its action
drives, a number for each of `MANEUVERS`, of which the largest is chosen, or one for the acceleration: from full braking
at -1 over the same speed at 0 to full acceleration at 1; where it steers another follows, for the angle of the wheels.
A row's number is its track's id: to say that an object is the same as before, report it in the same row.

| column | from -1 to 1 stands for |
|---|---|
| `present` | whether the row is a track: above 0 |
| `x`, `y` | -`reach_m` to `reach_m`, in the agent's base frame |
| `z` | -10 m to 10 m, of the middle of the box |
| `l`, `w`, `h` | 0.1 m to 20 m, 4 m, 5 m |
| `yaw` | -pi to pi |
| `vx`, `vy` | -40 m/s to 40 m/s, over ground, in the axes of the base frame |
| `score` | 0 to 1 |
| a column for each class | the largest is the class |
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from coopsim.envs.wrappers.base_wrappers import ActionForm, AnySpace, kind_of
from coopsim.errors import CoopsimError, InvalidActionError, InvalidValueError
from coopsim.geometry.boxes import Boxes3D
from coopsim.geometry.se3 import Floats
from coopsim.support.arrays import as_numbers, require_finite
from coopsim.support.checks import require_count, require_positive
from coopsim.types import Tracks
from coopsim.types.driving import (
    ACCELERATION,
    LARGEST_ACCELERATION_M_S2,
    LARGEST_BRAKING_M_S2,
    LARGEST_STEERING_RAD,
    MANEUVER,
    STEERING,
)
from coopsim.types.messages import MANEUVERS
from coopsim.types.taxonomy import CLASS_NAMES
from coopsim.wire.actions import MESSAGE, pack_tracks

TRACK_COLUMNS = ("present", "x", "y", "z", "l", "w", "h", "yaw", "vx", "vy", "score", *CLASS_NAMES)

LEAST_SIZE_M, MOST_SIZE_M = 0.1, np.array([20.0, 4.0, 5.0])
HIGHEST_M, FASTEST_M_S = 10.0, 40.0

_CLASSES = TRACK_COLUMNS.index("score") + 1

_LENGTHS = {None: 0, MANEUVER: len(MANEUVERS), ACCELERATION: 1, STEERING: 2}
_NAMES = {len(MANEUVERS): "maneuver", 1: "acceleration", 2: "acceleration and steering"}


@dataclass(kw_only=True, eq=False)
class TrackRows(ActionForm):
    """Tracks as rows of a fixed number. See the module for columns.

    Attributes:
        tracks: number of rows.
        reach_m: largest x and y.
    """

    tracks: int = 32
    reach_m: float = 100.0

    def __post_init__(self) -> None:
        require_count(1, tracks=self.tracks)
        require_positive(reach_m=self.reach_m)

    def space(self, inner: AnySpace) -> AnySpace:
        if not (isinstance(inner, spaces.Dict) and "tracks" in inner.spaces):
            raise InvalidValueError(
                f"env must have coopsim's own actions, which no wrapper changed, got {kind_of(inner)}"
            )
        if MESSAGE in inner.spaces:
            raise InvalidValueError(
                'env must have no messages in its actions, which uplink="action" adds: choose Speaking, or a tracker'
            )
        count = self.tracks * len(TRACK_COLUMNS) + _LENGTHS[_command(inner)]
        return spaces.Box(-1.0, 1.0, (count,), np.float32)

    def act(self, agent: str, action: Any, space: AnySpace) -> dict[str, Any]:
        """Return the tracks, and the command if there is one; numbers beyond [-1, 1] are taken as the bound."""
        length = self.tracks * len(TRACK_COLUMNS)
        numbers = self._checked(agent, action, space)
        rows = numbers[:length].reshape(self.tracks, len(TRACK_COLUMNS))
        taken: dict[str, Any] = {"tracks": pack_tracks(self._as_tracks(rows))}
        rest = numbers[length:]
        if len(rest) == _LENGTHS[MANEUVER]:
            taken[MANEUVER] = int(np.argmax(rest))
        elif len(rest):
            most = LARGEST_ACCELERATION_M_S2 if rest[0] > 0 else LARGEST_BRAKING_M_S2
            acceleration = float(most * rest[0])
            taken |= {ACCELERATION: acceleration} if len(rest) == 1 else {STEERING: [acceleration, _angle(rest[1])]}
        return taken

    def _as_tracks(self, rows: Floats) -> Tracks:
        ids = np.flatnonzero(rows[:, 0] > 0)
        rows = rows[ids]
        center = rows[:, 1:4] * [self.reach_m, self.reach_m, HIGHEST_M]
        size = LEAST_SIZE_M + (rows[:, 4:7] + 1) / 2 * (MOST_SIZE_M - LEAST_SIZE_M)
        boxes = Boxes3D(center, size, rows[:, 7] * np.pi)
        return Tracks(
            ids, boxes, rows[:, 8:10] * FASTEST_M_S, (rows[:, 10] + 1) / 2, np.argmax(rows[:, _CLASSES:], axis=1)
        )

    def _checked(self, agent: str, action: Any, space: AnySpace) -> NDArray[np.float64]:
        """Return an action as numbers in [-1, 1]."""
        try:
            numbers = as_numbers(action, np.float64, "action")
            require_finite(numbers, "action")
        except CoopsimError as error:
            raise InvalidActionError(f"{agent}: {error}") from error
        if numbers.shape != space.shape:
            assert space.shape is not None
            more = space.shape[0] - self.tracks * len(TRACK_COLUMNS)
            parts = f"{self.tracks} rows of {len(TRACK_COLUMNS)}" + f" and {more} for the {_NAMES.get(more)}" * (
                more > 0
            )
            raise InvalidActionError(f"{agent}: action must have shape {space.shape}, {parts}, got {numbers.shape}")
        clipped: NDArray[np.float64] = np.clip(numbers, -1.0, 1.0)
        return clipped


def _angle(share: float) -> float:
    return float(LARGEST_STEERING_RAD * share)


def _command(actions: spaces.Dict) -> str | None:
    """Return the name of the part of actions that drives; None: there is none."""
    return next((name for name in (MANEUVER, ACCELERATION, STEERING) if name in actions.spaces), None)
