"""Frames: the interface of their sources (a simulation or a recording), and their truth as infos."""

from __future__ import annotations

import math
import warnings
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from coopsim.errors import InvalidValueError
from coopsim.geometry.se3 import Floats
from coopsim.interfaces.attack import OpenFacts
from coopsim.sensors.visibility import PixelVisibility, Visibility
from coopsim.types import AgentSpec, CameraImage, GroundTruth, Ints, Observation, Tracks, stack_xyz_yaw
from coopsim.types.driving import CarState, Command
from coopsim.types.lies import Lie, lying_senders
from coopsim.types.sensing import TRUTH_MODES
from coopsim.wire.observation_format import ObservationFormat, pack_image
from coopsim.world.intersections import LitJunction
from coopsim.world.snapshot import Actors, AgentBody, RoadMap, StaticPart


@dataclass(frozen=True, slots=True, eq=False)
class AgentFrame:
    """Agent in a frame: its perception, and the truth around it.

    Attributes:
        observation: before communication (its inbox is empty).
        body: the agent's true pose and shape.
        truth: all objects but the agent itself, in its base frame; `truth.counts` are those of its score.
        instances: per sweep, the id of the actor behind each point; for training only.
        segmentation: per camera, the image in the modes that are truth; for training only.
        car: the car's own motion and its way ahead, where a planner or the action drives it; else None.
        command_m_s2: acceleration that was asked for in the step to this frame; NaN: none was.
    """

    observation: Observation
    body: AgentBody
    truth: GroundTruth
    instances: Mapping[str, Ints] = field(default_factory=dict)
    segmentation: Mapping[str, CameraImage] = field(default_factory=dict)
    car: CarState | None = None
    command_m_s2: float = math.nan


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
        agents: frames of the agents, by name, in the environment's order.
        actors: everything that is there, in the world frame (for pictures and `state()`).
        last: there is no frame after this one.
        probe: measurements that are made when asked for.
        end: why it is the last one, if it is: "crash" (of a driven car), "arrived" (all of them), "situation over",
            "recording over" or "max_cycles".
    """

    time_ns: int
    agents: Mapping[str, AgentFrame]
    actors: Actors
    last: bool = False
    probe: FrameProbe = field(default_factory=FrameProbe)
    end: str = "max_cycles"

    @property
    def terminal(self) -> bool:
        """It is the last one because a driven car has crashed, or because all have arrived."""
        return self.last and self.end in ("crash", "arrived")

    def without_probe(self) -> Frame:
        """Return the frame without what it holds for measurements that cost time."""
        return replace(self, probe=FrameProbe())


class FrameSource(ABC):
    """The frames of an episode, one after another.

    Attributes:
        name: the environment's id.
        specs: specs of all agents that ever appear, in order, with the running episode's cameras and LiDARs.
        format: format of the agents' observations.
        road_map: outlines of the running episode's place, for pictures, and its traffic lights as they are now.
        static: meshes of the running episode's place; none in a replay.
        capacity: the largest number of actors in a frame of any episode.
        region_m: (2,) half the length and width of the evaluation region around an agent; None: unlimited.
        any_score: recorded detections have scores that need not lie in [0, 1], and tracks have these.
    """

    name: str
    specs: Mapping[str, AgentSpec]
    format: ObservationFormat
    road_map: RoadMap
    static: tuple[StaticPart, ...] = ()
    capacity: int
    region_m: tuple[float, float] | None
    any_score: bool = False

    @abstractmethod
    def start(self, seed: int, options: Mapping[str, Any]) -> Frame:
        """Begin an episode and return its first frame.

        Raises:
            UnknownNameError: an option is refused, and nothing has begun.
            RecordingError: the recording is broken, and nothing has begun.

        After any other error the source has no frame to go on from.
        """

    @abstractmethod
    def advance(self, commands: Mapping[str, Command], tracks: Mapping[str, Tracks]) -> Frame:
        """Return the next frame.

        Args:
            commands: commands of the agents whose action drives, by name.
            tracks: tracks that each agent reported for the frame that is over, in its base frame; planners get them.

        Raises:
            PlannerError: a planner failed; see `coopsim.interfaces.planner`.
        """

    @property
    def sequences(self) -> tuple[str, ...]:
        """Names of the sequences that `reset(options={"sequence": name})` plays; empty where there are none."""
        return ()

    @property
    def episode_infos(self) -> Mapping[str, Any]:
        """Facts of the running episode that `reset` puts, besides its seed, in every agent's infos."""
        return {}

    @property
    def driven(self) -> tuple[str, ...]:
        """Names of the agents whose frames have the state of a driven car; empty where there are none."""
        return ()

    def car_ahead(self, name: str) -> CarState | None:
        """Return the motion of a connected car and the way ahead of it, as its driver knows them; None: not known."""
        return None

    def hear(self, received: Mapping[str, Observation]) -> None:
        """Take notice of the current frame's observations with what arrived: planners get planned ways of others."""

    @property
    def open_facts(self) -> OpenFacts:
        """Facts that attackers can look up."""
        return OpenFacts(self.driven)

    @property
    def junctions(self) -> tuple[LitJunction, ...]:
        """Junctions of the running episode of whose lights roadside units speak; empty without `signal_messages`."""
        return ()

    @property
    def staged(self) -> bool:
        """True where episodes are situations, which a driven car survives or does not."""
        return False

    @property
    def facts(self) -> Mapping[str, Any]:
        """Facts of the running episode for recorders, by name; see `coopsim.episode.Episode`."""
        return {}

    @property
    def reset_options(self) -> tuple[str, ...]:
        """Names that `reset(options=...)` understands."""
        return ()

    def known_options(self, options: object) -> dict[str, Any]:
        """Return the options of a `reset` that the source understands; warn of others.

        Raises:
            InvalidValueError: the options are no dict.
        """
        if not (options is None or isinstance(options, Mapping)):
            raise InvalidValueError(f"reset options must be a dict or None, got {options!r}")
        known = {key: value for key, value in (options or {}).items() if key in self.reset_options}
        for key in sorted(set(map(str, options or {})) - set(known)):
            accepted = ", ".join(self.reset_options) or "none"
            warnings.warn(f"reset option {key!r} is ignored; accepted: {accepted}", stacklevel=3)
        return known

    def close(self) -> None:
        """Release the source's resources."""


