"""Detectors by networks: "pillars" on points, "lift_splat" on images, "points_and_pictures" on both.

Importing this does not load torch; making a detector does.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Self

from coopsim.detection.detector import DETECTORS, Detector, Rng, SensorNeeds
from coopsim.localization.odometry import RecentSweeps
from coopsim.support.checks import require_between, require_count, require_probability
from coopsim.types import AgentSpec, Detections, SensorView

if TYPE_CHECKING:
    from coopsim.nn.inference.backend import Backend
    from coopsim.nn.inference.detectors import CloudDetector, ViewDetector


class NetworkDetector(Detector):
    """Network that finds objects of all classes in an agent's sensor data, in a square around it.

    Objects have scores from `least_score` on; the square's edge is 2 `reach_m`. On a CPU, agents are encoded by so many
    threads, with the same results for any number; on a GPU they are one batch.
    """

    def __init__(self, least_score: float, reach_m: float, threads: int) -> None:
        require_probability(least_score=least_score)
        require_between(5, 300, reach_m=reach_m)
        require_count(1, threads=threads)
        import coopsim.nn  # noqa: F401  (says how to install torch, where it is not)

        self._least_score, self._reach_m = least_score, reach_m

    def detect(self, view: SensorView, rng: Rng) -> Detections:
        return self.detect_all({view.agent: view}, {view.agent: rng})[view.agent]


@DETECTORS.register("pillars")
class PillarsDetector(NetworkDetector):
    """Network that finds objects of all classes in an agent's points, in a square around it.

    Its boxes have covariances.

    Args:
        weights: name of the network's weights, or path of their file.
        least_score: smallest score of a detection, in [0, 1].
        reach_m: half the edge of the square.
        threads: number of threads; the results are the same for any number.
        covariance: weights of a network that replaces the boxes' covariances, as "dmstrack_seen", by name or path;
            None: they are the head's.
        device: device of the network: "cpu", "cuda", "cuda:1" or "auto"; on a GPU agents are one batch.

    Raises:
        MissingDependencyError: torch is not installed.
        UnknownNameError: there are no such weights.
        InvalidValueError: a value is not accepted, or the weights are broken or of another encoder.
    """

    needs = SensorNeeds(lidar=True)
    states_covariance = True
    calibration = "pillars"

    def __init__(
        self,
        weights: str = "pillars",
        least_score: float = 0.1,
        reach_m: float = 76.8,
        threads: int = 2,
        covariance: str | None = None,
        device: str = "cpu",
    ) -> None:
        super().__init__(least_score, reach_m, threads)
        from coopsim.learn.weights import load_covariance, load_detector
        from coopsim.nn.inference.backend import find_backend
        from coopsim.nn.inference.detectors import CloudDetector

        net = load_detector(weights)
        judge = None if covariance is None else load_covariance(covariance, net)
        self._network: CloudDetector = CloudDetector(net, find_backend(device, threads), judge)
        self._sweeps = RecentSweeps(self._network.sweeps)

    def begin(self, specs: Mapping[str, AgentSpec], seed: int) -> Self:
        begun = object.__new__(type(self))
        begun.__dict__ |= self.__dict__ | {"_sweeps": RecentSweeps(self._network.sweeps)}
        return begun

    def detect_all(self, views: Mapping[str, SensorView], rngs: Mapping[str, Rng]) -> dict[str, Detections]:
        clouds = [self._sweeps.points(view) for view in views.values()]
        return dict(zip(views, self._network.detect_around(clouds, self._reach_m, self._least_score), strict=True))


@dataclass(eq=False, repr=False)
class CameraDetector(NetworkDetector):
    """Network that finds objects of all classes in an agent's images, or points and images, in a square around it.

    Any number of cameras will do, with any lens and mounting. An agent without cameras and LiDARs reports nothing. The
    boxes have covariances.

    Args:
        weights: name of the network's weights, or path of their file.
        least_score: smallest score of a detection, in [0, 1].
        reach_m: half the edge of the square; how far depths go, the network's weights say.
        threads: number of threads; the results are the same for any number.
        device: device of the network: "cpu", "cuda", "cuda:1" or "auto"; on a GPU agents are one batch.

    Raises:
        MissingDependencyError: torch is not installed.
        UnknownNameError: there are no such weights.
        InvalidValueError: a value is not accepted, or the weights are broken.
    """

    states_covariance = True

    weights: str
    least_score: float = 0.1
    reach_m: float = 76.8
    threads: int = 2
    device: str = "cpu"

    def __post_init__(self) -> None:
        super().__init__(self.least_score, self.reach_m, self.threads)
        from coopsim.nn.inference.backend import find_backend

        self._network = self._finder(self.weights, find_backend(self.device, self.threads))

    @abstractmethod
    def _finder(self, weights: str, backend: Backend) -> ViewDetector:
        """Return the network at work."""

    def detect_all(self, views: Mapping[str, SensorView], rngs: Mapping[str, Rng]) -> dict[str, Detections]:
        seeing = {agent: view for agent, view in views.items() if view.images or (view.sweeps and self.needs.lidar)}
        found = self._network.detect_around(list(seeing.values()), self._reach_m, self._least_score)
        return {agent: Detections.empty() for agent in views} | dict(zip(seeing, found, strict=True))


@DETECTORS.register("lift_splat")
@dataclass(eq=False, repr=False)
class LiftSplatDetector(CameraDetector):
    """Objects in images alone (Lift-Splat's encoder, CenterPoint's head); see `CameraDetector`."""

    needs = SensorNeeds(cameras=True)

    weights: str = "lift_splat"
    reach_m: float = 57.6

    def _finder(self, weights: str, backend: Backend) -> ViewDetector:
        from coopsim.learn.weights import load_pictures
        from coopsim.nn.inference.detectors import ViewDetector
        from coopsim.nn.inference.encoders import PictureEncoder

        net = load_pictures(weights)
        return ViewDetector(PictureEncoder(net, backend), net.head, net.config.cell_m, backend)


@DETECTORS.register("points_and_pictures")
@dataclass(eq=False, repr=False)
class PointsAndPicturesDetector(CameraDetector):
    """Objects in points and images together (DINO-CoDT's encoder, CenterPoint's head); see `CameraDetector`."""

    needs = SensorNeeds(lidar=True, cameras=True)

    weights: str = "points_and_pictures"

    def _finder(self, weights: str, backend: Backend) -> ViewDetector:
        from coopsim.learn.weights import load_points_and_pictures
        from coopsim.nn.inference.detectors import ViewDetector
        from coopsim.nn.inference.encoders import BothEncoder

        net = load_points_and_pictures(weights)
        return ViewDetector(BothEncoder(net, backend), net.head, net.config.pictures.cell_m, backend)
