"""Views of observations as arrays of fixed shapes, and the content of messages in the receiver's base frame."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, ClassVar

import gymnasium
import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from coopsim.comms.codecs.codec import decoder
from coopsim.comms.decode_once import DecodeOnce
from coopsim.comms.envelope import decode_detections, decode_points, decode_queries, decode_tracks
from coopsim.envs.parallel import CooperativeEnv
from coopsim.envs.wrappers.base_wrappers import AnySpace, ObservationForm, cooperative_env, kind_of
from coopsim.errors import CodecError, InvalidValueError
from coopsim.geometry.se3 import Floats, wrap_angle
from coopsim.localization.odometry import OdometryFrame
from coopsim.types import NS_PER_S, AgentSpec, Ints, Mask, Message, Observation, Tracks
from coopsim.types.driving import CarState
from coopsim.types.taxonomy import CLASS_NAMES
from coopsim.wire.observation_format import ObservationFormat
from coopsim.world.snapshot import RoadMap

Arrays = dict[str, NDArray[Any]]


@dataclass(eq=False)
class Scene:
    """Knowledge of one agent in one frame.

    Attributes:
        observation: observation of the agent.
        inbox: reader of its messages.
        agent: name of the agent.
        env: environment within the wrapper, which `car` and `tracks` are from.
    """

    observation: Observation
    inbox: Inbox
    agent: str
    env: Any = None

    @cached_property
    def received(self) -> Received:
        """Content of the messages that arrived, in the agent's base frame now."""
        return self.inbox.read(self.agent, self.observation)

    @property
    def car(self) -> CarState:
        """State of the agent's driven car."""
        return cooperative_env(self.env).cars[self.agent]

    @property
    def tracks(self) -> Tracks:
        """Tracks that the agent's tracker reports for this observation, in the agent's base frame."""
        tracks: Tracks = reporter(self.env).reported_tracks(self.agent)
        return tracks


class View(ABC):
    """A way to show a scene as named arrays, each of one shape for all agents and frames.

    Attributes:
        alone: name of the only array, which stands for itself where no other view is combined with this one; None if
            there may be several.
    """

    alone: ClassVar[str | None] = None

    @abstractmethod
    def spaces(self) -> dict[str, spaces.Box]:
        """Return new spaces of the arrays, by name: of each its shape, its dtype and the bounds of its numbers."""

    def require(self, env: Any) -> None:
        """Require an environment, that within the wrapper, whose scenes the view can show.

        Raises:
            InvalidValueError: it lacks something.
        """

    def action_space(self, inner: AnySpace) -> AnySpace:
        """Return the space of actions for what the view shows; see `ObservationForm.action_space`."""
        return inner

    def act(self, agent: str, action: Any) -> Any:
        """Return the environment's action; see `ObservationForm.act`."""
        return action

    def begin(self, road_map: RoadMap) -> None:
        """Take over the map of an episode that begins."""

    @abstractmethod
    def show(self, scene: Scene) -> Arrays:
        """Return new arrays, by name: those of `spaces`, each in its space.

        All that has a place is in the agent's base frame now (m, rad), or in pixels of a picture around it.
        """


def reporter(env: Any) -> Any:
    """Return the environment or wrapper whose `reported_tracks` tell an agent's tracks; None: its action has them."""
    tracked = env.unwrapped if isinstance(env, gymnasium.Env) else env
    return tracked if hasattr(tracked, "reported_tracks") else None


