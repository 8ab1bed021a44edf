"""Observation and action spaces, and the one place where typed structs become dicts of arrays and back.

Spaces use gymnasium's own `Dict`, `Box`, `Discrete` and `Sequence(stack=True)` only, so any PettingZoo tool
reads them. A stacked sequence of N items is a dict of arrays whose first axis is N.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from gymnasium import spaces

from coopsim.errors import CoopsimError, InvalidActionError, InvalidValueError
from coopsim.geometry.boxes import Boxes3D
from coopsim.support.arrays import as_numbers
from coopsim.types import (
    AgentSpec,
    CameraCalibration,
    CameraImage,
    Detections,
    Message,
    Observation,
    Odometry,
    PoseEstimate,
    Sweep,
    Tracks,
)
from coopsim.types.embedding import directions
from coopsim.types.maneuvers import IDLE, MANEUVERS
from coopsim.types.sensing import OBSERVED_MODES
from coopsim.types.taxonomy import CLASS_NAMES, require_classes

_COUNTER = 2**62  # what fits an int64 and leaves room to add: nanoseconds, ids

_TRACK_COLUMNS = {"id": np.int64, "box": np.float64, "velocity": np.float64, "score": np.float64, "label": np.int64}


def _reals(*shape: int, low: float = -np.inf, dtype: Any = np.float64) -> spaces.Box:
    return spaces.Box(low, np.inf, shape, dtype)


def _rows(**columns: spaces.Space[Any]) -> spaces.Sequence:
    return spaces.Sequence(spaces.Dict(columns), stack=True)


def _box() -> spaces.Box:
    """x, y, z, l, w, h, yaw; sizes are positive. Never the same space twice: one that is shared is seeded as one."""
    return spaces.Box(np.array([-np.inf] * 3 + [0.0] * 3 + [-np.inf]), np.full(7, np.inf), dtype=np.float64)


def observation_space(
    agents: Sequence[str],
    sensors: Sequence[str],
    cameras: Mapping[str, CameraCalibration],
    camera_modes: Sequence[str] = OBSERVED_MODES,
    embedding_dim: int = 0,
    *,
    covariances: bool = False,
    detection_covariances: bool = False,
) -> spaces.Dict:
    """The space of one agent's observations.

    Args:
        agents: all agents, in the order in which an inbox numbers its senders.
        sensors: names of the agent's LiDARs.
        cameras: the agent's cameras.
        camera_modes: what their pictures consist of; what is truth is left out.
        embedding_dim: length of the embeddings of detections; 0: they have none.
        covariances: whether some agent states the covariance of its pose.
        detection_covariances: whether detections have covariances.
    """
    stated: dict[str, Any] = {"pose_covariance": _reals(3, 3)} if covariances else {}
    heard: dict[str, Any] = {"pose_covariance": _reals(3, 3)} if covariances else {}
    found = {"box": _box(), "score": _reals(1), "label": spaces.Discrete(len(CLASS_NAMES))}
    if embedding_dim:
        found["embedding"] = _reals(embedding_dim, dtype=np.float32)
    if detection_covariances:
        found["covariance"] = _reals(7, 7)
    image: dict[str, spaces.Space[Any]] = {
        name: _image(calibration.size, camera_modes) for name, calibration in cameras.items()
    }
    return spaces.Dict(
        time_ns=spaces.Discrete(_COUNTER),
        pose=_reals(4),
        **stated,
        odometry=_reals(4),
        detections=_rows(**found),
        sweeps=spaces.Dict({name: spaces.Sequence(_reals(5, dtype=np.float32), stack=True) for name in sensors}),
        cameras=spaces.Dict(image),
        inbox=_rows(
            sender=spaces.Discrete(len(agents)),
            captured_ns=spaces.Discrete(_COUNTER),
            pose=_reals(4),
            **heard,
            payload_bytes=spaces.Discrete(2**32),
        ),
        # The payloads of all messages of the inbox, end to end: bytes do not stack, their lengths differ.
        inbox_payload=spaces.Sequence(spaces.Box(0, 255, (1,), np.uint8), stack=True),
    )


def _image(size: tuple[int, int], modes: Sequence[str]) -> spaces.Dict:
    pixels = {
        "rgb": spaces.Box(0, 255, (*size, 3), np.uint8),
        "depth": _reals(*size, low=0.0, dtype=np.float32),
    }
    return spaces.Dict({mode: pixels[mode] for mode in OBSERVED_MODES if mode in modes})


def action_space(*, drives: bool) -> spaces.Dict:
    """The space of one agent's actions: the tracks it reports and, if it drives, a maneuver."""
    tracks = _rows(
        id=spaces.Discrete(_COUNTER),
        box=_box(),
        velocity=_reals(2),
        score=_reals(1),
        label=spaces.Discrete(len(CLASS_NAMES)),
    )
    parts: dict[str, spaces.Space[Any]] = {"tracks": tracks}
    if drives:
        parts["maneuver"] = spaces.Discrete(len(MANEUVERS))
    return spaces.Dict(parts)


