"""Colours that mean something, the same in every picture; ids keep theirs."""

from __future__ import annotations

import colorsys

GOLDEN_ANGLE = 0.38196601125
"""Successive ids step around the colour wheel by the golden angle, so that neighbours never look alike."""

BACKGROUND = (24, 27, 32)
ROAD = (44, 48, 55)
CROSSWALK = (70, 75, 84)
PAVEMENT = (34, 38, 44)
BUILDING = (58, 52, 48)
POINT = (96, 132, 150)
TRUTH = (150, 155, 162)
AGENT = (255, 206, 84)
TEXT = (214, 218, 224)


def track_color(track_id: int) -> tuple[int, int, int]:
    """The colour of a track's id, RGB; the report's script follows the same rule."""
    hue = (track_id * GOLDEN_ANGLE) % 1.0
    red, green, blue = colorsys.hls_to_rgb(hue, 0.62, 0.75)
    return round(red * 255), round(green * 255), round(blue * 255)