class Views(ObservationForm):
    """Views of the same observations.

    Args:
        views: the views; names of their arrays are distinct.

    Raises:
        InvalidValueError: two views have an array of the same name.
    """

    def __init__(self, views: Sequence[View]) -> None:
        names = [name for view in views for name in view.spaces()]
        twice = sorted({name for name in names if names.count(name) > 1})
        if twice:
            raise InvalidValueError(f"env has such a wrapper already: {', '.join(twice)} would be there twice")
        self.views = tuple(views)
        self._alone = views[0].alone if len(views) == 1 else None

    def space(self, inner: AnySpace) -> AnySpace:
        if not (isinstance(inner, spaces.Dict) and "inbox_payload" in inner.spaces):
            raise InvalidValueError(
                f"env must have coopsim's own observations, which no wrapper changed, got {kind_of(inner)}"
            )
        parts: dict[str, AnySpace] = {name: space for view in self.views for name, space in view.spaces().items()}
        return spaces.Dict(parts) if self._alone is None else parts[self._alone]

    def bind(self, env: Any) -> None:
        for view in self.views:
            view.require(env)
        self._env = env

    def action_space(self, inner: AnySpace) -> AnySpace:
        for view in self.views:
            inner = view.action_space(inner)
        return inner

    def act(self, agent: str, action: Any) -> Any:
        for view in reversed(self.views):
            action = view.act(agent, action)
        return action

    def begin(self, env: CooperativeEnv) -> None:
        specs = env.agent_specs
        self._format, self._inbox = ObservationFormat.to_unpack(specs), Inbox(specs)
        for view in self.views:
            view.begin(env.road_map)

    def observe(self, agent: str, observation: Mapping[str, Any]) -> Any:
        return self.observe_all({agent: observation})[agent]

    def observe_all(self, observations: Mapping[str, Any]) -> dict[str, Any]:
        unpacked = self._format.unpack_all(observations)
        return {
            name: self._show(Scene(observation, self._inbox, name, self._env)) for name, observation in unpacked.items()
        }

    def _show(self, scene: Scene) -> Any:
        self._inbox.follow(scene.agent, scene.observation)
        shown = {name: array for view in self.views for name, array in view.show(scene).items()}
        return shown if self._alone is None else shown[self._alone]


BOX, VELOCITY, SCORE, LABEL = slice(0, 7), slice(7, 9), 9, 10
"""Columns of a content's rows: x, y, z, l, w, h, yaw; vx, vy; score; label."""

_COLUMNS = 11

_MOST_BYTES = 16 * 2**20
"""Memory of decoded messages: little, as vectors have many environments, and enough for those of a frame."""


@dataclass(frozen=True, slots=True, eq=False)
class Received:
    """The M messages of one inbox, oldest capture first, with B boxes and P points; all in the receiver's base frame.

    A box is where its sender saw it at capture: it is moved by the two estimated poses, and not advanced in time.

    Attributes:
        pose: (M, 4) of each sender at capture: x, y, z m and heading rad.
        deviation: (M, 3) standard deviations that it states of its x, y (m) and heading (rad); zeros for none.
        age_s: (M,) time since capture.
        rows: (B, 11) see `BOX`, `VELOCITY`, `SCORE` and `LABEL`; velocities are zero where a message has none.
        of_box: (B,) index of the message that each box is from.
        points: (P, 3) m.
        of_point: (P,) index of the message that each point is from.
    """

    pose: Floats
    deviation: Floats
    age_s: Floats
    rows: Floats
    of_box: Ints
    points: Floats
    of_point: Ints


class Inbox:
    """Reads the messages of all agents of an episode. A broadcast is decoded once for all its receivers."""

    def __init__(self, specs: Mapping[str, AgentSpec]) -> None:
        self._specs = specs
        self._frames = {name: OdometryFrame() for name in specs}
        self._decoded = DecodeOnce(_MOST_BYTES)

    def follow(self, agent: str, observation: Observation) -> None:
        """Follow an agent's motion by one frame."""
        self._frames[agent].move(observation)

    def read(self, agent: str, observation: Observation) -> Received:
        """Return the content of an agent's inbox. The receiver itself, as others saw it, is left out.

        A message that cannot be read, or whose content is neither boxes nor points, has no boxes and no points.
        """
        inbox = observation.inbox
        contents = [self._content(message) for message in inbox]
        pose = _relative_poses(inbox, observation)
        rows, of_box = _joined([rows for rows, _ in contents], _COLUMNS)
        points, of_point = _joined([points for _, points in contents], 3)
        rows = _moved(rows, pose[of_box])
        if self._specs[agent].is_object:
            other = ~_over(rows, self._own_poses(agent, inbox)[of_box])
            rows, of_box = rows[other], of_box[other]
        age_s = np.array([observation.time_ns - message.captured_ns for message in inbox], dtype=float) / NS_PER_S
        deviation = np.array([deviations(message.pose.covariance) for message in inbox]).reshape(-1, 3)
        return Received(pose, deviation, age_s, rows, of_box, _moved(points, pose[of_point]), of_point)

    def _content(self, message: Message) -> tuple[Floats, Floats]:
        try:
            return self._decoded(message, _boxes_and_points)
        except CodecError:
            return np.zeros((0, _COLUMNS)), np.zeros((0, 3))

    def _own_poses(self, agent: str, inbox: Sequence[Message]) -> Floats:
        """Return where the agent itself was when each message was captured, (M, 2) m, in its base frame now."""
        frame = self._frames[agent]
        base_SE3_odom = frame.odom_SE3_base.inverse()
        times = {message.captured_ns for message in inbox}  # few, as senders capture together
        places = {time: base_SE3_odom.apply(frame.pose_at(time).translation)[:2] for time in times}
        return np.array([places[message.captured_ns] for message in inbox]).reshape(-1, 2)


