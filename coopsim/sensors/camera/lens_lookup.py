"""Distorting lenses for renderers that draw only pinholes."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from coopsim.sensors.camera.intrinsics import MOST_PIXELS, Intrinsics

Pixels = NDArray[np.float32]

_FINER = 2
"""Pixels of the pinhole's picture for each pixel of the lens's, along either axis."""


class LensLookup:
    """Looks each pixel of a lens up in the picture of a finer and wider pinhole, at the nearest pixel.

    Attributes:
        pinhole: whose picture is to be drawn.
    """

    def __init__(self, lens: Intrinsics) -> None:
        seen = lens.rays[:, :2]
        low, high = seen.min(axis=0), seen.max(axis=0)
        focal_px = _FINER * np.array([lens.fx_px, lens.fy_px])
        focal_px = np.minimum(focal_px, (MOST_PIXELS - 2) / np.maximum(high - low, 1e-9))
        width, height = (np.ceil(focal_px * (high - low)) + 1).astype(int).tolist()
        self.pinhole = Intrinsics(width, height, *focal_px.tolist(), *(-focal_px * low).tolist())
        place = focal_px * (seen - low)
        nearest = np.clip(np.rint(place), 0, np.array([width, height]) - 1)
        self._shape = lens.size
        self._index = (nearest[:, 1] * width + nearest[:, 0]).astype(np.int64)
        self._beside = (place - nearest).astype(np.float32)

    def apply(self, face: NDArray[np.integer], inverse: Pixels) -> tuple[NDArray[np.integer], Pixels]:
        """Convert the pinhole's view to the lens's.

        Args:
            face: (h, w) of the pinhole's picture.
            inverse: (h, w, 3), inverse depth in 1/m, 0 where there is nothing, and its slopes along columns and rows on
                the face that is seen, which give it off the pixel's middle.

        Returns:
            Face and inverse depth, (H, W), in the directions of the lens's pixels.
        """
        found = inverse.reshape(-1, 3)[self._index]
        exact = found[:, 0] + found[:, 1] * self._beside[:, 0] + found[:, 2] * self._beside[:, 1]
        closeness = np.where(found[:, 0] > 0, exact, np.float32(0.0))
        return face.ravel()[self._index].reshape(self._shape), closeness.reshape(self._shape)
