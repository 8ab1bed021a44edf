"""Options of a replay of recordings with sweeps, as a frozen dataclass."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from coopsim.data.recordings.recorded_folder import ReadingOptions
from coopsim.detection.detector import Detector, DetectorBase
from coopsim.detection.embedder import Embedder, make_embedder
from coopsim.detection.oracle import OracleDetector
from coopsim.detection.presets import make_detector
from coopsim.envs.options import refuse_overridden
from coopsim.localization.localizer import LocalizationConfig, localization_config
from coopsim.localization.pose_noise import PoseNoise
from coopsim.sensors.camera.rig_names import rig_camera_names
from coopsim.support.checks import (
    require_choice,
    require_count,
    require_frame_time,
    require_instance,
    require_positive,
)

LEARNED = "pillars"
"""Name of the detector of replays that are given none; it needs torch."""

_LOCALIZATION_OPTIONS = ("position_noise_m", "heading_noise_rad", "odometry_noise_m", "odometry_heading_noise_rad")


@dataclass(frozen=True, slots=True)
class RecordedOptions:
    """Options of a replay of recordings with sweeps.

    Attributes:
        max_cycles: frames of an episode; None: all of the sequence.
        dt_s: time between two frames, a multiple of the recording's; None: the recording's.
        frame_s: time between two recorded frames where the files have no time stamps; None: the format's, 0.1 s.
        lidar_height_m: height of LiDARs over the ground where the files do not say it; a number, or one by kind.
        odometry: "poses" or "auto" (of the files), or "none" (for one agent alone, as if it stood still).
        points: of KITTI, "picture" (points in the picture, as only these are labelled) or "all".
        cameras: whether the observations have the recorded pictures; the name of a rig, as policies say what they need,
            means the same: a recording has the cameras that it has.
        detector: a `Detector` or `OracleDetector`, or the name of one; None is `LEARNED`. Simulated ones are given the
            labels, and the number of points in each box.
        embedder: an `Embedder`, or the name of one, that gives every detection an appearance; None: the detector's own.
        position_noise_m: standard deviation of an error that is added to the recorded position, x and y.
        heading_noise_rad: the same of the heading.
        odometry_noise_m: the same of the motion in a frame, x and y.
        odometry_heading_noise_rad: the same of the turn in a frame.
        localization: overrides the four options above, as in a simulated environment.
        ground_truth: the objects that count: "all" that are labelled, or "visible": those with a point in their box.
        region_x_m: objects within this distance ahead of and behind the agent count.
        region_y_m: objects within this distance to its left and right count.

    Raises:
        InvalidValueError, UnknownNameError: a value is not accepted.
    """

    max_cycles: int | None = None
    dt_s: float | None = None
    frame_s: float | None = None
    lidar_height_m: float | Mapping[str, float] | None = None
    odometry: str = "auto"
    points: str = "picture"
    cameras: bool | str = False
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

    def __post_init__(self) -> None:
        if self.max_cycles is not None:
            require_count(1, max_cycles=self.max_cycles)
        if self.dt_s is not None:
            require_frame_time(self.dt_s)
        require_choice("ground_truth", self.ground_truth, ("visible", "all"))
        require_positive(region_x_m=self.region_x_m, region_y_m=self.region_y_m)
        rig_camera_names(self.cameras)
        self.reading  # noqa: B018  (its own checks run now)
        if self.localization is not None:
            object.__setattr__(self, "localization", localization_config(self.localization))
            if isinstance(self.localization, LocalizationConfig):
                refuse_overridden(self, _LOCALIZATION_OPTIONS, "localization")
        self.localization_of("")
        self._check_detection()

    def _check_detection(self) -> None:
        detector = LEARNED if self.detector is None else self.detector
        if isinstance(detector, str):
            object.__setattr__(self, "detector", make_detector(detector))
        if isinstance(self.embedder, str):
            object.__setattr__(self, "embedder", make_embedder(self.embedder))
        if not isinstance(self.detector, OracleDetector):
            require_instance(Detector, detector=self.detector)
        require_instance(Embedder, embedder=self.embedder)
        cameras = bool(self.cameras)
        self.chosen_detector.needs.require("detector", self.detector, lidar=True, cameras=cameras)
        if self.chosen_embedder is not None:
            self.chosen_embedder.needs.require("embedder", self.embedder, lidar=True, cameras=cameras)

    @property
    def reading(self) -> ReadingOptions:
        """What the files leave open."""
        return ReadingOptions(self.frame_s, self.lidar_height_m, self.odometry, self.points)

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
        """Return the errors that are added to an agent's recorded poses."""
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