def deviations(covariance: Floats | None) -> Floats:
    """Return standard deviations (3,) of x, y (m) and heading (rad); zeros where no covariance is stated."""
    return np.zeros(3) if covariance is None else np.sqrt(np.maximum(np.diagonal(covariance), 0.0))


def usable(rows: Floats) -> Mask:
    """Return the mask (N,) of rows whose numbers are finite, sizes positive and labels known."""
    label = rows[:, LABEL]
    good = np.isfinite(rows).all(axis=1) & (rows[:, 3:6] > 0).all(axis=1) & (label >= 0) & (label < len(CLASS_NAMES))
    return np.asarray(good)


def as_rows(found: Any, velocity: Floats | None = None) -> Floats:
    """Return detections, tracks or queries as the usable ones of their rows (N, 11)."""
    rows = all_rows(found, velocity)
    return rows[usable(rows)]


def all_rows(found: Any, velocity: Floats | None = None) -> Floats:
    """Return detections, tracks or queries as rows (N, 11)."""
    rows = np.zeros((len(found.boxes), _COLUMNS))
    rows[:, BOX], rows[:, SCORE], rows[:, LABEL] = found.boxes.array, found.score, found.label
    if velocity is not None:
        rows[:, VELOCITY] = velocity
    return rows


def _boxes_and_points(message: Message) -> tuple[Floats, Floats]:
    """Return a message's boxes (N, 11) and points (P, 3), in the sender's base frame at capture."""
    content = decoder(message.codec).content
    rows, points = np.zeros((0, _COLUMNS)), np.zeros((0, 3))
    if content == "detections":
        rows = as_rows(decode_detections(message))
    elif content == "tracks":
        tracks = decode_tracks(message).tracks
        rows = as_rows(tracks, tracks.velocity)
    elif content == "queries":
        rows = as_rows(decode_queries(message))
    elif content == "points":
        points = decode_points(message).xyz.astype(np.float64)
        points = points[np.isfinite(points).all(axis=1)]
    return rows, points


def _relative_poses(inbox: Sequence[Message], observation: Observation) -> Floats:
    """Return the senders' estimated poses at capture (M, 4) in the receiver's base frame, by its estimated pose now."""
    here = observation.pose.xyz_yaw
    pose = np.array([message.pose.xyz_yaw for message in inbox]).reshape(-1, 4) - here
    cos, sin = np.cos(here[3]), np.sin(here[3])
    x, y = pose[:, 0] * cos + pose[:, 1] * sin, pose[:, 1] * cos - pose[:, 0] * sin
    return np.column_stack([x, y, pose[:, 2], wrap_angle(pose[:, 3])])


def _joined(parts: Sequence[Floats], columns: int) -> tuple[Floats, Ints]:
    """Return all rows, and the index of the part that each is from."""
    joined = np.concatenate([np.zeros((0, columns)), *parts])
    return joined, np.repeat(np.arange(len(parts)), [len(part) for part in parts])


def _moved(rows: Floats, pose: Floats) -> Floats:
    """Move rows, points (N, 3) or boxes (N, 11), by a pose (N, 4) each."""
    cos, sin = np.cos(pose[:, 3]), np.sin(pose[:, 3])
    moved = rows.copy()
    moved[:, 0] = rows[:, 0] * cos - rows[:, 1] * sin + pose[:, 0]
    moved[:, 1] = rows[:, 0] * sin + rows[:, 1] * cos + pose[:, 1]
    moved[:, 2] += pose[:, 2]
    if rows.shape[1] > 3:
        moved[:, 6] = wrap_angle(rows[:, 6] + pose[:, 3])
        vx, vy = rows[:, VELOCITY].T
        moved[:, VELOCITY] = np.column_stack([vx * cos - vy * sin, vx * sin + vy * cos])
    return moved


def _over(rows: Floats, places: Floats) -> Mask:
    """Return the mask (N,) of boxes that cover a place (N, 2) on the ground."""
    cos, sin = np.cos(rows[:, 6]), np.sin(rows[:, 6])
    x, y = (rows[:, :2] - places).T
    covers = (np.abs(x * cos + y * sin) <= rows[:, 3] / 2) & (np.abs(y * cos - x * sin) <= rows[:, 4] / 2)
    return np.asarray(covers)
