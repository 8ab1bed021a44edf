"""Each agent's perception in an episode: where it believes it is, and the objects that it detects."""

from __future__ import annotations

from collections.abc import Mapping

from coopsim.detection.detector import Detector
from coopsim.detection.oracle import OracleDetector, Oracles
from coopsim.envs.perception_options import PerceptionOptions
from coopsim.errors import InvalidValueError
from coopsim.localization.localizer import Localizer
from coopsim.support.rng import derived_seed, stream
from coopsim.types import AgentSpec, CameraImage, Detections, Observation, SensorView, Sweep


class Perception:
    """Localization, detector and embedder of all agents over one episode; asked once in each frame, in order.

    Args:
        options: how agents localize themselves and detect.
        specs: the agents.
        seed: the episode's seed.
    """

    def __init__(self, options: PerceptionOptions, specs: Mapping[str, AgentSpec], seed: int) -> None:
        self._specs = specs
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

    def observe(
        self,
        time_ns: int,
        oracles: Oracles,
        sweeps: Mapping[str, Mapping[str, Sweep]],
        images: Mapping[str, Mapping[str, CameraImage]],
        *,
        sensed: bool,
    ) -> dict[str, Observation]:
        """Return each agent's observation, with an empty inbox.

        Args:
            time_ns: now.
            oracles: the truth around the agents.
            sweeps: by agent and LiDAR, with instance ids.
            images: by agent and camera, in any modes.
            sensed: whether the sensors ran in this frame; if not, nothing is detected.
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
