"""Perception of the agents in an episode: the truth around them, estimated poses, and detections."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np

from coopsim.detection.detector import Detector
from coopsim.detection.oracle import OracleDetector, Oracles
from coopsim.envs.frames import AgentFrame
from coopsim.envs.options import PerceptionOptions
from coopsim.errors import InvalidValueError
from coopsim.geometry.boxes import Boxes3D, in_region
from coopsim.geometry.se3 import Floats, SE3Batch, wrap_angle
from coopsim.localization.localizer import Localizer
from coopsim.support.checks import require_choice
from coopsim.support.kernels import njit
from coopsim.support.rng import derived_seed, stream
from coopsim.types import AgentSpec, CameraImage, Detections, GroundTruth, Ints, Observation, SensorView, Sweep
from coopsim.wire.observation_format import ObservationFormat
from coopsim.world.snapshot import Actors, AgentBody


@dataclass(frozen=True, slots=True, eq=False)
class GroundTruths:
    """The true surroundings of A agents.

    Attributes:
        oracles: the objects around each agent, K rows: all actors but the agent itself, in its base frame.
        returns: (K, A) number of LiDAR returns that each of the agents has from the row's object.
        visible_to: (K,): 0 the row's agent has returns, 1 only others have, 2 no agent has.
    """

    oracles: Oracles
    returns: Ints
    visible_to: Ints

    @classmethod
    def of(cls, bodies: Mapping[str, AgentBody], actors: Actors, returns: Ints) -> Self:
        """Return the truth around A agents among N actors in the world frame; `returns` (N, A) counts LiDAR returns."""
        world_SE3_base = tuple(body.world_SE3_base for body in bodies.values())
        base_SE3_world = SE3Batch.of([pose.inverse() for pose in world_SE3_base])
        turn, shift = base_SE3_world.rotation, base_SE3_world.translation
        own_id = np.array([0 if body.actor_id is None else body.actor_id for body in bodies.values()])
        start, row, center, velocity = _move(actors.id, actors.boxes.center, actors.velocity, own_id, turn, shift)
        own, from_row, visible_to = _count(start, row, returns)
        yaw = wrap_angle(actors.boxes.yaw[row] + np.repeat(base_SE3_world.yaw, np.diff(start)))
        around = actors.moved(row, Boxes3D.trusted(center, actors.boxes.size[row], yaw), velocity)
        return cls(Oracles(tuple(bodies), start, around, own, world_SE3_base, base_SE3_world), from_row, visible_to)

    def truths(self, region_m: tuple[float, float], *, all_count: bool) -> dict[str, GroundTruth]:
        """Return the ground truth by agent, with the region's half length and width.

        With `all_count` all objects in the region count, not only those that some agent has a return from.
        """
        around, boxes = self.oracles.actors, self.oracles.actors.boxes
        inside = in_region(boxes.center, region_m)
        counts = inside if all_count else inside & (self.visible_to < 2)
        truths, start = {}, self.oracles.start.tolist()
        for agent, begin, end in zip(self.oracles.agents, start, start[1:], strict=False):
            rows = slice(begin, end)
            truths[agent] = GroundTruth.trusted(
                around.id[rows],
                boxes[rows],
                around.label[rows],
                self.visible_to[rows],
                around.velocity[rows],
                self.returns[rows],
                inside[rows],
                counts[rows],
            )
        return truths


@njit(cache=True, nogil=True)
def _move(
    ids: Ints, center: Floats, velocity: Floats, own_id: Ints, turn: Floats, shift: Floats
) -> tuple[Ints, Ints, Floats, Floats]:
    """Move N actors (N, 3) with velocities (N, 2) into the base frame of each of A agents but those that are the agent.

    An agent that is no actor has the id 0; `turn` (A, 3, 3) and `shift` (A, 3) are those of each `base_SE3_world`.
    """
    most = len(ids) * len(own_id)
    start, row = np.zeros(len(own_id) + 1, np.int64), np.empty(most, np.int64)
    moved, driven, count = np.empty((most, 3)), np.empty((most, 2)), 0
    for a in range(len(own_id)):
        for n in range(len(ids)):
            if ids[n] == own_id[a]:
                continue
            x, y, z = center[n, 0], center[n, 1], center[n, 2]
            for axis in range(3):
                along = x * turn[a, axis, 0] + y * turn[a, axis, 1] + z * turn[a, axis, 2]
                moved[count, axis] = along + shift[a, axis]
            for axis in range(2):
                # From 0.0, as sums begin, lest a standing actor have the velocity -0.0.
                driven[count, axis] = 0.0 + velocity[n, 0] * turn[a, axis, 0] + velocity[n, 1] * turn[a, axis, 1]
            row[count] = n
            count += 1
        start[a + 1] = count
    return start, row[:count], moved[:count], driven[:count]


@njit(cache=True, nogil=True)
def _count(start: Ints, row: Ints, returns: Ints) -> tuple[Ints, Ints, Ints]:
    """Look up the returns (N, A) of the actor of each row (K,), for the rows of A agents.

    Returns:
        Those of the row's agent (K,), of all agents (K, A), and `GroundTruths.visible_to` (K,).
    """
    agents = len(start) - 1
    own, everybody = np.empty(len(row), np.int64), np.empty((len(row), agents), np.int64)
    seen, visible_to = np.zeros(len(returns), np.bool_), np.empty(len(row), np.int64)
    for n in range(len(returns)):
        for a in range(agents):
            seen[n] |= returns[n, a] > 0
    for a in range(agents):
        for k in range(start[a], start[a + 1]):
            everybody[k] = returns[row[k]]
            own[k] = returns[row[k], a]
            visible_to[k] = 0 if own[k] > 0 else 1 if seen[row[k]] else 2
    return own, everybody, visible_to


def observation_format(
    specs: Mapping[str, AgentSpec],
    options: PerceptionOptions,
    camera_modes: Sequence[str],
    *,
    skips_frames: bool = False,
) -> ObservationFormat:
    """Return the format of the agents' observations; raise `UnknownNameError` if `localization` has another agent."""
    if isinstance(options.localization, Mapping):
        for agent in options.localization:
            require_choice("agent in localization", agent, specs)
    return ObservationFormat(
        agents=tuple(specs),
        lidars={name: tuple(spec.lidars) for name, spec in specs.items()},
        cameras={
            name: {camera: calibration.size for camera, calibration in spec.cameras.items()}
            for name, spec in specs.items()
        },
        camera_modes=tuple(camera_modes),
        embedding_dim=options.embedding_dim,
        detection_covariances=options.chosen_detector.states_covariance,
        pose_covariances=any(options.localization_of(name).covariance_scale is not None for name in specs),
        skips_frames=skips_frames,
    )


