"""Sources of frames: the simulation, or a recording, with one interface to the environment."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from coopsim.geometry.se3 import Floats
from coopsim.sensors.visibility.lidar_visibility import Visibility
from coopsim.sensors.visibility.pixel_visibility import PixelVisibility
from coopsim.types import AgentSpec, CameraImage, GroundTruth, Ints, Observation
from coopsim.wire.observation_format import ObservationFormat
from coopsim.world.snapshot import Actors, AgentBody, RoadMap


@dataclass(frozen=True, slots=True, eq=False)
class AgentFrame:
    """One agent in one frame: its perception, and the truth around it.

    Attributes:
        observation: before communication (its inbox is empty).
        body: the agent's true pose and shape.
        truth: all objects but the agent itself, in its base frame; `truth.counts` are those of its score.
        instances: per sweep, the id of the actor behind each point; for training only.
        segmentation: per camera, the image in the modes that are truth; for training only.
    """

    observation: Observation
    body: AgentBody
    truth: GroundTruth
    instances: Mapping[str, Ints] = field(default_factory=dict)
    segmentation: Mapping[str, CameraImage] = field(default_factory=dict)


class FrameProbe:
    """Measurements of one frame that cost time, so they are made when asked for. This one has none."""

    def photograph(self) -> Mapping[str, Mapping[str, CameraImage]]:
        """Return images by every agent's cameras, by agent and camera; empty where nothing can be photographed."""
        return {}

    def visibility(self) -> Mapping[str, Visibility]:
        """Return how well each agent's LiDARs see every actor, by agent; empty without LiDARs."""
        return {}

    def pixel_visibility(self) -> Mapping[str, PixelVisibility]:
        """Return how well cameras see every actor, by agent with cameras; empty if images do not distinguish them."""
        return {}


@dataclass(frozen=True, slots=True, eq=False)
class Frame:
    """All agents in one frame.

    Attributes:
        time_ns: since the episode's start.
        agents: by name, in the environment's order.
        actors: everything that is there, in the world frame (for pictures and `state()`).
        last: there is no frame after this one.
        probe: measurements that are made when asked for.
    """

    time_ns: int
    agents: Mapping[str, AgentFrame]
    actors: Actors
    last: bool = False
    probe: FrameProbe = field(default_factory=FrameProbe)


class FrameSource(ABC):
    """The frames of an episode, one after another.

    Attributes:
        name: the environment's id.
        specs: of all agents that ever appear, in order, with the running episode's cameras and LiDARs.
        format: of the agents' observations.
        road_map: outlines of the running episode's place, for pictures.
        capacity: the largest number of actors in a frame of any episode.
        region_m: (2,) half the length and width of the evaluation region around an agent; None: unlimited.
    """

    name: str
    specs: Mapping[str, AgentSpec]
    format: ObservationFormat
    road_map: RoadMap
    capacity: int
    region_m: tuple[float, float] | None

    @abstractmethod
    def start(self, seed: int, options: Mapping[str, Any]) -> Frame:
        """Begin an episode and return its first frame.

        Raises:
            UnknownNameError: an option is refused, and nothing has begun.
            RecordingError: the recording is broken, and nothing has begun.

        After any other error the source has no frame to go on from.
        """

    @abstractmethod
    def advance(self, maneuvers: Mapping[str, int]) -> Frame:
        """Return the next frame; `maneuvers` are the discrete meta-actions of the agents that drive."""

    @property
    def sequences(self) -> tuple[str, ...]:
        """Names of the sequences that `reset(options={"sequence": name})` plays; empty where there are none."""
        return ()

    @property
    def episode_infos(self) -> Mapping[str, Any]:
        """What `reset` says of the running episode, besides its seed, in every agent's infos."""
        return {}

    @property
    def reset_options(self) -> tuple[str, ...]:
        """Names that `reset(options=...)` understands."""
        return ()

    def close(self) -> None:
        """Release the source's resources."""


def actor_rows(actors: Actors, capacity: int) -> Floats:
    """Return actors as rows (capacity, 11): id, label, x, y, z, l, w, h, yaw, vx, vy in the world frame; then zeros."""
    rows = np.zeros((capacity, 11))
    rows[: len(actors)] = np.column_stack([actors.id, actors.label, actors.boxes.array, actors.velocity])
    return rows


def world_points(frame: Frame) -> Floats:
    """Return the points of all sweeps of a frame, (N, 3) m, moved to the world frame by the true poses."""
    parts = [
        agent.body.world_SE3_base.apply(sweep.points)
        for agent in frame.agents.values()
        for sweep in agent.observation.sweeps.values()
    ]
    return np.concatenate(parts) if parts else np.zeros((0, 3))
