"""Captions: lines of text in a corner of a picture."""

from __future__ import annotations

import os
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from coopsim.viz import palette

_MARGIN_PX, _LETTERS_PX = 10, 24


def with_caption(picture: NDArray[np.uint8], lines: Sequence[str]) -> NDArray[np.uint8]:
    """Return a copy of a picture (H, W, 3) with lines of text in its upper right corner, as far as they fit."""
    os.environ.setdefault("PYGAME_HIDE_SUPPORT_PROMPT", "1")
    import pygame

    pygame.font.init()
    font, captioned, top = pygame.font.Font(None, _LETTERS_PX), picture.copy(), _MARGIN_PX
    for line in lines:
        letters = font.render(line, True, palette.TEXT, palette.BACKGROUND)
        pixels = pygame.surfarray.array3d(letters).transpose(1, 0, 2)
        left = max(picture.shape[1] - _MARGIN_PX - pixels.shape[1], 0)
        room = captioned[top : top + pixels.shape[0], left : left + pixels.shape[1]]
        room[:] = pixels[: room.shape[0], : room.shape[1]]
        top += pixels.shape[0]
    return captioned
