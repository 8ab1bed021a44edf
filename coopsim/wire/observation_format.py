"""The format of observations: their gymnasium space, and typed structs to dicts of arrays and back.

Spaces use gymnasium's own `Dict`, `Box`, `Discrete` and `Sequence(stack=True)` only, so any PettingZoo tool
reads them. A stacked sequence of N items is a dict of arrays whose first axis is N.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from coopsim.comms.codecs.codec import CODECS
from coopsim.errors import InvalidValueError
from coopsim.geometry.boxes import Boxes3D
from coopsim.support.arrays import as_numbers
from coopsim.types import (
    AgentSpec,
    CameraImage,
    Detections,
    Message,
    Observation,
    Odometry,
    PoseEstimate,
    Sweep,
)
from coopsim.types.sensing import OBSERVED_MODES
from coopsim.types.taxonomy import CLASS_NAMES, require_classes
from coopsim.types.valid_detections import normalize_embeddings
from coopsim.wire.columns import COUNTER, box_space, real_space, rows_space
from coopsim.wire.inbox_format import InboxPacker, InboxReader, pack_covariances, stated_covariance


@dataclass(frozen=True, slots=True)
class ObservationFormat:
    """Format of all agents' observations in one environment.

    Attributes:
        agents: all agents, in the order in which an inbox numbers its senders. Codecs are numbered as in
            `CODECS.names()`.
        lidars: names of LiDARs, by agent.
        cameras: height and width of images, by agent and camera.
        camera_modes: the modes of images; modes that are truth are left out.
        embedding_dim: length of the embeddings of detections; 0: they have none.
        detection_covariances: detections have covariances.
        pose_covariances: some agent states the covariance of its pose.
        skips_frames: there are frames in which sensors and detector do not run.
        strangers: number of senders that are none of the agents, see `coopsim.types.messages.stranger`.
        signals: agents hear messages about traffic lights.
    """

    agents: tuple[str, ...]
    lidars: Mapping[str, Sequence[str]] = field(default_factory=dict)
    cameras: Mapping[str, Mapping[str, tuple[int, int]]] = field(default_factory=dict)
    camera_modes: Sequence[str] = OBSERVED_MODES
    embedding_dim: int = 0
    detection_covariances: bool = False
    pose_covariances: bool = False
    skips_frames: bool = False
    strangers: int = 0
    signals: bool = False

    @classmethod
    def to_unpack(cls, specs: Mapping[str, AgentSpec]) -> ObservationFormat:
        """Return a format for `unpack` alone, which needs no more than the specs of all agents."""
        return cls(tuple(specs))

    def space(self, agent: str) -> spaces.Dict:
        """Return a new space of this agent's observations; agents do not share one, as each is seeded by itself."""
        pose: dict[str, Any] = {"pose": real_space(4)}
        head: dict[str, Any] = {
            "sender": spaces.Discrete(len(self.agents) + self.strangers),
            "codec": spaces.Discrete(len(CODECS.names())),
            "captured_ns": spaces.Discrete(COUNTER),
            "pose": real_space(4),
        }
        if self.pose_covariances:
            pose["pose_covariance"] = real_space(3, 3)
            head["pose_covariance"] = real_space(3, 3)
        detection = {"box": box_space(), "score": real_space(1), "label": spaces.Discrete(len(CLASS_NAMES))}
        if self.embedding_dim:
            detection["embedding"] = real_space(self.embedding_dim, dtype=np.float32)
        if self.detection_covariances:
            detection["covariance"] = real_space(7, 7)
        sweeps: dict[str, Any] = {
            name: spaces.Sequence(real_space(5, dtype=np.float32), stack=True) for name in self.lidars.get(agent, ())
        }
        images: dict[str, Any] = {name: self._image_space(size) for name, size in self.cameras.get(agent, {}).items()}
        sensed: dict[str, Any] = {"sensed": spaces.Discrete(2)} if self.skips_frames else {}
        payload = spaces.Sequence(spaces.Box(0, 255, (1,), np.uint8), stack=True)
        signals: dict[str, Any] = {}
        if self.signals:
            signals = {"signals": rows_space(payload_bytes=spaces.Discrete(2**32)), "signals_payload": payload}
        return spaces.Dict(
            time_ns=spaces.Discrete(COUNTER),
            **pose,
            odometry=real_space(4),
            **sensed,
            detections=rows_space(**detection),
            sweeps=spaces.Dict(sweeps),
            cameras=spaces.Dict(images),
            inbox=rows_space(**head, payload_bytes=spaces.Discrete(2**32)),
            # The payloads of all messages of the inbox, end to end: bytes do not stack, their lengths differ.
            inbox_payload=payload,
            **signals,
        )

    def pack(self, observation: Observation) -> dict[str, Any]:
        """Return an observation as its space's dict of arrays; see `pack_all` for all observations of a frame.

        Raises:
            InvalidValueError: the detections' embeddings have another length than announced, or they have covariances
                and none were announced.
        """
        return self._pack(observation, self._inbox_packer(observation.inbox))

    def pack_all(self, observations: Mapping[str, Observation]) -> dict[str, dict[str, Any]]:
        """Return one frame's observations as `pack` does, by agent, with each message's numbers written once."""
        packer = self._inbox_packer([message for each in observations.values() for message in each.inbox])
        return {name: self._pack(observation, packer) for name, observation in observations.items()}

    def _inbox_packer(self, messages: Sequence[Message]) -> InboxPacker:
        return InboxPacker(self.agents, messages, covariances=self.pose_covariances)

    def _pack(self, observation: Observation, inboxes: InboxPacker) -> dict[str, Any]:
        packed: dict[str, Any] = {
            "time_ns": np.int64(observation.time_ns),
            "pose": observation.pose.xyz_yaw,
            "odometry": observation.odometry.xyz_yaw,
            "detections": self._pack_detections(observation.detections),
            "sweeps": {name: _pack_sweep(sweep) for name, sweep in observation.sweeps.items()},
            "cameras": {name: pack_image(image, OBSERVED_MODES) for name, image in observation.cameras.items()},
            **inboxes.pack(observation.inbox),
        }
        if self.pose_covariances:
            packed["pose_covariance"] = pack_covariances([observation.pose])[0]
        if self.skips_frames:
            packed["sensed"] = np.int64(observation.sensed)
        if self.signals:
            sizes = np.array([len(each) for each in observation.signals], dtype=np.int64)
            payload = np.frombuffer(b"".join(observation.signals), dtype=np.uint8)
            packed |= {"signals": {"payload_bytes": sizes}, "signals_payload": payload[:, None]}
        return packed

    def unpack(self, packed: Mapping[str, Any]) -> Observation:
        """Return the typed observation that `pack` was given; empty sweeps and cameras may be left out.

        See `unpack_all` for all observations of a frame.
        """
        return self._unpack(packed, InboxReader(self.agents))

    def unpack_all(self, packed: Mapping[str, Mapping[str, Any]]) -> dict[str, Observation]:
        """Return the typed observations, by agent; receivers of one broadcast share its `Message` object."""
        inboxes = InboxReader(self.agents)
        return {name: self._unpack(each, inboxes) for name, each in packed.items()}

    def _unpack(self, packed: Mapping[str, Any], inboxes: InboxReader) -> Observation:
        rows = packed["detections"]
        sensed = bool(packed.get("sensed", True))
        return Observation(
            time_ns=int(packed["time_ns"]),
            pose=PoseEstimate(packed["pose"], stated_covariance(packed.get("pose_covariance"))),
            odometry=Odometry(packed["odometry"]),
            detections=Detections(
                Boxes3D.from_array(rows["box"]),
                np.reshape(rows["score"], -1),
                rows["label"],
                stated_covariance(rows.get("covariance")),
                rows.get("embedding"),
            ),
            sweeps={name: _unpack_sweep(points) for name, points in packed.get("sweeps", {}).items()},
            cameras={name: CameraImage(**image) for name, image in packed.get("cameras", {}).items()} if sensed else {},
            inbox=inboxes.read(packed),
            sensed=sensed,
            signals=_unpack_signals(packed) if "signals" in packed else (),
        )

    def _image_space(self, size: tuple[int, int]) -> spaces.Dict:
        pixels = {
            "rgb": spaces.Box(0, 255, (*size, 3), np.uint8),
            "depth": real_space(*size, low=0.0, dtype=np.float32),
        }
        return spaces.Dict({mode: pixels[mode] for mode in OBSERVED_MODES if mode in self.camera_modes})

    def _pack_detections(self, detections: Detections) -> dict[str, Any]:
        """Pack embeddings at length 1, zeros where unknown, as for covariances: an observation is finite."""
        require_classes(detections.label, "detection")
        rows: dict[str, Any] = {
            "box": detections.boxes.array,
            "score": detections.score[:, None],
            "label": detections.label,
        }
        embedding, covariance = detections.embedding, detections.covariance
        if embedding is not None and embedding.shape[1] != self.embedding_dim:
            raise InvalidValueError(
                f"detections have embeddings of length {embedding.shape[1]}, announced were {self.embedding_dim}"
            )
        if self.embedding_dim:
            none = np.zeros((len(detections), self.embedding_dim))
            rows["embedding"], _ = normalize_embeddings(none if embedding is None else embedding)
        if covariance is not None and not self.detection_covariances:
            raise InvalidValueError(
                "detections have covariances, announced were none: Detector.states_covariance says so"
            )
        if self.detection_covariances:
            rows["covariance"] = np.zeros((len(detections), 7, 7)) if covariance is None else covariance
        return rows


def pack_image(image: CameraImage, modes: Sequence[str]) -> dict[str, Any]:
    """Return an image's pixels in those of `modes` that it has, by mode."""
    return {mode: getattr(image, mode) for mode in modes if getattr(image, mode) is not None}


def _unpack_signals(packed: Mapping[str, Any]) -> tuple[bytes, ...]:
    payload = np.asarray(packed["signals_payload"], dtype=np.uint8).tobytes()
    ends = np.cumsum(as_numbers(packed["signals"]["payload_bytes"], np.int64, "signals payload_bytes")).tolist()
    return tuple(payload[start:end] for start, end in zip([0, *ends], ends, strict=False))


def _pack_sweep(sweep: Sweep) -> NDArray[np.float32]:
    rows = np.empty((len(sweep), 5), np.float32)
    rows[:, :3], rows[:, 3], rows[:, 4] = sweep.points, sweep.intensity, sweep.beam
    return rows


def _unpack_sweep(points: NDArray[np.float32]) -> Sweep:
    return Sweep(points[:, :3], points[:, 3], points[:, 4].astype(np.int64))
