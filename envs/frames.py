"""Where frames come from: the simulation, or a recording. The environment cannot tell which."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from coopsim.geometry.boxes import Boxes3D
from coopsim.geometry.se3 import Floats
from coopsim.sensors.visibility.lidar_visibility import Visibility
from coopsim.sensors.visibility.pixel_visibility import PixelVisibility
from coopsim.types import AgentSpec, CameraImage, GroundTruth, Ints, Observation
from coopsim.world.snapshot import Actors, AgentBody, RoadMap


@dataclass(frozen=True, slots=True, eq=False)
class AgentFrame:
    """One agent in one frame: what it perceives, and what is true around it.

    Attributes:
        observation: before communication (its inbox is empty).
        body: the agent's true place.
        truth: the objects that count in its score, in its base frame.
        ignored: M objects that do not count: a track on one of them neither helps nor harms.
        ignored_label: (M,) labels of `ignored`.
        instances: per sweep, the id of the actor behind each point; for training only.
        segmentation: per camera, the pictures of the modes that are truth; for training only.
    """

    observation: Observation
    body: AgentBody
    truth: GroundTruth
    ignored: Boxes3D = field(default_factory=Boxes3D.empty)
    ignored_label: Ints = field(default_factory=lambda: np.zeros(0, dtype=np.int64))
    instances: Mapping[str, Ints] = field(default_factory=dict)
    segmentation: Mapping[str, CameraImage] = field(default_factory=dict)


@dataclass(frozen=True, slots=True, eq=False)
class Frame:
    """All agents in one frame.

    Attributes:
        time_ns: since the episode's start.
        agents: by name, in the environment's order.
        actors: everything that is there, in the world frame (for pictures and `state()`).
        last: there is no frame after this one.
    """

    time_ns: int
    agents: Mapping[str, AgentFrame]
    actors: Actors
    last: bool = False


class FrameSource(ABC):
    """Produces the frames of an episode, one after another.

    Attributes:
        name: the environment id's name part.
        specs: of all agents that ever appear, in order, with the running episode's cameras.
        lidars: names of each agent's LiDARs.
        camera_modes: what the pictures of agents' cameras consist of.
        road_map: outlines for pictures.
        capacity: the largest number of actors in a frame.
        region_m: (2,) half the length and width of the evaluation region around an agent; None: unlimited.
        embedding_dim: length of the embeddings of detections; 0: they have none.
        detection_covariances: whether detections have covariances.
        covariances: whether some agent states the covariance of its pose.
    """

    name: str
    specs: Mapping[str, AgentSpec]
    lidars: tuple[str, ...]
    camera_modes: tuple[str, ...] = ()
    road_map: RoadMap
    capacity: int
    region_m: tuple[float, float] | None
    embedding_dim: int = 0
    detection_covariances: bool = False
    covariances: bool = False

    @abstractmethod
    def start(self, seed: int, options: Mapping[str, Any]) -> Frame:
        """Begin an episode; its first frame.

        Raises:
            UnknownNameError: an option is refused, and nothing has begun.
            RecordingError: the recording is broken, and nothing has begun.

        After any other error the source has no frame to go on from.
        """

    @abstractmethod
    def advance(self, maneuvers: Mapping[str, int]) -> Frame:
        """The next frame; `maneuvers` are the discrete meta-actions of the agents that drive."""

    @property
    def sequences(self) -> tuple[str, ...]:
        """Names of the sequences that `reset(options={"sequence": name})` plays; empty where there are none."""
        return ()

    @property
    def reset_options(self) -> tuple[str, ...]:
        """Names that `reset(options=...)` understands."""
        return ()

    def photograph(self) -> Mapping[str, Mapping[str, CameraImage]]:
        """The current frame through every agent's cameras, by agent and camera; empty without cameras."""
        return {}

    def visibility(self) -> Mapping[str, Visibility]:
        """How well each agent sees every actor in the current frame, by agent; empty without sensors."""
        return {}

    def pixel_visibility(self) -> Mapping[str, PixelVisibility]:
        """The same by cameras, for the agents that have any; empty where no picture is to tell actors apart."""
        return {}

    def close(self) -> None:
        """Release what the source holds."""


def actor_rows(actors: Actors, capacity: int) -> Floats:
    """(capacity, 11): id, label, x, y, z, l, w, h, yaw, vx, vy by actor in the world frame; zeros below."""
    rows = np.zeros((capacity, 11))
    rows[: len(actors)] = np.column_stack([actors.id, actors.label, actors.boxes.array, actors.velocity])
    return rows


def world_points(frame: Frame) -> Floats:
    """The points of all sweeps of a frame, (N, 3) m, moved to the world frame by the true poses."""
    parts = [
        agent.body.world_SE3_base.apply(sweep.points)
        for agent in frame.agents.values()
        for sweep in agent.observation.sweeps.values()
    ]
    return np.concatenate(parts) if parts else np.zeros((0, 3))
