"""Each agent's perception in a simulated episode: where it believes it is, and the objects that it detects."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from coopsim.detection.detector import Detector
from coopsim.detection.oracle import Oracle, OracleDetector
from coopsim.envs.simulated.simulation_options import SimulationOptions
from coopsim.errors import InvalidValueError
from coopsim.localization.localizer import Localizer
from coopsim.support.rng import stream
from coopsim.types import AgentSpec, CameraImage, Detections, GroundTruth, Ints, Mask, Observation, SensorView, Sweep
from coopsim.world.snapshot import Actors, AgentBody


@dataclass(frozen=True, slots=True, eq=False)
class Vicinity:
    """The true surroundings of one agent in one frame.

    Attributes:
        body: the agent.
        actors: all N actors but the agent itself, in its base frame.
        returns: (N, A) number of LiDAR returns that each of A agents has from each actor.
        own: the agent's column in `returns`.
    """

    body: AgentBody
    actors: Actors
    returns: Ints
    own: int

    @classmethod
    def of(cls, body: AgentBody, actors: Actors, returns: Ints, own: int) -> Vicinity:
        """Return an agent's surroundings among all actors, which are in the world frame."""
        other = np.ones(len(actors), np.bool_) if body.actor_id is None else actors.id != body.actor_id
        return cls(body, actors[other].transform(body.world_SE3_base.inverse()), returns[other], own)

    @property
    def oracle(self) -> Oracle:
        """The truth that an `OracleDetector` is given."""
        return Oracle(self.actors, self.returns[:, self.own], self.body.world_SE3_base)

    def truth(self, region_m: tuple[float, float], *, all_count: bool) -> GroundTruth:
        """Return the ground truth.

        Args:
            region_m: half the length and width of the evaluation region.
            all_count: all objects in the region count, not only those that some agent has a return from.
        """
        actors, seen = self.actors, self.returns > 0
        visible_to = np.where(seen[:, self.own], 0, np.where(seen.any(axis=1), 1, 2))
        in_region: Mask = np.all(np.abs(actors.boxes.center[:, :2]) <= region_m, axis=1)
        counts = in_region if all_count else in_region & (visible_to < 2)
        return GroundTruth(
            actors.id, actors.boxes, actors.label, visible_to, actors.velocity, self.returns, in_region, counts
        )


class Perception:
    """Localization, detector and embedder of all agents over one episode; asked once in each frame, in order.

    Args:
        options: how agents localize themselves and detect.
        specs: the agents.
        seed: the episode's seed.
    """

    def __init__(self, options: SimulationOptions, specs: Mapping[str, AgentSpec], seed: int) -> None:
        self._specs = specs
        self._localizers = {
            name: Localizer(options.localization_of(name), seed, name, spec.dt_s, stands=spec.kind == "rsu")
            for name, spec in specs.items()
        }
        self._detector = options.chosen_detector.begin(specs, seed)
        self._embedder = options.chosen_embedder
        self._rngs = {name: stream(seed, "detector", name) for name in specs}

    def observe(
        self,
        time_ns: int,
        vicinities: Mapping[str, Vicinity],
        sweeps: Mapping[str, Mapping[str, Sweep]],
        images: Mapping[str, Mapping[str, CameraImage]],
        *,
        sensed: bool,
    ) -> dict[str, Observation]:
        """Return each agent's observation, with an empty inbox.

        Args:
            time_ns: now.
            vicinities: the agents' surroundings.
            sweeps: by agent and LiDAR, with instance ids.
            images: by agent and camera, in any modes.
            sensed: whether the sensors ran in this frame; if not, nothing is detected.
        """
        located = {
            name: self._localizers[name].localize(vicinity.body.world_SE3_base) for name, vicinity in vicinities.items()
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
            )
            for name, (_, odometry) in located.items()
        }
        detections = self._detect(vicinities, views) if sensed else dict.fromkeys(views, Detections.empty())
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

    def _detect(self, vicinities: Mapping[str, Vicinity], views: Mapping[str, SensorView]) -> Mapping[str, Detections]:
        if isinstance(self._detector, OracleDetector):
            detections: Mapping[str, Detections] = {
                name: self._detector.detect(view, vicinities[name].oracle, self._rngs[name])
                for name, view in views.items()
            }
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
        if self._embedder is None:
            return detections
        return {name: self._embedder.apply(detections[name], view) for name, view in views.items()}
