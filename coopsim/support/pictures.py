"""Files of pictures: PNG and JPEG."""

from __future__ import annotations

import io
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from coopsim.errors import RecordingError

_QUALITY = 95


@contextmanager
def opened_picture(path: Path) -> Iterator[Image.Image]:
    """Open a picture, whose pixels are read when the block asks for them.

    Raises:
        RecordingError: the file is missing or no picture, also where the block finds that out.
    """
    try:
        with Image.open(path) as picture:
            yield picture
    except (OSError, SyntaxError, ValueError, Image.DecompressionBombError) as error:
        raise RecordingError(f"{path}: this is no picture: {getattr(error, 'strerror', None) or error}") from error


def encode_png(pixels: NDArray[np.uint8]) -> bytes:
    """Return pixels (H, W, 3) or (H, W) as a PNG file."""
    content = io.BytesIO()
    Image.fromarray(np.asarray(pixels)).save(content, "PNG")
    return content.getvalue()


def encode_jpeg(pixels: NDArray[np.uint8]) -> bytes:
    """Return pixels (H, W, 3) as a JPEG file of high quality."""
    content = io.BytesIO()
    Image.fromarray(np.asarray(pixels)).save(content, "JPEG", quality=_QUALITY)
    return content.getvalue()
