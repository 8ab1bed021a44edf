"""The detector "pillars": a network on an agent's own points (PointPillars' encoder, CenterPoint's head).

Importing this does not load torch; making the detector does.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Self

from coopsim.detection.detector import DETECTORS, Detector, Rng, SensorNeeds
from coopsim.localization.odometry import RecentSweeps
from coopsim.support.checks import require_between, require_count, require_probability
from coopsim.types import AgentSpec, Detections, SensorView

if TYPE_CHECKING:
    from coopsim.nn.inference.detectors import CloudDetector


@DETECTORS.register("pillars")
class PillarsDetector(Detector):
    """A network that finds objects of all classes in an agent's points, in a square around it.

    Its boxes have covariances.

    Args:
        weights: of the network, by name or as the path of a file.
        least_score: smallest score of a detection, in [0, 1].
        reach_m: half the edge of the square.
        threads: agents are looked at side by side on so many; the results are the same for any number.
        covariance: weights of a network that replaces the boxes' covariances, as "dmstrack_seen", by name or path;
            None: they are the head's.
        device: where the network computes: "cpu", "cuda", "cuda:1" or "auto"; on a GPU agents are one batch.

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
        require_probability(least_score=least_score)
        require_between(5, 300, reach_m=reach_m)
        require_count(1, threads=threads)
        import coopsim.nn  # noqa: F401  (says how to install torch, where it is not)
        from coopsim.learn.weights import load_covariance, load_detector
        from coopsim.nn.inference.backend import find_backend
        from coopsim.nn.inference.detectors import CloudDetector

        self._least_score, self._reach_m = least_score, reach_m
        net = load_detector(weights)
        judge = None if covariance is None else load_covariance(covariance, net)
        self._network: CloudDetector = CloudDetector(net, find_backend(device, threads), judge)
        self._sweeps = RecentSweeps(self._network.sweeps)

    def begin(self, specs: Mapping[str, AgentSpec], seed: int) -> Self:
        begun = object.__new__(type(self))
        begun.__dict__ |= self.__dict__ | {"_sweeps": RecentSweeps(self._network.sweeps)}
        return begun

    def detect(self, view: SensorView, rng: Rng) -> Detections:
        return self.detect_all({view.agent: view}, {view.agent: rng})[view.agent]

    def detect_all(self, views: Mapping[str, SensorView], rngs: Mapping[str, Rng]) -> dict[str, Detections]:
        clouds = [self._sweeps.points(view) for view in views.values()]
        return dict(zip(views, self._network.detect_around(clouds, self._reach_m, self._least_score), strict=True))
