"""Colours with a meaning, the same in every image and in the report."""

from __future__ import annotations

import colorsys

RGB = tuple[int, int, int]

BACKGROUND: RGB = (24, 27, 32)
POINT: RGB = (96, 132, 150)
TRUTH: RGB = (150, 155, 162)
AGENT: RGB = (255, 181, 46)
CONNECTED: RGB = (86, 180, 233)
TEXT: RGB = (214, 218, 224)
HIDDEN: RGB = (226, 230, 236)
CRASH: RGB = (255, 84, 84)
LIE: RGB = (255, 45, 190)
TRACK: RGB = (120, 214, 170)
OTHER_TRACK: RGB = (74, 128, 104)
FALSE_TRACK: RGB = (112, 116, 124)

MAP: dict[str, RGB] = {
    "grass": (24, 34, 30),
    "yards": (34, 35, 38),
    "pavements": (34, 38, 44),
    "parking": (40, 43, 48),
    "lanes": (44, 48, 55),
    "markings": (98, 103, 111),
    "crosswalks": (70, 75, 84),
    "walls": (72, 66, 60),
    "buildings": (58, 52, 48),
    "trees": (38, 56, 44),
}
"""Colours of a road map's polygons by field, in the order of painting."""

KERB: RGB = (66, 72, 81)
"""Colour of the edges of pavements."""

LIGHT: dict[str, RGB] = {"G": (52, 199, 89), "g": (52, 199, 89), "y": (255, 190, 40), "r": (235, 70, 60)}
"""Colours of bars at stop lines, by the states of traffic lights."""

BAR_M = 0.9
"""Width of these bars."""

HUE_STEP = 0.38196601125
"""Step of successive ids around the colour wheel (1 is a turn): the golden angle, so that neighbours differ."""

SATURATION, LIGHTNESS = 0.75, 0.68
"""Saturation and lightness of tracks' colours; light enough that blue, too, stands out from the road."""


def track_color(track_id: int) -> RGB:
    """Return the colour of a track's id."""
    hue = (track_id * HUE_STEP) % 1.0
    red, green, blue = colorsys.hls_to_rgb(hue, LIGHTNESS, SATURATION)
    return round(red * 255), round(green * 255), round(blue * 255)
