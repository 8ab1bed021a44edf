"""Wide beams: an edge within a beam gives a point between both sides, or only one of them.

A beam is five rays: its middle and four around it. Echoes closer together than the pulse is long merge into one, at
their mean range by energy; of those that stay apart, the strongest is reported. So a surface that fills a part of a
beam returns a part of its light, and at an edge between surfaces near each other lie the mixed pixels known of real
sensors.
"""

from __future__ import annotations

import numpy as np

from coopsim.geometry.se3 import Floats
from coopsim.sensors.lidar.patterns import BeamPattern
from coopsim.sensors.scene import Singles
from coopsim.support.kernels import njit
from coopsim.types import Ints

_OFFSET = 0.35
"""Offset of the four rays from the middle, in divergences: half of a uniform beam's light is within."""


def footprint_patterns(pattern: BeamPattern, divergence_rad: float) -> list[BeamPattern]:
    """Return the beam table and, if beams diverge, four more: rays above, below, to the left and right of it."""
    if divergence_rad == 0:
        return [pattern]
    elevation, azimuth, aside = pattern.elevation_rad, pattern.offset_rad, _OFFSET * divergence_rad
    steepest = np.pi / 2 - 1e-6
    around = [(elevation + up, azimuth) for up in (aside, -aside)]
    around += [(elevation, azimuth + left / np.cos(elevation)) for left in (aside, -aside)]
    return [
        pattern,
        *(BeamPattern(pattern.name, np.clip(up, -steepest, steepest), _wrapped(left)) for up, left in around),
    ]


def _wrapped(angle_rad: Floats) -> Floats:
    wrapped: Floats = np.arctan2(np.sin(angle_rad), np.cos(angle_rad))
    return wrapped


@njit(cache=True, nogil=True)
def merge_echoes(range_m: Singles, bounced: Singles, face: Ints, pulse_m: float) -> tuple[Singles, Singles, Ints]:
    """Merge the echoes (K, R) of K rays per beam into one echo per beam.

    Args:
        range_m: (K, R) inf where nothing was hit.
        bounced: (K, R) reflectivity times cosine of incidence.
        face: (K, R) -1 where nothing was hit.
        pulse_m: echoes at most this far apart are one.

    Returns:
        Range (R,), share of the beam's light that is thrown back (R,), and face of the strongest ray (R,).
    """
    rays, beams = range_m.shape
    near, light, whose = np.full(beams, np.inf, np.float32), np.zeros(beams, np.float32), np.full(beams, -1)
    for beam in range(beams):
        best, strongest = 0.0, 0.0
        for k in range(rays):
            if face[k, beam] < 0:
                continue
            energy, moment, thrown, own = 0.0, 0.0, 0.0, 0.0
            for other in range(rays):
                distance = range_m[other, beam]
                if face[other, beam] < 0 or abs(distance - range_m[k, beam]) > pulse_m:
                    continue
                part = (bounced[other, beam] + 1e-6) / (distance * distance)  # black is not nothing
                energy, moment, thrown = energy + part, moment + part * distance, thrown + bounced[other, beam]
                own = part if other == k else own
            if energy > best * 1.000001 or (energy > best * 0.999999 and own > strongest):
                best, strongest = max(energy, best), own
                near[beam], light[beam], whose[beam] = moment / energy, thrown / rays, face[k, beam]
    return near, light, whose
