"""Options of how agents perceive and what is scored, in simulations and in replays of recordings with sweeps."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from coopsim.detection.detector import Detector, DetectorBase
from coopsim.detection.embedder import Embedder, make_embedder
from coopsim.detection.oracle import OracleDetector
from coopsim.detection.presets import make_detector
from coopsim.envs.options import refuse_overridden
from coopsim.localization.localizer import LocalizationConfig, localization_config
from coopsim.localization.pose_noise import PoseNoise
from coopsim.support.checks import require_choice, require_instance, require_positive

_LOCALIZATION_OPTIONS = ("position_noise_m", "heading_noise_rad", "odometry_noise_m", "odometry_heading_noise_rad")


@dataclass(frozen=True, slots=True)
class PerceptionOptions:
    """Options of localization, detection and of what counts. A subclass calls `check_perception` when it is made.

    Attributes:
        detector: a `Detector` or `OracleDetector`, or the name of one; None is the subclass's own.
        embedder: an `Embedder`, or the name of one; None: the detector's own embeddings stay.
        position_noise_m: standard deviation of the error of estimated positions, x and y.
        heading_noise_rad: the same of the heading.
        odometry_noise_m: the same of the motion in a frame, x and y.
        odometry_heading_noise_rad: the same of the turn in a frame.
        localization: overrides the four options above: a config, its mapping or file, or one by agent.
        ground_truth: the objects that count: "all", or the "visible" ones.
        region_x_m: objects within this distance ahead of and behind the agent count.
        region_y_m: objects within this distance to its left and right count.
    """

    detector: DetectorBase | str | None = None
    embedder: Embedder | str | None = None
    position_noise_m: float = 0.0
    heading_noise_rad: float = 0.0
    odometry_noise_m: float = 0.0
    odometry_heading_noise_rad: float = 0.0
    localization: LocalizationConfig | Mapping[str, Any] | str | Path | None = None
    ground_truth: Literal["visible", "all"] = "all"
    region_x_m: float = 100.0
    region_y_m: float = 40.0

    @property
    def region_m(self) -> tuple[float, float]:
        """Half the length and width of the evaluation region."""
        return self.region_x_m, self.region_y_m

    @property
    def chosen_detector(self) -> DetectorBase:
        """The detector as an object."""
        assert isinstance(self.detector, DetectorBase)
        return self.detector

    @property
    def chosen_embedder(self) -> Embedder | None:
        """The embedder as an object; None: the detector's own embeddings stay."""
        return self.embedder if isinstance(self.embedder, Embedder) else None

    @property
    def embedding_dim(self) -> int:
        """Length of the embeddings of detections; 0: they have none."""
        return self.chosen_detector.embedding_dim if self.chosen_embedder is None else self.chosen_embedder.dim

    def localization_of(self, agent: str) -> LocalizationConfig:
        """Return an agent's localization: of recordings, the errors that are added to the recorded poses."""
        if isinstance(self.localization, LocalizationConfig):
            return self.localization
        if isinstance(self.localization, Mapping) and agent in self.localization:
            config: LocalizationConfig = self.localization[agent]
            return config
        return LocalizationConfig(
            PoseNoise(self.position_noise_m, self.heading_noise_rad),
            self.odometry_noise_m,
            self.odometry_heading_noise_rad,
        )

    def check_scored(self) -> None:
        """Check which objects count.

        Raises:
            InvalidValueError: a value is not accepted.
        """
        require_choice("ground_truth", self.ground_truth, ("visible", "all"))
        require_positive(region_x_m=self.region_x_m, region_y_m=self.region_y_m)

    def check_perception(self, default: str, *, lidar: bool, cameras: bool) -> None:
        """Check localization, detector and embedder, and make the objects that are named.

        Args:
            default: name of the detector where none is given.
            lidar: agents have LiDARs.
            cameras: agents have cameras.

        Raises:
            InvalidValueError, UnknownNameError: a value is not accepted.
        """
        if self.localization is not None:
            object.__setattr__(self, "localization", localization_config(self.localization))
            if isinstance(self.localization, LocalizationConfig):
                refuse_overridden(self, _LOCALIZATION_OPTIONS, "localization")
        self.localization_of("")  # its own checks run now, not at the first episode
        detector = default if self.detector is None else self.detector
        if isinstance(detector, str):
            object.__setattr__(self, "detector", make_detector(detector))
        if isinstance(self.embedder, str):
            object.__setattr__(self, "embedder", make_embedder(self.embedder))
        if not isinstance(self.detector, OracleDetector):
            require_instance(Detector, detector=self.detector)
        require_instance(Embedder, embedder=self.embedder)
        self.chosen_detector.needs.require("detector", self.detector, lidar=lidar, cameras=cameras)
        if self.chosen_embedder is not None:
            self.chosen_embedder.needs.require("embedder", self.embedder, lidar=lidar, cameras=cameras)
