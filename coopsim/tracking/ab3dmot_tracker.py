"""AB3DMOT (Weng et al., IROS 2020), the baseline tracker of the field, and the on-board tracker made of it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from coopsim.geometry.assignment import hungarian
from coopsim.localization.odometry import OdometryFrame
from coopsim.support.checks import require_between
from coopsim.tracking.affinity import giou_3d
from coopsim.tracking.cascade import Cascade, Stage
from coopsim.tracking.lifecycle import HitsAndAge
from coopsim.tracking.motion.constant_velocity import ConstantVelocity, Motion
from coopsim.tracking.tracker import AssociationRound, Tracker
from coopsim.types import Detections, Observation
from coopsim.types.track_estimates import TrackEstimates
from coopsim.types.valid_detections import drop_unreportable


def ab3dmot(
    gate: float = -0.2,
    hits: int = 3,
    age: int = 2,
    later: AssociationRound | None = None,
    motion: Motion | None = None,
) -> Tracker:
    """Return the tracker: constant-velocity Kalman filter, 3D GIoU, Hungarian, confirmed by hits, ended by age.

    Args:
        gate: smallest 3D GIoU of a match, in [-1, 1].
        hits: frames with a detection, consecutive or not, until a track is reported.
        age: frames without a detection until a track is dropped.
        later: association of groups of detections after the first, see `Tracker`; None: as the first.
        motion: another motion model than AB3DMOT's.
    """
    require_between(-1, 1, gate=gate)
    stages = Cascade([Stage(giou_3d, hungarian, gate=gate)])
    return Tracker(motion or ConstantVelocity(), stages, HitsAndAge(hits, age), later=later)


class OnBoardTracker:
    """A tracker of one agent's own detections over one episode; no message and no global pose reaches its tracks.

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
        """Take in one frame and return the reported tracks, in the odometry frame.

        Raises:
            InvalidValueError: time went back.
        """
        self.frame.move(observation)
        tracks = self._tracker.step(
            drop_unreportable(observation.detections).transform(self.frame.odom_SE3_base), observation.time_ns
        )
        beliefs = self._tracker.reported().beliefs
        return TrackEstimates(tracks, ConstantVelocity.planar_covariance(beliefs))

    def with_velocities(self, observation: Observation, found: Detections) -> Detections:
        """Take in one frame and return its detections with the velocities of their tracks.

        Args:
            observation: the frame.
            found: valid detections in the agent's base frame.
        """
        self.frame.move(observation)
        odom_SE3_base, time_ns = self.frame.odom_SE3_base, observation.time_ns
        placed = found.transform(odom_SE3_base)
        self._tracker.step(placed, time_ns)
        velocity, _ = self._tracker.known(placed, time_ns)
        # A track that has had one detection stands still: its velocity is unknown.
        velocity[~velocity.any(axis=1)] = np.nan
        return replace(found, velocity=velocity @ odom_SE3_base.rotation[:2, :2])
