"""From hits to returns: energy, drop-out, range noise, and points in the agent's frame.

Energy is that of a white surface met head-on at `reference_range_m`, times reflectivity * cos(incidence) / range^2 (the
LiDAR equation for a surface larger than the beam), times the air's transmission there and back.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from coopsim.geometry.se3 import Floats
from coopsim.sensors.scene import Singles
from coopsim.support.kernels import njit
from coopsim.types import Ints
from coopsim.world.relief.surfaces import WATER_INDEX, wet_albedo

CLUTTER_ID = -1
"""Instance of a return from rain or fog."""


class Optics(NamedTuple):
    """Numbers of the sensor and of the air; see `LidarConfig` and `Weather`."""

    min_range_m: float
    max_range_m: float
    range_noise_m: float
    reference_range_m: float
    dropout_energy: float
    extinction_per_m: float
    range_noise_per_m: float


class Echoes(NamedTuple):
    """Hits of R rays.

    Attributes:
        range_m: (R,) inf where nothing was hit.
        bounced: (R,) reflectivity * cos(incidence).
        face: (R,) of the scene, -1 where nothing was hit.
        clutter_m: (R,) range of the air's own echo, inf for none; or (0,) in clear air.
        clutter_energy: (R,) or (0,).
    """

    range_m: Singles
    bounced: Singles
    face: Ints
    clutter_m: Singles
    clutter_energy: Singles


@njit(cache=True, nogil=True)
def reflect(face: Ints, cosine: Singles, reflectivity: Floats, wetness: float) -> Singles:
    """Return reflectivity times cosine of incidence, (R,); of retro-reflectors, above 1, the reflectivity alone.

    A film of water darkens (see `wet_albedo`), and at grazing incidence mirrors light away in both directions (Fresnel,
    by the approximation of Schlick 1994): wet surfaces are darker, and more so far away. Retro-reflectors look the same
    from all usual angles, and are sealed against water: the white sheeting of road signs has at least 250 cd/(lx m2)
    head-on and 150 at an incidence of 30 degrees (class RA2 of EN 12899-1, and Type III of ASTM D4956), matt white
    1/pi = 0.32 and 0.24.

    Args:
        face: (R,) that the rays hit, -1 for none.
        cosine: (R,) of incidence.
        reflectivity: (F,) of the faces.
        wetness: share of surfaces under water.
    """
    bounced = np.zeros(len(face), np.float32)
    mirrored = ((WATER_INDEX - 1.0) / (WATER_INDEX + 1.0)) ** 2
    for ray in range(len(face)):
        if face[ray] < 0:
            continue
        albedo = reflectivity[face[ray]]
        if albedo > 1.0:
            bounced[ray] = albedo
            continue
        if wetness > 0.0:
            slant = 1.0 - cosine[ray]
            let_in = (1.0 - mirrored) * (1.0 - slant * slant * slant * slant * slant)
            wet = wet_albedo(albedo) * let_in * let_in
            albedo += wetness * (wet - albedo)
        bounced[ray] = albedo * cosine[ray]
    return bounced


@njit(cache=True, nogil=True)
def receive(
    optics: Optics,
    echoes: Echoes,
    instance: Ints,
    own_id: int,
    draws: tuple[Singles, Singles],
    directions: Singles,
    poses: tuple[Floats, Floats, Ints],
) -> tuple[Singles, Singles, Ints, Ints]:
    """Return the points (N, 3) m that come back, in the base frame, with intensity, beam, and instance, (N,) each.

    Args:
        optics: of sensor and air.
        echoes: of R rays.
        instance: (F,) of the faces.
        own_id: instance that gives no return.
        draws: standard normal (R,) and standard exponential (R,) numbers.
        directions: (B, C, 3) unit vectors, sensor frame, R = B * C.
        poses: base_SE3_sensor in S sectors of the revolution: rotations (S, 3, 3), translations (S, 3) m; and the
            sector of each column (C,).
    """
    (normal, exponential), (rotations, translations, sectors) = draws, poses
    beams, columns = directions.shape[0], directions.shape[1]
    points, intensity = np.empty((beams * columns, 3), np.float32), np.empty(beams * columns, np.float32)
    row, source = np.empty(beams * columns, np.int64), np.empty(beams * columns, np.int64)
    count = 0
    for beam in range(beams):
        for column in range(columns):
            ray = beam * columns + column
            hit = np.int64(CLUTTER_ID) if echoes.face[ray] < 0 else instance[echoes.face[ray]]
            if hit == own_id:
                continue
            distance, energy, is_clutter = _strongest(optics, echoes, ray)
            if not optics.min_range_m <= distance <= optics.max_range_m:
                continue
            if exponential[ray] * optics.dropout_energy > energy:  # with probability exp(-energy / dropout_energy)
                continue
            spread = math.sqrt(optics.range_noise_m**2 + (optics.range_noise_per_m * distance) ** 2)
            reading = min(max(distance + spread * normal[ray], optics.min_range_m), optics.max_range_m)
            pose = sectors[column]
            for axis in range(3):
                along = 0.0
                for k in range(3):
                    along += rotations[pose, axis, k] * directions[beam, column, k]
                points[count, axis] = translations[pose, axis] + along * reading
            # Sensors report intensity calibrated for range: the surface's and the air's effects are left.
            bright = energy * (distance / optics.reference_range_m) ** 2
            intensity[count], row[count] = min(bright, 1.0), beam
            source[count] = CLUTTER_ID if is_clutter else hit
            count += 1
    return points[:count], intensity[:count], row[:count], source[:count]


@njit(cache=True, nogil=True)
def _strongest(optics: Optics, echoes: Echoes, ray: int) -> tuple[float, float, bool]:
    """Return range and energy of a ray's strongest echo, and whether it is clutter."""
    distance, energy = float(echoes.range_m[ray]), 0.0
    if distance < np.inf:
        energy = echoes.bounced[ray] * (optics.reference_range_m / distance) ** 2
        if optics.extinction_per_m > 0.0:
            energy *= math.exp(-2.0 * optics.extinction_per_m * distance)
    if len(echoes.clutter_m) and echoes.clutter_m[ray] < distance and echoes.clutter_energy[ray] > energy:
        return float(echoes.clutter_m[ray]), float(echoes.clutter_energy[ray]), True
    return distance, energy, False
