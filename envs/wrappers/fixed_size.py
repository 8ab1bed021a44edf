"""FixedSize: the nearest or surest boxes, in rows of fixed number.

Frame: the agent's base frame now (x forward, y left, z up, origin on the ground under the agent).

| key | shape | rows |
|---|---|---|
| `own` | (12,) | the agent itself: `OWN_COLUMNS` |
| `detections` | (detections, 18) | its own detections: `DETECTION_COLUMNS` |
| `messages` | (messages, 9) | the messages that arrived since the last observation: `MESSAGE_COLUMNS` |
| `received` | (messages, received, 20) | the boxes in each of them: `RECEIVED_COLUMNS` |
| `points` | (points, 4) | points of its own LiDARs: `POINT_COLUMNS` |
| `<key>_mask` | as `<key>`, without the last axis | 1 where a row has content, 0 where it is padding (zeros) |

In an environment with `uplink="action"` the scores of a message are those of the rows of `detections`, in their order;
detections that are not shown are not sent.

A number that is 0 leaves its keys out. Rows with content come first. All are float32, finite, and within the bounds
of their space: what lies beyond `reach_m` is left out, all else beyond a bound is taken as the bound.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from coopsim.envs.wrappers.base_wrappers import AnySpace, cooperative_env
from coopsim.envs.wrappers.message_numbers import ScoresByRow
from coopsim.envs.wrappers.received import (
    BOX,
    LABEL,
    SCORE,
    VELOCITY,
    Arrays,
    Received,
    Scene,
    View,
    all_rows,
    deviations,
    usable,
)
from coopsim.geometry.se3 import Floats
from coopsim.support.checks import require_choice, require_count, require_positive
from coopsim.types import Ints, Observation
from coopsim.types.taxonomy import CLASS_NAMES

ORDERS = ("nearest", "surest")

_BOX_COLUMNS = ("x", "y", "z", "l", "w", "h", "cos_yaw", "sin_yaw", "score")
_BOX_LIMITS = (np.inf, np.inf, np.inf, 100.0, 100.0, 100.0, 1.0, 1.0, 1e3)  # inf: reach_m

OWN_COLUMNS = {
    "x": 1e6,
    "y": 1e6,
    "z": 1e6,
    "cos_heading": 1.0,
    "sin_heading": 1.0,
    "dx": 1e3,
    "dy": 1e3,
    "turn": np.pi,
    "std_x": 1e3,
    "std_y": 1e3,
    "std_heading": 2 * np.pi,
    "sensed": 1.0,
}
"""Estimated pose in the world frame (m); motion since the last observation (m, rad); standard deviations that the agent
states of its pose (m, rad; 0: none stated); whether sensors and detector ran in this frame. With the largest sizes."""

DETECTION_COLUMNS = (*_BOX_COLUMNS, *CLASS_NAMES)
"""Box (m), heading, confidence, and 1 in the column of its class."""

RECEIVED_COLUMNS = (*_BOX_COLUMNS, *CLASS_NAMES, "vx", "vy")
"""As `DETECTION_COLUMNS`, and the velocity (m/s over ground; 0 where the message has none). Boxes are where the sender
saw them at capture, moved by the estimated poses of sender (then) and receiver (now)."""

MESSAGE_COLUMNS = ("x", "y", "z", "cos_heading", "sin_heading", "age", "std_x", "std_y", "std_heading")
"""The sender's estimated pose at capture (m), seconds since capture, and standard deviations that it states (m, rad; 0:
none stated)."""

POINT_COLUMNS = ("x", "y", "z", "intensity")
"""m, and [0, 1]."""


@dataclass(kw_only=True, eq=False)
class FixedSizeView(View):
    """The nearest or surest boxes, in rows of fixed number. See the module for keys and columns.

    Attributes:
        detections: number of own detections.
        messages: number of messages: the newest, and among equally new ones those of the nearest senders.
        received: number of boxes of each message.
        points: number of LiDAR points, evenly spaced among those within `reach_m`.
        order: rule by which boxes come first, and stay where not all fit: "nearest" or "surest".
        reach_m: boxes, senders and points farther away, along x, y or z, are left out.
    """

    detections: int = 32
    messages: int = 8
    received: int = 16
    points: int = 0
    order: str = "nearest"
    reach_m: float = 200.0

    def __post_init__(self) -> None:
        require_count(0, detections=self.detections, messages=self.messages, received=self.received)
        require_count(0, points=self.points)
        require_choice("order", self.order, ORDERS)
        require_positive(reach_m=self.reach_m)
        self._scores: ScoresByRow | None = None
        self._shown: dict[str, Ints] = {}

    def require(self, env: Any) -> None:
        """Take over the part `message` of the environment's actions."""
        part = next(iter(cooperative_env(env).agent_specs.values())).message
        scored = part is not None and part.form == "scores" and self.detections > 0
        self._scores = ScoresByRow(part, self.detections) if part is not None and scored else None

    def action_space(self, inner: AnySpace) -> AnySpace:
        return inner if self._scores is None else self._scores.space(inner)

    def act(self, agent: str, action: Any) -> Any:
        """Return the environment's action, with scores in the order of its detections."""
        shown = self._shown.get(agent)
        return action if self._scores is None or shown is None else self._scores.act(agent, action, shown)

    def spaces(self) -> dict[str, spaces.Box]:
        limits, shapes = self._limits, self._shapes
        found = {"own": _bounded((), limits["own"])}
        for name, shape in shapes.items():
            found[name] = _bounded(shape, limits[name])
            found[f"{name}_mask"] = spaces.Box(0.0, 1.0, shape, np.float32)
        return found

    def show(self, scene: Scene) -> Arrays:
        """Return new arrays, by name; see the module."""
        limits, shapes = self._limits, self._shapes
        shown: Arrays = {"own": _clipped(_own(scene.observation), limits["own"])}
        for name, (rows, place) in self._contents(scene).items():
            shape, columns = shapes[name], limits[name]
            table, mask = np.zeros((*shape, len(columns)), np.float32), np.zeros(shape, np.float32)
            table[place], mask[place] = _clipped(rows, columns), 1.0
            shown[name], shown[f"{name}_mask"] = table, mask
        return shown

    @cached_property
    def _shapes(self) -> dict[str, tuple[int, ...]]:
        shapes = {
            "detections": (self.detections,),
            "messages": (self.messages,),
            "received": (self.messages, self.received),
            "points": (self.points,),
        }
        return {name: shape for name, shape in shapes.items() if min(shape) > 0}

    @cached_property
    def _limits(self) -> dict[str, Floats]:
        """Return the largest size of each column, by key."""
        reach, ones = self.reach_m, (1.0,) * len(CLASS_NAMES)
        box = tuple(min(limit, reach) if limit == np.inf else limit for limit in _BOX_LIMITS)
        limits = {
            "own": tuple(OWN_COLUMNS.values()),
            "detections": (*box, *ones),
            "messages": (reach, reach, reach, 1.0, 1.0, 3600.0, 1e3, 1e3, 2 * np.pi),
            "received": (*box, *ones, 100.0, 100.0),
            "points": (reach, reach, reach, 1.0),
        }
        return {name: np.array(columns) for name, columns in limits.items()}

    def _contents(self, scene: Scene) -> dict[str, tuple[Floats, tuple[Ints, ...]]]:
        """Return rows by key, each with the places of its rows in the table."""
        found: dict[str, tuple[Floats, tuple[Ints, ...]]] = {}
        if self.detections:
            rows = all_rows(scene.observation.detections)
            known = np.flatnonzero(usable(rows))
            known = known[(np.abs(rows[known, :3]) <= self.reach_m).all(axis=1)]
            self._shown[scene.agent] = known = known[self._first(rows[known])[: self.detections]]
            rows = rows[known]
            found["detections"] = _columns(rows), (np.arange(len(rows)),)
        if self.messages:
            kept = self._kept_messages(scene.received)
            found["messages"] = _message_columns(scene.received, kept), (np.arange(len(kept)),)
            if self.received:
                found["received"] = self._kept_boxes(scene.received, kept)
        if self.points:
            points = _spread(self._points(scene.observation), self.points)
            found["points"] = points, (np.arange(len(points)),)
        return found

    def _within(self, rows: Floats) -> Floats:
        return rows[(np.abs(rows[:, :3]) <= self.reach_m).all(axis=1)]

    def _points(self, observation: Observation) -> Floats:
        """Return the points (P, 4) of all sweeps that are within reach."""
        parts = [np.column_stack([sweep.points, sweep.intensity]) for sweep in observation.sweeps.values()]
        return self._within(np.concatenate([np.zeros((0, 4)), *parts]))

    def _first(self, rows: Floats) -> Ints:
        """Return the order of boxes: indices (N,)."""
        return np.argsort(self._rank(rows), kind="stable")

    def _rank(self, rows: Floats) -> Floats:
        rank: Floats = np.hypot(rows[:, 0], rows[:, 1]) if self.order == "nearest" else -rows[:, SCORE]
        return rank

    def _kept_messages(self, received: Received) -> Ints:
        within = np.flatnonzero((np.abs(received.pose[:, :3]) <= self.reach_m).all(axis=1))
        away = np.hypot(received.pose[within, 0], received.pose[within, 1])
        return within[np.lexsort((away, received.age_s[within]))[: self.messages]]

    def _kept_boxes(self, received: Received, kept: Ints) -> tuple[Floats, tuple[Ints, Ints]]:
        """Return the first boxes of each kept message, and their places: message, row."""
        slot = np.full(len(received.age_s), -1)
        slot[kept] = np.arange(len(kept))
        of_box = slot[received.of_box]
        known = (of_box >= 0) & (np.abs(received.rows[:, :3]) <= self.reach_m).all(axis=1)
        rows, of_box = received.rows[known], of_box[known]
        order = np.lexsort((self._rank(rows), of_box))
        rows, of_box = rows[order], of_box[order]
        place = np.arange(len(rows)) - np.searchsorted(of_box, of_box)
        fits = place < self.received
        rows, of_box, place = rows[fits], of_box[fits], place[fits]
        return np.column_stack([_columns(rows), rows[:, VELOCITY]]), (of_box, place)


