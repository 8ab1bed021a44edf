"""Simulated detectors: boxes made from the truth, as far as the LiDAR's returns support it."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass

import numpy as np

from coopsim.detection.detector import DetectorBase
from coopsim.geometry.se3 import SE3
from coopsim.types import Detections, Ints, SensorView
from coopsim.world.snapshot import Actors


@dataclass(frozen=True, slots=True, eq=False)
class Oracle:
    """The truth around one agent in one frame. Only `OracleDetector`s are given it.

    Attributes:
        actors: all N actors but the agent itself, in its base frame.
        returns: (N,) number of LiDAR returns from each; where no rays are cast, the number to expect.
        world_SE3_base: the agent's true pose.
    """

    actors: Actors
    returns: Ints
    world_SE3_base: SE3


class OracleDetector(DetectorBase, ABC):
    """A detector that is simulated: it thins and disturbs the truth. It needs no sensors of its own."""

    @abstractmethod
    def detect(self, view: SensorView, oracle: Oracle, rng: np.random.Generator) -> Detections:
        """Report the objects of one frame.

        Args:
            view: the agent's sensor data, in its base frame.
            oracle: the truth around the agent.
            rng: the agent's random stream for this purpose.

        Returns:
            The reported objects, in the agent's base frame.
        """
