"""An agent's own tracker: AB3DMOT on what it detects itself, in its odometry frame."""

from __future__ import annotations

from coopsim.tracking.ab3dmot_tracker import ab3dmot
from coopsim.tracking.motion.constant_velocity import ConstantVelocity
from coopsim.tracking.motion.track_estimates import TrackEstimates
from coopsim.tracking.odometry_frame import OdometryFrame
from coopsim.tracking.tracker import reportable
from coopsim.types import Observation


class OnBoardTracker:
    """Tracks one agent's own detections over one episode; no message and no global pose reaches its tracks.

    Attributes:
        frame: the agent's odometry frame.

    Args:
        gate: smallest 3D GIoU of a match, in [-1, 1].
        hits: frames with a detection until a track is reported.
        age: frames without a detection until a track is dropped.
    """

    def __init__(self, gate: float = -0.2, hits: int = 3, age: int = 2) -> None:
        self.frame = OdometryFrame()
        self._tracker = ab3dmot(gate, hits, age)

    def step(self, observation: Observation) -> TrackEstimates:
        """Take in one frame; the tracks worth reporting, in the odometry frame.

        Raises:
            InvalidValueError: time went back.
        """
        self.frame.move(observation)
        tracks = self._tracker.step(
            reportable(observation.detections).transform(self.frame.odom_SE3_base), observation.time_ns
        )
        beliefs = self._tracker.reported().beliefs
        return TrackEstimates(tracks, ConstantVelocity.planar_covariance(beliefs))