def _bounded(shape: tuple[int, ...], limits: Floats) -> spaces.Box:
    high = np.broadcast_to(limits, (*shape, len(limits))).astype(np.float32)
    return spaces.Box(-high, high, dtype=np.float32)


def _clipped(rows: Floats, limits: Floats) -> NDArray[np.float32]:
    clipped: NDArray[np.float32] = np.clip(rows, -limits, limits).astype(np.float32)
    return clipped


def _own(observation: Observation) -> Floats:
    pose, moved = observation.pose, observation.odometry.xyz_yaw
    heading = pose.xyz_yaw[3]
    return np.array(
        [
            *pose.xyz_yaw[:3],
            np.cos(heading),
            np.sin(heading),
            *moved[[0, 1, 3]],
            *deviations(pose.covariance),
            float(observation.sensed),
        ]
    )


def _columns(rows: Floats) -> Floats:
    """Return boxes as rows of `DETECTION_COLUMNS`."""
    box, yaw = rows[:, BOX], rows[:, 6]
    classes = np.eye(len(CLASS_NAMES))[rows[:, LABEL].astype(np.int64)]
    return np.column_stack([box[:, :6], np.cos(yaw), np.sin(yaw), rows[:, SCORE], classes])


def _message_columns(received: Received, kept: Ints) -> Floats:
    pose = received.pose[kept]
    heading = np.column_stack([np.cos(pose[:, 3]), np.sin(pose[:, 3])])
    return np.column_stack([pose[:, :3], heading, received.age_s[kept], received.deviation[kept]])


def _spread(points: Floats, most: int) -> Floats:
    """Return at most so many of the points, evenly spaced among them."""
    return points if len(points) <= most else points[np.arange(most) * len(points) // most]
