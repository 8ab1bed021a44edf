"""The interface between cameras and the ways to find out what each pixel sees."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import ClassVar

from coopsim.geometry.se3 import SE3
from coopsim.sensors.camera.camera import Camera
from coopsim.sensors.scene import Singles, Triangles
from coopsim.types import Ints


@dataclass(frozen=True, slots=True, eq=False)
class PixelHits:
    """Hits of the rays through the middles of pixels: one sample each, so that all images made of them agree.

    Attributes:
        face: (H, W) index of the triangle, -1 where there is nothing between near and far.
        depth: (H, W) m along the optical axis; 0 where there is nothing.
    """

    face: Ints
    depth: Singles


class Renderer(ABC):
    """Interface of renderers: they find the triangle and the depth that each pixel of a camera sees.

    Attributes:
        name: value of the option `renderer`.
    """

    name: ClassVar[str]

    @abstractmethod
    def update(self, triangles: Triangles) -> None:
        """Take over a new frame."""

    @abstractmethod
    def see(self, camera: Camera, world_SE3_camera: SE3, own_id: int | None) -> PixelHits:
        """Return the frame's view from a camera's pose (OpenCV's axes: x right, y down, z forward), without the actor
        `own_id`.
        """

    @abstractmethod
    def close(self) -> None:
        """Release resources; nothing can be drawn any more."""
