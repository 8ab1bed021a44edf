"""The detector "lift_splat": a network on an agent's own pictures (Lift-Splat's encoder, CenterPoint's head).

Importing this does not load torch; making the detector does.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

from coopsim.detection.detector import DETECTORS, Detector, Rng, SensorNeeds
from coopsim.support.checks import require_between, require_count, require_probability
from coopsim.types import Detections, SensorView

if TYPE_CHECKING:
    from coopsim.nn.inference.picture_finder import PictureFinder


@DETECTORS.register("lift_splat")
class LiftSplatDetector(Detector):
    """A network that finds objects of all classes in an agent's pictures, in a square around it.

    Any number of cameras will do, with any lens and mounting. An agent without cameras reports nothing. The boxes have
    covariances.

    Args:
        weights: of the network, by name or as the path of a file.
        least_score: smallest score of a detection, in [0, 1].
        reach_m: half the edge of the square; how far depths go, the network's weights say.
        threads: agents are looked at side by side on so many; the results are the same for any number.

    Raises:
        MissingDependencyError: torch is not installed.
        UnknownNameError: there are no such weights.
        InvalidValueError: a value is not accepted, or the weights are broken.
    """

    needs = SensorNeeds(cameras=True)
    states_covariance = True

    def __init__(
        self, weights: str = "lift_splat", least_score: float = 0.1, reach_m: float = 57.6, threads: int = 2
    ) -> None:
        require_probability(least_score=least_score)
        require_between(5, 300, reach_m=reach_m)
        require_count(1, threads=threads)
        import coopsim.nn  # noqa: F401  (says how to install torch, where it is not)
        from coopsim.learn.weights import load_pictures
        from coopsim.nn.inference.picture_finder import PictureFinder

        self._least_score, self._reach_m = least_score, reach_m
        self._network: PictureFinder = PictureFinder(load_pictures(weights), threads)

    def detect(self, view: SensorView, rng: Rng) -> Detections:
        return self.detect_all({view.agent: view}, {view.agent: rng})[view.agent]

    def detect_all(self, views: Mapping[str, SensorView], rngs: Mapping[str, Rng]) -> dict[str, Detections]:
        from coopsim.nn.inference.quick_pictures import pictures_of

        pictures = [pictures_of(view) for view in views.values()]
        return dict(zip(views, self._network.detect_around(pictures, self._reach_m, self._least_score), strict=True))
