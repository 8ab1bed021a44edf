"""The detectors "lift_splat" and "points_and_pictures": networks on an agent's own pictures, and on its points as well.

Importing this does not load torch; making a detector does.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping
from typing import TYPE_CHECKING

from coopsim.detection.detector import DETECTORS, Detector, Rng, SensorNeeds
from coopsim.support.checks import require_between, require_count, require_probability
from coopsim.types import Detections, SensorView

if TYPE_CHECKING:
    from coopsim.nn.inference.backend import Backend
    from coopsim.nn.inference.detectors import ViewDetector


class CameraDetector(Detector):
    """A network that finds objects of all classes in what an agent sees, in a square around it.

    Any number of cameras will do, with any lens and mounting. An agent without cameras and LiDARs reports nothing. The
    boxes have covariances.

    Args:
        weights: of the network, by name or as the path of a file.
        least_score: smallest score of a detection, in [0, 1].
        reach_m: half the edge of the square; how far depths go, the network's weights say.
        threads: agents are looked at side by side on so many; the results are the same for any number.
        device: where the network computes: "cpu", "cuda", "cuda:1" or "auto"; on a GPU agents are one batch.

    Raises:
        MissingDependencyError: torch is not installed.
        UnknownNameError: there are no such weights.
        InvalidValueError: a value is not accepted, or the weights are broken.
    """

    states_covariance = True

    def __init__(self, weights: str, least_score: float, reach_m: float, threads: int, device: str) -> None:
        require_probability(least_score=least_score)
        require_between(5, 300, reach_m=reach_m)
        require_count(1, threads=threads)
        import coopsim.nn  # noqa: F401  (says how to install torch, where it is not)
        from coopsim.nn.inference.backend import find_backend

        self._least_score, self._reach_m = least_score, reach_m
        self._network = self._finder(weights, find_backend(device, threads))

    @abstractmethod
    def _finder(self, weights: str, backend: Backend) -> ViewDetector:
        """Return the network at work."""

    def detect(self, view: SensorView, rng: Rng) -> Detections:
        return self.detect_all({view.agent: view}, {view.agent: rng})[view.agent]

    def detect_all(self, views: Mapping[str, SensorView], rngs: Mapping[str, Rng]) -> dict[str, Detections]:
        seeing = {agent: view for agent, view in views.items() if view.images or (view.sweeps and self.needs.lidar)}
        found = self._network.detect_around(list(seeing.values()), self._reach_m, self._least_score)
        return {agent: Detections.empty() for agent in views} | dict(zip(seeing, found, strict=True))


@DETECTORS.register("lift_splat")
class LiftSplatDetector(CameraDetector):
    """Objects in pictures alone (Lift-Splat's encoder, CenterPoint's head); see `CameraDetector`."""

    needs = SensorNeeds(cameras=True)

    def __init__(
        self,
        weights: str = "lift_splat",
        least_score: float = 0.1,
        reach_m: float = 57.6,
        threads: int = 2,
        device: str = "cpu",
    ) -> None:
        super().__init__(weights, least_score, reach_m, threads, device)

    def _finder(self, weights: str, backend: Backend) -> ViewDetector:
        from coopsim.learn.weights import load_pictures
        from coopsim.nn.inference.detectors import ViewDetector
        from coopsim.nn.inference.encoders import PictureEncoder

        net = load_pictures(weights)
        return ViewDetector(PictureEncoder(net, backend), net.head, net.config.cell_m, backend)


@DETECTORS.register("points_and_pictures")
class PointsAndPicturesDetector(CameraDetector):
    """Objects in points and pictures together (DINO-CoDT's encoder, CenterPoint's head); see `CameraDetector`."""

    needs = SensorNeeds(lidar=True, cameras=True)

    def __init__(
        self,
        weights: str = "points_and_pictures",
        least_score: float = 0.1,
        reach_m: float = 76.8,
        threads: int = 2,
        device: str = "cpu",
    ) -> None:
        super().__init__(weights, least_score, reach_m, threads, device)

    def _finder(self, weights: str, backend: Backend) -> ViewDetector:
        from coopsim.learn.weights import load_points_and_pictures
        from coopsim.nn.inference.detectors import ViewDetector
        from coopsim.nn.inference.encoders import BothEncoder

        net = load_points_and_pictures(weights)
        return ViewDetector(BothEncoder(net, backend), net.head, net.config.pictures.cell_m, backend)
