"""Colours and reflectivities of street furniture."""

from __future__ import annotations

from typing import NamedTuple


class Material(NamedTuple):
    """A surface.

    Attributes:
        color: RGB.
        reflectivity: at 905 nm.
    """

    color: tuple[int, int, int]
    reflectivity: float


ZINC = Material((148, 152, 156), 0.5)
DARK_METAL = Material((62, 68, 70), 0.3)
WOOD = Material((142, 104, 68), 0.5)
CONCRETE = Material((168, 166, 160), 0.4)
RUBBER = Material((30, 30, 32), 0.12)
GLASS = Material((150, 176, 182), 0.08)
GREEN = Material((58, 92, 66), 0.35)
GREY = Material((150, 152, 148), 0.4)
YELLOW = Material((214, 178, 52), 0.5)
RED = Material((178, 44, 40), 0.5)
BLUE = Material((52, 82, 140), 0.4)
WHITE = Material((226, 226, 220), 0.6)
CANVAS = Material((222, 214, 196), 0.6)
AWNING = Material((170, 66, 58), 0.55)
POSTER = Material((196, 170, 120), 0.5)
SAND = Material((198, 176, 130), 0.4)
RUBBLE = Material((134, 126, 118), 0.3)
EARTH = Material((96, 78, 60), 0.25)
BARK = Material((92, 70, 52), 0.3)
LEAVES = (Material((70, 104, 58), 0.45), Material((86, 116, 62), 0.45), Material((58, 92, 60), 0.45))
SIGN_RED = Material((190, 40, 40), 140.0)
SIGN_BLUE = Material((40, 80, 160), 60.0)
SIGN_WHITE = Material((232, 232, 226), 780.0)
"""Reflectivities of matt surfaces are round numbers of the order of measured ones. Plates of signs send light back to
where it comes from: sheeting of class RA2 of EN 12899-1 has, new, at least 250 cd/(lx m2) in white, 45 in red and 20 in
blue, which is as many times the 1/pi of matt white."""
