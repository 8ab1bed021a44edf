"""The encoders of pictures, and of points and pictures, made quicker for use, and the pictures that they are given."""

from __future__ import annotations

import torch
from torch import Tensor

from coopsim.errors import InvalidValueError
from coopsim.nn.camera.lift_splat import LiftSplatEncoder
from coopsim.nn.camera.picture_batch import PictureBatch, SeenPicture
from coopsim.nn.camera.points_and_pictures import PointsAndPicturesEncoder
from coopsim.nn.detector.pillars import PillarBatch
from coopsim.nn.inference.backend import PROCESSOR, Backend
from coopsim.nn.inference.quick import folded, quickened
from coopsim.types import SensorView


class QuickPictureEncoder:
    """A `LiftSplatEncoder` for use alone.

    Args:
        encoder: the one that was trained.
        backend: on which it computes.
    """

    def __init__(self, encoder: LiftSplatEncoder, backend: Backend = PROCESSOR) -> None:
        self._encoder, self._backend = backend.place(folded(encoder)), backend
        self._encoder.to(memory_format=torch.channels_last)  # type: ignore[call-overload]

    def __call__(self, batch: PictureBatch) -> Tensor:
        """Return features (A, C, H / 2, W / 2), not negative; without gradients.

        Convolutions are as `Backend.inference` sets them; depths and sums on canvases are never shortened.

        Raises:
            InvalidValueError: rows or columns of the canvas do not divide by 8.
        """
        features: Tensor = self._encoder(self._backend.put(batch))
        return features


class QuickBothEncoder:
    """A `PointsAndPicturesEncoder` for use alone.

    Args:
        encoder: the one that was trained.
        backend: on which it computes.
    """

    def __init__(self, encoder: PointsAndPicturesEncoder, backend: Backend = PROCESSOR) -> None:
        made = folded(encoder)
        made.to(memory_format=torch.channels_last)  # type: ignore[call-overload]
        made.points = quickened(encoder.points, backend.numbers)
        self._encoder, self._backend = backend.place(made), backend

    def __call__(self, points: PillarBatch, pictures: PictureBatch) -> Tensor:
        """Return features (A, C, H / 2, W / 2), not negative; without gradients. Errors as of `QuickPictureEncoder`."""
        features: Tensor = self._encoder(self._backend.put(points), self._backend.put(pictures))
        return features


def pictures_of(view: SensorView) -> list[SeenPicture]:
    """Return an agent's pictures in colour, with their calibrations; none where its cameras gave no image.

    Raises:
        InvalidValueError: an image has no colours.
    """
    images = {camera: view.images[camera] for camera in view.cameras if camera in view.images}
    pictures = []
    for camera, image in images.items():
        if image.rgb is None:
            raise InvalidValueError(
                f"a network on pictures needs their colours, but camera {camera!r} of {view.agent} has none: make the "
                'environment with "rgb" among camera_modes'
            )
        pictures.append(SeenPicture(image.rgb, view.cameras[camera]))
    return pictures