def actor_rows(actors: Actors, capacity: int) -> Floats:
    """Return actors as rows (capacity, 11): id, label, x, y, z, l, w, h, yaw, vx, vy in the world frame; then zeros."""
    rows = np.zeros((capacity, 11))
    rows[: len(actors)] = np.column_stack([actors.id, actors.label, actors.boxes.array, actors.velocity])
    return rows


def world_points(frame: Frame, agent: str | None = None) -> Floats:
    """Return the points of a frame's sweeps, (N, 3) m, moved to the world frame by the true poses.

    They are those of one `agent`; None: of all.
    """
    parts = [
        each.body.world_SE3_base.apply(sweep.points)
        for name, each in frame.agents.items()
        if agent is None or name == agent
        for sweep in each.observation.sweeps.values()
    ]
    return np.concatenate(parts) if parts else np.zeros((0, 3))


TRUTH_INFOS = (
    "ground_truth",
    "true_pose",
    "actor_id",
    "instances",
    "segmentation",
    "visibility",
    "pixel_visibility",
    "attackers",
    "lies",
)
"""Keys of the truth in infos, see `truth_infos` and `with_lies`."""


def truth_infos(frame: Frame, *, visibility: bool) -> dict[str, dict[str, Any]]:
    """Return the truth of a frame as it stands in the agents' infos; `visibility` adds the part that takes time.

    | key of `infos[agent]` | meaning |
    |---|---|
    | `ground_truth` | all objects but the agent itself, see below |
    | `true_pose` | (4,): the agent's true x, y, z m and heading rad in the world frame |
    | `actor_id` | the agent's own id among the actors; None for an agent that is no actor, as a roadside unit |
    | `instances` | by LiDAR, (P,): id of the actor behind each point, 0 for the scenery, -1 for clutter |
    | `segmentation` | by camera: `instance` and `semantic` (H, W), where `camera_modes` has them |
    | `visibility` | how well the agent's LiDARs see each actor (`Visibility`), with `expose_visibility` |
    | `pixel_visibility` | the same of its cameras, with `expose_visibility` and the mode `instance` |

    | key of `ground_truth` | meaning |
    |---|---|
    | `id`, `label` | (N,) |
    | `box` | (N, 7): x, y, z, l, w, h, yaw in the agent's base frame |
    | `velocity` | (N, 2) m/s over ground, in the axes of the agent's base frame |
    | `returns` | (N, A) number of LiDAR returns of each agent, in the order of `env.possible_agents` |
    | `seen_by` | (N, A) whether there is any |
    | `visible_to` | (N,): 0 the agent itself has returns, 1 only others have, 2 no agent has |
    | `in_region` | (N,) whether the object is in the evaluation region |
    | `counts` | (N,) whether the object counts in the score |

    A recording of detections in text files has no `velocity`, `returns`, `seen_by` and `visible_to`.
    """
    infos = {name: _truth_info(agent) for name, agent in frame.agents.items()}
    if visibility:
        for name, seen in frame.probe.visibility().items():
            infos[name]["visibility"] = _columns(seen)
        for name, shown in frame.probe.pixel_visibility().items():
            infos[name]["pixel_visibility"] = _columns(shown)
    return infos


def with_lies(infos: dict[str, dict[str, Any]], lies: Sequence[Lie]) -> dict[str, dict[str, Any]]:
    """Return the infos with what the messages of the frame lie about.

    | key of `infos[agent]` | meaning |
    |---|---|
    | `attackers` | names of all senders whose messages of this frame lie, sorted; empty: all are honest |
    | `lies` | a tuple of `coopsim.types.lies.Lie`, those of all agents; absent where there are none |
    """
    attackers = tuple(sorted(lying_senders(lies)))
    told: dict[str, Any] = {"attackers": attackers} | ({"lies": tuple(lies)} if lies else {})
    return {name: {**info, **told} for name, info in infos.items()}


def _truth_info(agent: AgentFrame) -> dict[str, Any]:
    return {
        "ground_truth": _object_columns(agent.truth),
        "true_pose": stack_xyz_yaw(agent.body.world_SE3_base),
        "actor_id": agent.body.actor_id,
        "instances": dict(agent.instances),
        "segmentation": {name: pack_image(image, TRUTH_MODES) for name, image in agent.segmentation.items()},
    }


def _object_columns(truth: GroundTruth) -> dict[str, NDArray[Any]]:
    # Copies, because the originals are what the agent is scored against.
    everywhere = np.ones(len(truth), np.bool_)
    columns: dict[str, NDArray[Any] | None] = {
        "id": truth.id,
        "box": truth.boxes.array,
        "label": truth.label,
        "velocity": truth.velocity,
        "returns": truth.returns,
        "seen_by": None if truth.returns is None else truth.returns > 0,
        "visible_to": truth.visible_to,
        "in_region": everywhere if truth.in_region is None else truth.in_region,
        "counts": everywhere if truth.counts is None else truth.counts,
    }
    return {name: column.copy() for name, column in columns.items() if column is not None}


def _columns(seen: Visibility | PixelVisibility) -> dict[str, NDArray[Any]]:
    return {field.name: getattr(seen, field.name) for field in fields(seen)}
