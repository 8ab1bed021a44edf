"""Embedders: the appearance of detections, as vectors. Derive from `Embedder` to plug in your own.

An embedder runs after whatever detector the environment has, so an appearance from images or points needs no detector
of its own. Give it to an environment as `embedder=`, an object or a registered name.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import replace
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike

from coopsim.config.spec import instantiate, parse_spec
from coopsim.detection.detector import SensorNeeds
from coopsim.errors import InvalidValueError
from coopsim.support.registry import Registry
from coopsim.types import Detections, SensorView


class Embedder(ABC):
    """Appearance vectors for detections.

    Attributes:
        dim: D, the length of its vectors, > 0.
        needs: the sensors without which it cannot work; checked when an environment is made.
    """

    dim: int
    needs: ClassVar[SensorNeeds] = SensorNeeds()

    @abstractmethod
    def embed(self, detections: Detections, view: SensorView) -> ArrayLike:
        """Embed the N detections of one frame.

        Args:
            detections: in the agent's base frame.
            view: the sensor data in which they were detected.

        Returns:
            (N, D) vectors, of which only the directions count. A row that is not finite, or all zeros, means that there
            is no appearance (an object outside all images, say).
        """

    def apply(self, detections: Detections, view: SensorView) -> Detections:
        """Return the detections with their embeddings.

        Raises:
            InvalidValueError: `embed` returned another shape than (N, `dim`).
        """
        embedding = np.asarray(self.embed(detections, view))
        if embedding.shape != (len(detections), self.dim):
            raise InvalidValueError(
                f"{type(self).__name__}.embed must return shape {(len(detections), self.dim)} for {len(detections)} "
                f"detections, got {embedding.shape}"
            )
        return replace(detections, embedding=embedding)


EMBEDDERS: Registry[Callable[..., Embedder]] = Registry(
    "embedder", home="coopsim.detection.identity_embedders", group="coopsim.embedders"
)
"""Functions that make an embedder, by name; packages add theirs through the group `coopsim.embedders`."""


def make_embedder(spec: str) -> Embedder:
    """Make an embedder by its name or spec, such as `mine` or `mine(dim=32)`."""
    name, parameters = parse_spec("embedder", spec)
    return instantiate("embedder", name, EMBEDDERS.get(name), parameters)
