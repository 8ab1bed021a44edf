"""What flows between the parts: frozen structs of arrays.

Box order is x, y, z, l, w, h, yaw everywhere. Times are integer nanoseconds since the episode's start.
Shapes are checked when an object is made; values (finite, positive) where they enter from outside.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from coopsim.arrays import Shape, frozen, require_finite, require_identified
from coopsim.errors import InvalidValueError
from coopsim.geometry.boxes import Boxes3D
from coopsim.geometry.se3 import SE3, Floats

Ints = NDArray[np.int64]
Mask = NDArray[np.bool_]

NS_PER_S = 1_000_000_000


def seconds_to_ns(seconds: float) -> int:
    """Seconds as integer nanoseconds, rounded to the nearest."""
    return round(seconds * NS_PER_S)


@dataclass(frozen=True, slots=True, eq=False)
class Detections:
    """N detected objects in one frame of reference.

    Attributes:
        boxes: N boxes.
        score: (N,) confidence; larger is surer. Simulated scores lie in [0, 1], recorded ones need not.
        label: (N,) int, an `ObjectClass`.
        covariance: (N, 7, 7) of x, y, z, l, w, h, yaw, or None where the detector states none.
        embedding: (N, D) appearance, or None. A row that is not finite, or all zeros, is none.
        seen_by: (N, A) which of A agents saw each, where several agents' detections were put together, or None.
    """

    boxes: Boxes3D
    score: Floats
    label: Ints
    covariance: Floats | None = None
    embedding: Floats | None = None
    seen_by: Mask | None = None

    def __post_init__(self) -> None:
        count = len(self.boxes)
        object.__setattr__(self, "score", frozen(self.score, (count,), np.float64, "score"))
        object.__setattr__(self, "label", frozen(self.label, (count,), np.int64, "label"))
        if self.covariance is not None:
            covariance = frozen(self.covariance, (count, 7, 7), np.float64, "covariance")
            object.__setattr__(self, "covariance", covariance)
        if self.embedding is not None:
            embedding = frozen(self.embedding, (count, None), np.float64, "embedding")
            object.__setattr__(self, "embedding", embedding)
        if self.seen_by is not None:
            object.__setattr__(self, "seen_by", frozen(self.seen_by, (count, None), np.bool_, "seen_by"))

    @classmethod
    def empty(cls) -> Detections:
        """No detections."""
        return cls(Boxes3D.empty(), np.zeros(0), np.zeros(0, dtype=np.int64))

    @classmethod
    def concatenate(cls, parts: Iterable[Detections]) -> Detections:
        """All detections in order.

        Covariances stay only where every non-empty part has them. Embeddings stay if any part has them, with NaN for
        the detections of parts that have none, or of another width than the first, which nothing can be compared with.
        Who saw what is not kept: the parts need not count the same agents.
        """
        full = [part for part in parts if len(part)]
        if not full:
            return cls.empty()
        if len(full) == 1:
            return replace(full[0], seen_by=None)
        covariances = [part.covariance for part in full if part.covariance is not None]
        return cls(
            Boxes3D.concatenate(part.boxes for part in full),
            np.concatenate([part.score for part in full]),
            np.concatenate([part.label for part in full]),
            np.concatenate(covariances) if len(covariances) == len(full) else None,
            _joined_embeddings(full),
        )

    def __len__(self) -> int:
        return len(self.boxes)

    def __getitem__(self, index: slice | NDArray[Any]) -> Detections:
        return Detections(
            self.boxes[index],
            self.score[index],
            self.label[index],
            None if self.covariance is None else self.covariance[index],
            None if self.embedding is None else self.embedding[index],
            None if self.seen_by is None else self.seen_by[index],
        )

    def transform(self, dst_SE3_src: SE3) -> Detections:
        """The detections moved from src to dst (gravity-aligned)."""
        covariance = self.covariance
        if covariance is not None:
            jacobian = np.eye(7)
            jacobian[:3, :3] = dst_SE3_src.rotation
            covariance = jacobian @ covariance @ jacobian.T
        boxes = self.boxes.transform(dst_SE3_src)
        return replace(self, boxes=boxes, covariance=covariance)


def _joined_embeddings(parts: Sequence[Detections]) -> Floats | None:
    """(N, D) of all parts, as `Detections.concatenate` says; None if no part has any."""
    width = next((part.embedding.shape[1] for part in parts if part.embedding is not None), None)
    if width is None:
        return None
    return np.concatenate(
        [
            part.embedding
            if part.embedding is not None and part.embedding.shape[1] == width
            else np.full((len(part), width), np.nan)
            for part in parts
        ]
    )


@dataclass(frozen=True, slots=True, eq=False)
class Tracks:
    """N tracked objects in one frame of reference.

    Attributes:
        id: (N,) int, unique within a frame and constant over an object's life.
        boxes: N boxes.
        velocity: (N, 2) m/s over ground, in the axes of the frame.
        score: (N,) confidence.
        label: (N,) int, an `ObjectClass`.
    """

    id: Ints
    boxes: Boxes3D
    velocity: Floats
    score: Floats
    label: Ints

    def __post_init__(self) -> None:
        count = len(self.boxes)
        object.__setattr__(self, "id", frozen(self.id, (count,), np.int64, "id"))
        object.__setattr__(self, "velocity", frozen(self.velocity, (count, 2), np.float64, "velocity"))
        object.__setattr__(self, "score", frozen(self.score, (count,), np.float64, "score"))
        object.__setattr__(self, "label", frozen(self.label, (count,), np.int64, "label"))

    @classmethod
    def empty(cls) -> Tracks:
        """No tracks."""
        none = np.zeros(0, dtype=np.int64)
        return cls(none, Boxes3D.empty(), np.zeros((0, 2)), np.zeros(0), none)

    def __len__(self) -> int:
        return len(self.boxes)

    def __getitem__(self, index: slice | NDArray[Any]) -> Tracks:
        return Tracks(self.id[index], self.boxes[index], self.velocity[index], self.score[index], self.label[index])

    def transform(self, dst_SE3_src: SE3) -> Tracks:
        """The tracks moved from src to dst (gravity-aligned)."""
        velocity = dst_SE3_src.rotate_planar(self.velocity)
        return Tracks(self.id, self.boxes.transform(dst_SE3_src), velocity, self.score, self.label)

    def validate(self) -> None:
        """Raise `InvalidValueError` on what cannot be scored: not finite, no size, twice the same id."""
        if not len(self):
            return
        self.boxes.validate("tracks")
        require_finite(self.velocity, "track velocity")
        require_finite(self.score, "track score")
        require_identified(self.id, self.label, "track")


@dataclass(frozen=True, slots=True, eq=False)
class Sweep:
    """One turn of one LiDAR, as points in the agent's base frame.

    Attributes:
        points: (N, 3) m, float32.
        intensity: (N,) in [0, 1], float32.
        beam: (N,) row of the beam table, int64.
        instance: (N,) id of the actor that was hit, 0 for the static scene and -1 for clutter; None in
            what a policy sees. For training and tests.
    """

    points: NDArray[np.float32]
    intensity: NDArray[np.float32]
    beam: Ints
    instance: Ints | None = None

    def __post_init__(self) -> None:
        points = frozen(self.points, (None, 3), np.float32, "points")
        object.__setattr__(self, "points", points)
        count = len(points)
        object.__setattr__(self, "intensity", frozen(self.intensity, (count,), np.float32, "intensity"))
        object.__setattr__(self, "beam", frozen(self.beam, (count,), np.int64, "beam"))
        if self.instance is not None:
            instance = frozen(self.instance, (count,), np.int64, "instance")
            object.__setattr__(self, "instance", instance)

    def __len__(self) -> int:
        return len(self.points)


@dataclass(frozen=True, slots=True, eq=False)
class CameraImage:
    """What one camera saw, in the modes that were asked for; None in the others.

    Attributes:
        rgb: (H, W, 3) uint8.
        depth: (H, W) float32, m along the optical axis; 0 where nothing was hit.
        instance: (H, W) int64, the actor's id; 0 where there is none. Truth: not in observations.
        semantic: (H, W) uint8, the actor's `ObjectClass`; 255 where there is none. Truth: not in observations.
    """

    rgb: NDArray[np.uint8] | None = None
    depth: NDArray[np.float32] | None = None
    instance: Ints | None = None
    semantic: NDArray[np.uint8] | None = None

    def __post_init__(self) -> None:
        tails: dict[str, tuple[int, ...]] = {"rgb": (3,), "depth": (), "instance": (), "semantic": ()}
        dtypes = {"rgb": np.uint8, "depth": np.float32, "instance": np.int64, "semantic": np.uint8}
        size: Shape = (None, None)
        for name, tail in tails.items():
            pixels = getattr(self, name)
            if pixels is not None:
                pixels = frozen(pixels, (*size, *tail), dtypes[name], name)
                object.__setattr__(self, name, pixels)
                size = pixels.shape[:2]


@dataclass(frozen=True, slots=True, eq=False)
class CameraCalibration:
    """What is known of a camera on an agent.

    Pixel (column u, row v) is centred on the point (u, v). Camera axes are OpenCV's: x right, y down, z forward.

    Attributes:
        size: height and width of its pictures, pixels.
        matrix: (3, 3), OpenCV's K.
        distortion: (5,) k1, k2, p1, p2, k3 (Brown-Conrady, OpenCV's order); zeros for a pinhole.
        base_SE3_camera: where it is in the agent's base frame.
    """

    size: tuple[int, int]
    matrix: Floats
    distortion: Floats
    base_SE3_camera: SE3

    def __post_init__(self) -> None:
        object.__setattr__(self, "matrix", frozen(self.matrix, (3, 3), np.float64, "matrix"))
        object.__setattr__(self, "distortion", frozen(self.distortion, (5,), np.float64, "distortion"))


@dataclass(frozen=True, slots=True, eq=False)
class PoseEstimate:
    """Where an agent believes it is: `world_SE3_base`, gravity-aligned, GNSS-like (noisy, no drift).

    Attributes:
        xyz_yaw: (4,): x, y, z m and heading rad, in the world frame.
        covariance: (3, 3) of x, y and heading as the agent states it, which need not be right; None: it states none.
    """

    xyz_yaw: Floats
    covariance: Floats | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "xyz_yaw", frozen(self.xyz_yaw, (4,), np.float64, "xyz_yaw"))
        if self.covariance is not None:
            covariance = frozen(self.covariance, (3, 3), np.float64, "covariance")
            object.__setattr__(self, "covariance", covariance)

    @property
    def world_SE3_base(self) -> SE3:
        """The estimate as a transform."""
        return SE3.from_xyz_yaw(self.xyz_yaw[:3], float(self.xyz_yaw[3]))


@dataclass(frozen=True, slots=True, eq=False)
class Odometry:
    """How an agent believes it moved since its last frame: `previous_SE3_current` (small drift).

    Attributes:
        xyz_yaw: (4,): x, y, z m and heading rad, in the base frame of the last observation.
    """

    xyz_yaw: Floats

    def __post_init__(self) -> None:
        object.__setattr__(self, "xyz_yaw", frozen(self.xyz_yaw, (4,), np.float64, "xyz_yaw"))

    @property
    def previous_SE3_current(self) -> SE3:
        """The motion as a transform."""
        return SE3.from_xyz_yaw(self.xyz_yaw[:3], float(self.xyz_yaw[3]))


@dataclass(frozen=True, slots=True, eq=False)
class Message:
    """What one agent broadcast.

    Attributes:
        sender: the agent's name, which is not empty.
        captured_ns: when the content was sensed (not when it was sent or arrived).
        pose: the sender's estimate of its own pose at that time.
        payload: the encoded content.
        codec: the name of the codec that encoded it.
    """

    sender: str
    captured_ns: int
    pose: PoseEstimate
    payload: bytes
    codec: str

    def __post_init__(self) -> None:
        if not self.sender:
            raise InvalidValueError("sender must be an agent's name, got ''")


@dataclass(frozen=True, slots=True, eq=False)
class Observation:
    """What one agent knows in one frame; everything but the inbox is in its own base frame, now.

    Attributes:
        time_ns: now.
        pose: the global pose estimate.
        odometry: motion since the last observation.
        detections: the agent's own detections.
        sweeps: by sensor name.
        cameras: by sensor name; empty when cameras are off.
        inbox: messages that arrived since the last observation, oldest capture first.
    """

    time_ns: int
    pose: PoseEstimate
    odometry: Odometry
    detections: Detections
    sweeps: Mapping[str, Sweep] = field(default_factory=dict)
    cameras: Mapping[str, CameraImage] = field(default_factory=dict)
    inbox: tuple[Message, ...] = ()


@dataclass(frozen=True, slots=True)
class AgentSpec:
    """What a policy may know of an agent before the first frame.

    Attributes:
        name: as `cav_0`, `rsu_0` or `drone_0`.
        kind: "cav" (drives), "rsu" (stands) or "drone" (flies; its base frame is on the ground under it).
        dt_s: time between two observations.
        uplink: what the environment lets agents broadcast ("none", "detections", "tracks").
        drives: the action must say how to drive (`control="policy"`, connected cars only).
        is_object: others see it over the origin of its base frame, but it is not its own object. Not so for a mast, nor
            for a recording, which does not say where its agents are.
        frame_owner: whose base frame all agents' boxes are in, where that is one agent's, as in a recording; None: each
            agent's are in its own.
        cameras: of each of its cameras, by name; of the running episode, as cars are of different heights.
        codec: by which codec agents encode what they broadcast; None: by the one with the uplink's name.
    """

    name: str
    kind: Literal["cav", "rsu", "drone"]
    dt_s: float
    uplink: str
    drives: bool = False
    is_object: bool = True
    frame_owner: str | None = None
    cameras: Mapping[str, CameraCalibration] = field(default_factory=dict, compare=False)
    codec: str | None = None


def stack_xyz_yaw(pose: SE3) -> Floats:
    """A gravity-aligned transform as (4,): x, y, z m and heading rad."""
    row = np.empty(4)
    row[:3], row[3] = pose.translation, pose.yaw
    return row