def pack_observation(
    observation: Observation,
    agents: Sequence[str],
    embedding_dim: int = 0,
    *,
    covariances: bool = False,
    detection_covariances: bool = False,
) -> dict[str, Any]:
    """An observation as its space's dict of arrays; `agents` numbers the senders.

    Raises:
        InvalidValueError: the detections' embeddings are not of the length that was announced, or they have
            covariances and none were announced.
    """
    inbox = observation.inbox
    payload = b"".join(message.payload for message in inbox)
    packed: dict[str, Any] = {
        "time_ns": np.int64(observation.time_ns),
        "pose": observation.pose.xyz_yaw,
        "odometry": observation.odometry.xyz_yaw,
        "detections": _pack_detections(observation.detections, embedding_dim, covariances=detection_covariances),
        "sweeps": {name: _pack_sweep(sweep) for name, sweep in observation.sweeps.items()},
        "cameras": {name: pack_image(image, OBSERVED_MODES) for name, image in observation.cameras.items()},
        "inbox": {
            "sender": np.array([agents.index(message.sender) for message in inbox], dtype=np.int64),
            "captured_ns": np.array([message.captured_ns for message in inbox], dtype=np.int64),
            "pose": np.array([message.pose.xyz_yaw for message in inbox]).reshape(-1, 4),
            "payload_bytes": np.array([len(message.payload) for message in inbox], dtype=np.int64),
        },
        "inbox_payload": np.frombuffer(payload, dtype=np.uint8)[:, None],
    }
    if covariances:
        packed["pose_covariance"] = _pack_covariances([observation.pose])[0]
        packed["inbox"]["pose_covariance"] = _pack_covariances([message.pose for message in inbox])
    return packed


def pack_image(image: CameraImage, modes: Sequence[str]) -> dict[str, Any]:
    """What a picture has of these modes."""
    return {mode: getattr(image, mode) for mode in modes if getattr(image, mode) is not None}


def unpack_observation(packed: Mapping[str, Any], agents: Sequence[str], spec: AgentSpec) -> Observation:
    """The typed view of what `pack_observation` made."""
    found = packed["detections"]
    boxes = Boxes3D.from_array(found["box"])
    return Observation(
        time_ns=int(packed["time_ns"]),
        pose=_unpack_pose(packed["pose"], packed.get("pose_covariance")),
        odometry=Odometry(packed["odometry"]),
        detections=Detections(
            boxes,
            np.reshape(found["score"], -1),
            found["label"],
            _stated(found.get("covariance")),
            found.get("embedding"),
        ),
        sweeps={name: _unpack_sweep(points) for name, points in packed["sweeps"].items()},
        cameras={name: CameraImage(**image) for name, image in packed["cameras"].items()},
        inbox=_unpack_inbox(packed, agents, spec.codec or spec.uplink),
    )


def pack_tracks(tracks: Tracks) -> dict[str, Any]:
    """Tracks as they stand in an action."""
    return {
        "id": tracks.id,
        "box": tracks.boxes.array,
        "velocity": tracks.velocity,
        "score": tracks.score[:, None],
        "label": tracks.label,
    }


def unpack_action(agent: str, action: object, *, drives: bool) -> tuple[Tracks, int]:
    """The tracks and the maneuver in one agent's action, checked and copied.

    Raises:
        InvalidActionError: names the agent, what is wrong, and what is accepted.
    """
    wanted = {"tracks", "maneuver"} if drives else {"tracks"}
    if not isinstance(action, Mapping) or set(action) != wanted:
        got = sorted(map(str, action)) if isinstance(action, Mapping) else repr(action)
        raise InvalidActionError(f"{agent}: an action is a dict with {sorted(wanted)}, got {got}")
    try:
        tracks = _unpack_tracks(action["tracks"])
        tracks.validate()
    except CoopsimError as error:
        raise InvalidActionError(f"{agent}: {error}") from error
    maneuver = action["maneuver"] if drives else IDLE
    whole = isinstance(maneuver, (int, np.integer)) and not isinstance(maneuver, bool)
    if not (whole and 0 <= maneuver < len(MANEUVERS)):
        names = ", ".join(f"{number} {name}" for number, name in enumerate(MANEUVERS))
        raise InvalidActionError(f"{agent}: maneuver must be one of {names}; got {maneuver!r}")
    return tracks, int(maneuver)


