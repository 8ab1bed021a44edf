"""Returns of rays that hit something: energy, drop-out, range noise, points in the agent's frame, and counts by actor.

Energy is that of a white surface met head-on at `reference_range_m`, times reflectivity * cos(incidence) / range^2 (the
LiDAR equation for a surface larger than the beam), times the air's transmission there and back.

A wide beam is five rays: its middle and four around it. Echoes closer together than the pulse is long merge into one at
their mean range by energy; of those that stay apart, the strongest is reported. So a surface that fills a part of a
beam returns a part of its light, and at an edge between surfaces near each other lie the mixed pixels known of real
sensors.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from coopsim.errors import InvalidValueError
from coopsim.geometry.se3 import Floats
from coopsim.sensors.lidar.patterns import BeamPattern
from coopsim.sensors.scene import Singles
from coopsim.support.kernels import njit
from coopsim.types import Ints, Sweep
from coopsim.world.models.surfaces import WATER_INDEX, wet_albedo

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
    """Hits of R rays; without clutter, as in clear air, the last two are (0,).

    Attributes:
        range_m: (R,) inf where nothing was hit.
        bounced: (R,) reflectivity * cos(incidence).
        face: (R,) of the scene, -1 where nothing was hit.
        clutter_m: (R,) range of the air's own echo, inf for none.
        clutter_energy: (R,) its energy.
    """

    range_m: Singles
    bounced: Singles
    face: Ints
    clutter_m: Singles
    clutter_energy: Singles


@njit(cache=True, nogil=True)
def reflect(face: Ints, cosine: Singles, reflectivity: Floats, wetness: float) -> Singles:
    """Return reflectivity times cosine of incidence, (R,), by the faces (R,) that rays hit, -1 for none.

    `reflectivity` is (F,); of retro-reflectors, above 1, it is returned alone. A film of water darkens (see
    `wet_albedo`), and at grazing incidence mirrors light away in both directions (Fresnel, by the approximation of
    Schlick 1994): wet surfaces are darker, and more so far away. Retro-reflectors look the same from all usual angles,
    and are sealed against water: the white sheeting of road signs has at least 250 cd/(lx m2) head-on and 150 at an
    incidence of 30 degrees (class RA2 of EN 12899-1, and Type III of ASTM D4956), matt white 1/pi = 0.32 and 0.24.
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

    Faces have instances (F,), of which `own_id` gives no return. `draws` are standard normal (R,) and standard
    exponential (R,) numbers, `directions` (B, C, 3) unit vectors in the sensor's frame, R = B * C. `poses` are
    base_SE3_sensor in S sectors: rotations (S, 3, 3), translations (S, 3) m, and each column's sector (C,).
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
    """Merge the echoes (K, R) of K rays per beam into one echo per beam; those at most `pulse_m` apart are one.

    Range is inf, and the face -1, where nothing was hit; `bounced` is reflectivity times cosine of incidence. Returns
    range (R,), share of the beam's light that is thrown back (R,), and face of the strongest ray (R,).
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


def count_returns(sweeps: Mapping[str, Sweep], ids: Ints) -> Ints:
    """Count the returns from each of the actors `ids` (N,), distinct, over all sweeps, which must have instance ids."""
    counts = np.zeros(len(ids), dtype=np.int64)
    for name, sweep in sweeps.items():
        if sweep.instance is None:
            raise InvalidValueError(f"sweep {name!r} has no instance ids to count returns by")
        counts += count_instances(sweep.instance, ids)
    return counts


def count_instances(instance: Ints, ids: Ints) -> Ints:
    """Count how often each of the actors `ids` (N,), distinct, is among instances (P,); returns (N,)."""
    counts = np.empty(len(ids), dtype=np.int64)
    order = np.argsort(ids)
    counts[order] = _tally(instance, ids[order])
    return counts


@njit(cache=True, nogil=True)
def _tally(instance: Ints, ids: Ints) -> Ints:
    """Count how often each of `ids` (N,), which rise, is among instances (P,); returns (N,)."""
    counts = np.zeros(len(ids) + 1, np.int64)  # the last is of all others
    slot = len(ids)
    for p in range(len(instance)):
        if p == 0 or instance[p] != instance[p - 1]:  # neighbouring rays mostly hit the same actor
            slot = np.searchsorted(ids, instance[p])
            if slot < len(ids) and ids[slot] != instance[p]:
                slot = len(ids)
        counts[slot] += 1
    return counts[:-1]
