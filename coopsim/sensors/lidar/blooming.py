"""Blooming: stray light of retro-reflectors in the beams around them.

Optics are not clean: a small share of a beam's light, and of what its receiver sees, lies in a skirt around its cone
(Dudzik et al. 2025, arXiv 2512.05932, model it by physical rendering). Only a retro-reflector, which sends back
hundreds of times as much as white paint, is seen through the skirt: at its own range, around its outline.
"""

from __future__ import annotations

import math

import numpy as np

from coopsim.geometry.se3 import Floats
from coopsim.sensors.lidar.patterns import BeamPattern
from coopsim.sensors.scene import Singles
from coopsim.support.kernels import njit
from coopsim.types import Ints

_SKIRT = 0.02  # share of the light in the skirt at its middle; assumed: a plate then blooms over white paint
_REACH = 5.0  # skirts after which nothing is left


def bloom(echoes: tuple[Singles, Singles, Ints], reflectivity: Floats, beams: BeamPattern, skirt_rad: float) -> None:
    """Add the stray light of retro-reflectors to rays (R,), beam by beam: change range, light and face in place.

    Args:
        echoes: range (m), share of light thrown back, and face of each ray.
        reflectivity: (F,) of the faces; above 1: retro-reflectors.
        beams: the true beam table.
        skirt_rad: angle over which stray light falls to 1/e.
    """
    range_m, bounced, face = echoes
    bright = np.flatnonzero((face >= 0) & (np.append(reflectivity, 0.0)[face] > 1.0))
    sources = bright, range_m[bright].copy(), bounced[bright].copy(), face[bright].copy()
    _spread(range_m, bounced, face, sources, beams.elevation_rad, beams.offset_rad, skirt_rad)


@njit(cache=True, nogil=True)
def _spread(
    range_m: Singles,
    bounced: Singles,
    face: Ints,
    sources: tuple[Ints, Singles, Singles, Ints],
    elevation: Floats,
    offset: Floats,
    skirt: float,
) -> None:
    """Let rays report a source in their skirt where it is brighter there than what they hit."""
    rays, ranges, lights, faces = sources
    columns = len(range_m) // len(elevation)
    step = 2 * math.pi / columns
    for k in range(len(rays)):
        row, column = rays[k] // columns, rays[k] % columns
        for other in range(len(elevation)):
            up = elevation[other] - elevation[row]
            if abs(up) > _REACH * skirt:
                continue
            level = math.cos(elevation[other])
            middle = column + (offset[row] - offset[other]) / step
            reach = int(_REACH * skirt / (step * level)) + 1
            for aside in range(round(middle) - reach, round(middle) + reach + 1):
                away = math.sqrt(up**2 + ((aside - middle) * step * level) ** 2)
                stray = lights[k] * _SKIRT * math.exp(-away / skirt)
                ray = other * columns + aside % columns
                own = bounced[ray] / range_m[ray] ** 2  # 0 where nothing was hit
                if away <= _REACH * skirt and stray / ranges[k] ** 2 > own:
                    range_m[ray], bounced[ray], face[ray] = ranges[k], stray, faces[k]
