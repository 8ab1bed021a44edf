"""Options of a replay of recordings with sweeps, as a frozen dataclass."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from coopsim.data.recordings.recorded_folder import ReadingOptions
from coopsim.envs.perception_options import PerceptionOptions
from coopsim.sensors.camera.rig_names import rig_camera_names
from coopsim.support.checks import require_count, require_frame_time

LEARNED = "pillars"
"""Name of the detector of replays that are given none; it needs torch."""


@dataclass(frozen=True, slots=True)
class RecordedOptions(PerceptionOptions):
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

    def __post_init__(self) -> None:
        if self.max_cycles is not None:
            require_count(1, max_cycles=self.max_cycles)
        if self.dt_s is not None:
            require_frame_time(self.dt_s)
        self.check_scored()
        rig_camera_names(self.cameras)
        self.reading  # noqa: B018  (its own checks run now)
        self.check_perception(LEARNED, lidar=True, cameras=bool(self.cameras))

    @property
    def reading(self) -> ReadingOptions:
        """What the files leave open."""
        return ReadingOptions(self.frame_s, self.lidar_height_m, self.odometry, self.points)