class Perception:
    """Localization, detector and embedder of all agents over one episode; asked once in each frame, in order."""

    def __init__(self, options: PerceptionOptions, specs: Mapping[str, AgentSpec], seed: int) -> None:
        self._options, self._specs = options, specs
        self._localizers = {
            name: Localizer(options.localization_of(name), seed, name, spec.dt_s, stands=spec.kind == "rsu")
            for name, spec in specs.items()
        }
        simulated = isinstance(options.chosen_detector, OracleDetector)  # which is told the truth, and so the seed
        begun = seed if simulated else derived_seed(seed, "detector")
        self._detector = options.chosen_detector.begin(specs, begun)
        self._embedder = options.chosen_embedder
        self._rngs = {name: stream(seed, "detector", name) for name in specs}
        self._orders = {name: stream(seed, "order of detections", name) for name in specs}

    def frames(
        self,
        time_ns: int,
        bodies: Mapping[str, AgentBody],
        actors: Actors,
        returns: Ints,
        sweeps: Mapping[str, Mapping[str, Sweep]],
        images: Mapping[str, Mapping[str, CameraImage]],
        *,
        sensed: bool,
    ) -> dict[str, AgentFrame]:
        """Return the next frame of each agent: its observation, see `observe`, and the truth around it.

        Actors are in the world frame; `returns` (N, A) is the number of LiDAR returns that each agent has from each.
        """
        around = GroundTruths.of(bodies, actors, returns)
        observations = self.observe(time_ns, around.oracles, sweeps, images, sensed=sensed)
        truths = around.truths(self._options.region_m, all_count=self._options.ground_truth == "all")
        return {
            name: AgentFrame(
                observations[name],
                bodies[name],
                truth,
                {sensor: sweep.instance for sensor, sweep in sweeps[name].items() if sweep.instance is not None},
            )
            for name, truth in truths.items()
        }

    def observe(
        self,
        time_ns: int,
        oracles: Oracles,
        sweeps: Mapping[str, Mapping[str, Sweep]],
        images: Mapping[str, Mapping[str, CameraImage]],
        *,
        sensed: bool,
    ) -> dict[str, Observation]:
        """Return each agent's observation, with an empty inbox; without `sensed` nothing is detected.

        Sweeps (by agent and LiDAR) have instance ids, images (by agent and camera) may be in any modes.
        """
        located = {
            name: self._localizers[name].localize(pose)
            for name, pose in zip(oracles.agents, oracles.world_SE3_base, strict=True)
        }
        views = {
            name: SensorView(
                agent=name,
                time_ns=time_ns,
                odometry=odometry,
                sweeps={sensor: sweep.without_truth() for sensor, sweep in sweeps[name].items()},
                images={camera: image.without_truth() for camera, image in images.get(name, {}).items()},
                cameras=self._specs[name].cameras,
                lidars=self._specs[name].lidars,
                pose=pose,
            )
            for name, (pose, odometry) in located.items()
        }
        detections = self._detect(oracles, views) if sensed else dict.fromkeys(views, Detections.empty())
        return {
            name: Observation(
                time_ns,
                located[name][0],
                view.odometry,
                detections[name],
                dict(view.sweeps),  # copies, lest a detector change what is observed
                dict(view.images),
                sensed=sensed,
            )
            for name, view in views.items()
        }

    def _detect(self, oracles: Oracles, views: Mapping[str, SensorView]) -> Mapping[str, Detections]:
        detections: Mapping[str, Detections]
        if isinstance(self._detector, OracleDetector):
            detections = self._detector.detect_all(views, oracles, self._rngs)
        else:
            assert isinstance(self._detector, Detector)
            detections = self._detector.detect_all(views, self._rngs)
        if set(detections) != set(views):
            name = type(self._detector).__name__
            raise InvalidValueError(f"{name}.detect_all must return {sorted(views)}, got {sorted(detections)}")
        returned: Mapping[str, object] = detections  # custom detectors may ignore the annotation
        for agent, found in returned.items():
            if not isinstance(found, Detections):
                me = type(self._detector).__name__
                raise InvalidValueError(f"{me} must return Detections, got {type(found).__name__} for {agent}")
        if isinstance(self._detector, OracleDetector):
            detections = {agent: self._shuffled(agent, found) for agent, found in detections.items()}
        if self._embedder is None:
            return detections
        return {name: self._embedder.apply(detections[name], view) for name, view in views.items()}

    def _shuffled(self, agent: str, detections: Detections) -> Detections:
        """Return detections that were made from the truth in an order of their own, as the truth's would tell."""
        return detections[self._orders[agent].permutation(len(detections))]
