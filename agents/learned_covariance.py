"""Covariances of boxes by a network."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from coopsim.errors import InvalidValueError
from coopsim.geometry.se3 import SE3, SE3Batch
from coopsim.interfaces.box_covariance import COVARIANCES, BoxCovariance
from coopsim.types import Mask
from coopsim.types.estimates import diagonals
from coopsim.types.groups import DetectionGroups

if TYPE_CHECKING:
    from coopsim.nn.covariance.covariance_net import CovarianceNet
    from coopsim.tracking.motion.constant_velocity import ConstantVelocity


@COVARIANCES.register("weights")
class LearnedCovariance(BoxCovariance):
    """Network, by name or path of its weights, that gives every box a covariance instead of the detector's.

    It works at the receiver: nothing is sent, so any codec serves, and one network serves any number of agents. A
    network that reads features works where these are, in the detector: then only the motion model is the network's.

    Raises:
        MissingDependencyError: torch is not installed.
        UnknownNameError: there are no such weights.
        InvalidValueError: it is no text, or the file is broken, or holds something else.
    """

    def __init__(self, weights: str) -> None:
        if not isinstance(weights, str):
            raise InvalidValueError(f"covariance must be the name or path of weights, got {weights!r}")
        import coopsim.nn  # noqa: F401  (says how to install torch, where it is not)
        from coopsim.learn.weights import load_covariance

        self._net: CovarianceNet = load_covariance(weights)

    @property
    def stated_by_detector(self) -> bool:
        """True if the network reads features: then detectors state the covariances, and only motion is used here."""
        return self._net.config.features > 0

    def motion(self) -> ConstantVelocity:
        """Return the motion model that the covariances were trained with."""
        return self._net.motion()

    def apply(
        self, groups: DetectionGroups, odom_SE3_base: SE3, odom_SE3_sensors: SE3Batch, known: Mask
    ) -> DetectionGroups:
        from coopsim.nn.covariance.box_numbers import box_numbers

        base_SE3_odom, joined = odom_SE3_base.inverse(), groups.joined
        if not len(joined) or self.stated_by_detector:
            return groups
        seen = joined.transform(base_SE3_odom)
        at = odom_SE3_sensors.seen_from(base_SE3_odom)
        sensors = np.where(known[:, None], np.column_stack([at.translation, at.yaw]), np.nan)
        numbers = box_numbers(seen.boxes.array, seen.score, groups.group, sensors)
        spread = replace(seen, covariance=diagonals(self._net.variances(numbers))).transform(odom_SE3_base).covariance
        assert spread is not None
        if groups.parts is None:
            return DetectionGroups(replace(joined, covariance=spread), groups.starts)
        bounds = zip(groups.parts, groups.starts[:-1], groups.starts[1:], strict=True)
        return DetectionGroups.of(replace(part, covariance=spread[first:last]) for part, first, last in bounds)
