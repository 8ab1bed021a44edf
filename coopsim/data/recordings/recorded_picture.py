"""Pictures of recordings: files that are read when asked for."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from coopsim.data.files.pictures import opened_picture
from coopsim.errors import InvalidValueError, RecordingError
from coopsim.geometry.se3 import SE3, Floats
from coopsim.types import CameraCalibration


@dataclass(frozen=True, slots=True, eq=False)
class RecordedPicture:
    """One camera's picture, a file that is read when asked for.

    Attributes:
        path: of the file, PNG or JPEG.
        calibration: of the camera in this frame.
    """

    path: Path
    calibration: CameraCalibration

    def rgb(self) -> NDArray[np.uint8]:
        """Return the pixels (H, W, 3).

        Raises:
            RecordingError: the file is missing, broken, or of another size than the camera's pictures.
        """
        with opened_picture(self.path) as picture:
            pixels = np.asarray(picture.convert("RGB"))
        if pixels.shape[:2] != self.calibration.size:
            height, width = self.calibration.size
            raise RecordingError(
                f"{self.path}: a picture of {width} x {height} pixels is needed, got "
                f"{pixels.shape[1]} x {pixels.shape[0]}"
            )
        return pixels


def find_picture(path: Path, matrix: Floats, base_SE3_camera: SE3, distortion: Floats | None = None) -> RecordedPicture:
    """Return the picture of a file, of which only the size is read.

    Args:
        path: of the file.
        matrix: (3, 3), the camera's K; with a skew or another scale it is refused.
        base_SE3_camera: its pose in the base frame, x right, y down, z forward.
        distortion: (5,) k1, k2, p1, p2, k3; None: there is none.

    Raises:
        RecordingError: the file is missing or no picture, or the matrix is none of a camera.
    """
    try:
        lens = np.zeros(5) if distortion is None else distortion
        calibration = CameraCalibration(picture_size(path), matrix, lens, base_SE3_camera)
    except InvalidValueError as error:
        raise RecordingError(f"{path}: its camera's {error}") from error
    return RecordedPicture(path, calibration)


def picture_size(path: Path) -> tuple[int, int]:
    """Return height and width of the picture of a file.

    Raises:
        RecordingError: the file is missing or no picture.
    """
    with opened_picture(path) as picture:
        width, height = picture.size
    return height, width
