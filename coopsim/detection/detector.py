"""Detectors: boxes from one agent's sensors. Derive from `Detector` to plug in your own.

The environment makes one episode's detector by `begin`, and in each frame asks it for all agents at once
(`detect_all`, by default one `detect` after another). A detector sees sensors and calibrations alone; detectors that
simulate errors on the truth are `coopsim.detection.oracle.OracleDetector`s.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, ClassVar, Self

import numpy as np

from coopsim.errors import InvalidValueError
from coopsim.support.methods import is_newer
from coopsim.support.registry import Registry
from coopsim.types import AgentSpec, Detections, SensorView

Rng = np.random.Generator


@dataclass(frozen=True, slots=True)
class SensorNeeds:
    """Sensors that a detector or an embedder cannot do without.

    Attributes:
        lidar: it reads sweeps.
        cameras: it reads images.
    """

    lidar: bool = False
    cameras: bool = False

    def require(self, option: str, value: object, *, lidar: bool, cameras: bool) -> None:
        """Raise `InvalidValueError` unless an environment's agents have these sensors.

        Args:
            option: name of the option that the needs come from, for the message.
            value: its value, an object whose class the message names.
            lidar: flag of agents that have LiDARs.
            cameras: flag of agents that have cameras.
        """
        me = type(value).__name__
        if self.lidar and not lidar:
            raise InvalidValueError(f"{option} must need no sweeps where lidar is None, got {me}, which does")
        if self.cameras and not cameras:
            raise InvalidValueError(f"{option} must need no images where cameras is False, got {me}, which does")


class DetectorBase:
    """Common base of real and simulated detectors.

    Attributes:
        needs: the sensors without which it cannot work; checked when an environment is made.
        embedding_dim: length of the embeddings in its detections; 0: they have none.
        states_covariance: flag of detections that have covariances.
        calibration: name of the kind of its scores and errors, by which policies choose weights that were learned from
            such detections ("pillars"); None: as those of PointPillars on V2V4Real, or unknown.
    """

    needs: ClassVar[SensorNeeds] = SensorNeeds()
    embedding_dim: int = 0
    states_covariance: bool = False
    calibration: str | None = None

    def begin(self, specs: Mapping[str, AgentSpec], seed: int) -> Self:
        """Return the detector of one episode, for all agents by name: this one itself, unless it keeps state.

        The seed is derived from the episode's, which cannot be had from it; `OracleDetector`s get the episode's.
        """
        return self


class Detector(DetectorBase, ABC):
    """A detector that works on sensor data. Override `detect`; override `detect_all` to process agents as one batch.

    A subclass that overrides `detect` alone is asked agent by agent, whatever its base class does for all at once.
    """

    needs: ClassVar[SensorNeeds] = SensorNeeds(lidar=True)

    def __init_subclass__(cls, **options: Any) -> None:
        super().__init_subclass__(**options)
        if is_newer(cls, "detect", "detect_all"):
            cls.detect_all = Detector.detect_all  # type: ignore[method-assign]

    @abstractmethod
    def detect(self, view: SensorView, rng: Rng) -> Detections:
        """Detect the objects of one frame.

        Args:
            view: the agent's sensor data, in its base frame.
            rng: the agent's random stream for this purpose, for detectors that draw.

        Returns:
            The detected objects, in the agent's base frame.
        """

    def detect_all(self, views: Mapping[str, SensorView], rngs: Mapping[str, Rng]) -> dict[str, Detections]:
        """Detect the objects of one frame for all agents; both arguments and the result are by agent."""
        return {agent: self.detect(view, rngs[agent]) for agent, view in views.items()}


class NoDetector(Detector):
    """A detector that never reports anything, for policies that bring their own (`detector="none"`)."""

    needs = SensorNeeds()

    def detect(self, view: SensorView, rng: Rng) -> Detections:
        """Return no detections."""
        return Detections.empty()


DETECTORS: Registry[Callable[..., DetectorBase]] = Registry(
    "detector",
    home=("coopsim.detection.presets", "coopsim.detection.network_detectors"),
    group="coopsim.detectors",
)
"""Functions that make a detector, by name; packages add theirs through the entry-point group `coopsim.detectors`."""

DETECTORS.register("none")(NoDetector)