def _unpack_tracks(packed: object) -> Tracks:
    if not isinstance(packed, Mapping) or set(packed) != set(_TRACK_COLUMNS):
        got = sorted(map(str, packed)) if isinstance(packed, Mapping) else repr(packed)
        raise InvalidActionError(f"tracks are a dict with {list(_TRACK_COLUMNS)}, got {got}")
    # Copies: what the caller does to its arrays afterwards does not change what it reported.
    track_id, box, velocity, score, label = (
        as_numbers(packed[name], dtype, f"track {name}").copy() for name, dtype in _TRACK_COLUMNS.items()
    )
    if track_id.size and not 0 <= track_id.min() <= track_id.max() < _COUNTER:
        raise InvalidActionError(f"track id must be in 0..{_COUNTER - 1}, got {track_id.min()}..{track_id.max()}")
    score = score[:, 0] if score.ndim == 2 and score.shape[1] == 1 else score
    return Tracks(track_id, Boxes3D.from_array(box), velocity, score, label)


def _pack_detections(found: Detections, embedding_dim: int, *, covariances: bool) -> dict[str, Any]:
    """Embeddings at length 1, zeros for none, as for covariances: an observation is finite."""
    require_classes(found.label, "detection")
    rows: dict[str, Any] = {"box": found.boxes.array, "score": found.score[:, None], "label": found.label}
    if found.embedding is not None and found.embedding.shape[1] != embedding_dim:
        width = found.embedding.shape[1]
        raise InvalidValueError(f"detections have embeddings of length {width}, announced were {embedding_dim}")
    if embedding_dim:
        none = np.zeros((len(found), embedding_dim))
        rows["embedding"], _ = directions(none if found.embedding is None else found.embedding)
    if found.covariance is not None and not covariances:
        raise InvalidValueError("detections have covariances, announced were none: Detector.states_covariance says so")
    if covariances:
        rows["covariance"] = np.zeros((len(found), 7, 7)) if found.covariance is None else found.covariance
    return rows


def _pack_sweep(sweep: Sweep) -> np.ndarray[Any, np.dtype[np.float32]]:
    rows = np.empty((len(sweep), 5), np.float32)
    rows[:, :3], rows[:, 3], rows[:, 4] = sweep.points, sweep.intensity, sweep.beam
    return rows


def _unpack_sweep(points: np.ndarray[Any, np.dtype[np.float32]]) -> Sweep:
    return Sweep(points[:, :3], points[:, 3], points[:, 4].astype(np.int64))


def _unpack_inbox(packed: Mapping[str, Any], agents: Sequence[str], codec: str) -> tuple[Message, ...]:
    heads, heap = packed["inbox"], np.asarray(packed["inbox_payload"], dtype=np.uint8).tobytes()
    covariances = heads.get("pose_covariance", np.zeros((len(heads["sender"]), 3, 3)))
    ends = np.cumsum(heads["payload_bytes"])
    starts = ends - heads["payload_bytes"]
    return tuple(
        Message(agents[sender], int(captured_ns), _unpack_pose(pose, stated), heap[start:end], codec)
        for sender, captured_ns, pose, stated, start, end in zip(
            heads["sender"], heads["captured_ns"], heads["pose"], covariances, starts, ends, strict=True
        )
    )


def _pack_covariances(poses: Sequence[PoseEstimate]) -> np.ndarray[Any, np.dtype[np.float64]]:
    """(N, 3, 3), zeros where a pose states none."""
    stated = [np.zeros((3, 3)) if pose.covariance is None else pose.covariance for pose in poses]
    return np.array(stated).reshape(-1, 3, 3)


def _unpack_pose(xyz_yaw: Any, covariance: Any) -> PoseEstimate:
    return PoseEstimate(xyz_yaw, _stated(covariance))


def _stated(covariance: Any) -> Any:
    """None for the zeros that stand for it."""
    return None if covariance is None or not np.any(covariance) else covariance
