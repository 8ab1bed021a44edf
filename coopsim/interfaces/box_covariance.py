"""The interface of what gives received boxes a covariance, and its registry."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable

from coopsim.geometry.se3 import SE3, SE3Batch
from coopsim.support.registry import Registry
from coopsim.tracking.motion.constant_velocity import ConstantVelocity
from coopsim.types import Mask
from coopsim.types.groups import DetectionGroups


class BoxCovariance(ABC):
    """Covariances of boxes at their receiver, instead of the detector's."""

    @property
    @abstractmethod
    def stated_by_detector(self) -> bool:
        """True if detectors state the covariances already, and only motion is used here."""

    @abstractmethod
    def motion(self) -> ConstantVelocity:
        """Return the motion model that belongs to the covariances."""

    @abstractmethod
    def apply(
        self, groups: DetectionGroups, odom_SE3_base: SE3, odom_SE3_sensors: SE3Batch, known: Mask
    ) -> DetectionGroups:
        """Return groups with a covariance for every box.

        Args:
            groups: G groups in the receiver's odometry frame.
            odom_SE3_base: the receiver's base frame now.
            odom_SE3_sensors: (G) base frame of each group's agent when it sensed.
            known: (G,) False in a recording, where all boxes come in one agent's frame.
        """


COVARIANCES: Registry[Callable[[str], BoxCovariance]] = Registry(
    "covariance of boxes", home="coopsim.agents.learned_covariance"
)
"""Functions that make covariances of boxes, of a text: "weights" of the name or path of a network's weights."""
