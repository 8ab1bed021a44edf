"""Imperfections of LiDARs on the road, applied to the hits of ideal rays, at a small part of the cost of casting them.

Without `Imperfections` a sweep is that of a sensor whose mount is known exactly, whose beams are lines, whose surfaces
are Lambertian and evenly coloured, and which fires all beams at one time.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from coopsim.geometry.se3 import SE3, Floats, rotation_about
from coopsim.sensors.lidar.blooming import bloom
from coopsim.sensors.lidar.patterns import BeamPattern
from coopsim.sensors.scene import STATIC_ID, Singles, Triangles
from coopsim.support.checks import require_between, require_non_negative, require_positive, require_probability
from coopsim.support.kernels import njit
from coopsim.support.rng import require_seed, stream
from coopsim.types import Ints, Mask
from coopsim.world.models.surfaces import GLASS_REFLECTIVITY

MOST_TILT_RAD = 0.2
_INSIDE_M, _INSIDE_ALBEDO = (0.2, 1.6), 0.15  # seats, people, the far doors, through two panes; assumed by us
_TRUE_AT_M, _LEAST_RANGE_M = 15.0, 1.0  # range at which `fade` changes nothing, and below which it changes no more
_MOST_SHARE = 0.5  # of the way to a neighbouring ray: a beam that is wider overlaps it


@dataclass(frozen=True, slots=True)
class Imperfections:
    """Errors of a LiDAR's mount, optics and timing. The defaults are none.

    Attributes:
        roll_rad: true rotation about the sensor's x axis that its calibration does not know, within 0.2 rad. Points
            are reported as if it were 0, so it tilts the whole cloud.
        pitch_rad: likewise about its y axis.
        up_m: true height over the height that the calibration has, within 1 m.
        edge_rad: full angle of the beams' cones to the sides, in [0, 0.1]. It acts between a ray and its neighbour in
            the same row: of two rays that meet different surfaces, the edge between them is anywhere, and if it lies in
            a beam's cone, that beam has two echoes, merged or chosen as in `LidarConfig.divergence_rad`. This costs no
            more rays than lines do. Give one of the two.
        falloff: exponent of the cosine of incidence in a return's energy: 1 for matt surfaces (Lambert), below for
            rough ones (Oren and Nayar 1994), above for glossy ones.
        lost_share: share of the returns that are lost whatever their energy.
        through: share of the rays on vehicles' windows that the panes do not return. Half of them end inside, 0.2 to
            1.6 m behind the pane, the others are mirrored away or leave on the other side.
        beam_rad: standard deviation of the error of each beam's elevation in the calibration, in [0, 0.02].
        unit: seed of the errors of the beams: the number of the unit as built.
        speckle: standard deviation of the logarithm of a return's energy: unevenly coloured surfaces and speckle.
        gain: factor on reported intensities: data sets scale them differently.
        gamma: exponent of reported intensities, applied before `gain`.
        offset: added to reported intensities last, in [0, 1].
        fade: exponent by which reported intensities fall with the range, as (range / 15 m)^-`fade`, in [-2, 2]:
            sensors correct for it too little or too much. 0: rightly.
        turn_s: time of a revolution, in [0, 1] s. Points on moving actors are moved to where these were when the beam
            fired; what hides what stays that of one time. `LidarConfig.turn_s` casts exactly, at more cost.
        stamp: moment of the revolution at which the sweep is dated, in [0, 1]; 1: its end.
        uncorrected: share of the agent's own motion that is not taken out of the points, in [-1, 1].
        second_unit: beams from this number on belong to a second unit, half a revolution behind; 0: there is one unit.
        bloom_rad: angle over which the stray light around a retro-reflector falls to 1/e, in [0, 0.02]; 0: there is
            none (`coopsim.sensors.lidar.blooming`).
    """

    roll_rad: float = 0.0
    pitch_rad: float = 0.0
    up_m: float = 0.0
    edge_rad: float = 0.0
    falloff: float = 1.0
    lost_share: float = 0.0
    through: float = 0.0
    beam_rad: float = 0.0
    unit: int = 0
    speckle: float = 0.0
    gain: float = 1.0
    gamma: float = 1.0
    turn_s: float = 0.0
    stamp: float = 1.0
    uncorrected: float = 0.0
    second_unit: int = 0
    offset: float = 0.0
    fade: float = 0.0
    bloom_rad: float = 0.0

    def __post_init__(self) -> None:
        require_between(-MOST_TILT_RAD, MOST_TILT_RAD, roll_rad=self.roll_rad, pitch_rad=self.pitch_rad)
        require_between(-1, 1, up_m=self.up_m, uncorrected=self.uncorrected)
        require_between(0, 0.1, edge_rad=self.edge_rad)
        require_between(0, 1, turn_s=self.turn_s)
        require_between(0, 0.02, beam_rad=self.beam_rad, bloom_rad=self.bloom_rad)
        require_between(0, 1, offset=self.offset)
        require_between(-2, 2, fade=self.fade)
        require_probability(lost_share=self.lost_share, through=self.through, stamp=self.stamp)
        require_seed(self.unit)
        require_non_negative(falloff=self.falloff, speckle=self.speckle, second_unit=self.second_unit)
        require_positive(gain=self.gain, gamma=self.gamma)

    @property
    def told_SE3_true(self) -> SE3:
        """The true pose of the sensor in the frame in which its calibration has it."""
        rotation = rotation_about(1, self.pitch_rad) @ rotation_about(0, self.roll_rad)
        return SE3(rotation, np.array([0.0, 0.0, self.up_m]))

    def told_beams(self, beams: BeamPattern) -> BeamPattern:
        """Return the beam table that the calibration has of a sensor whose beams are these."""
        if self.beam_rad == 0:
            return beams
        error = self.beam_rad * stream(self.unit, "beams").standard_normal(len(beams.elevation_rad))
        steepest = np.pi / 2 - 1e-6
        return replace(beams, elevation_rad=np.clip(beams.elevation_rad + error, -steepest, steepest))

    def fall_off(self, cosine: Singles) -> Singles:
        """Return the share (R,) of a surface's light that comes back at incidences of these cosines (R,)."""
        return cosine if self.falloff == 1.0 else cosine ** np.float32(self.falloff)

    def worsen(
        self,
        echoes: tuple[Singles, Singles, Ints],
        triangles: Triangles,
        beams: BeamPattern,
        pulse_m: float,
        rng: np.random.Generator,
    ) -> tuple[Singles, Singles, Ints]:
        """Return range (m), share of light thrown back, and face of all rays, (R,) each, beam by beam.

        Adds windows, edges, blooming, speckle and losses. Every call takes the same number of draws for as many rays.
        """
        range_m, bounced, face = echoes
        rays = len(range_m)
        columns = rays // len(beams.elevation_rad)
        at, kept = rng.random(rays, np.float32), rng.random(rays, np.float32)
        bright = np.exp(np.float32(self.speckle) * rng.standard_normal(rays, np.float32))
        if self.through > 0:
            is_pane = (triangles.reflectivity == GLASS_REFLECTIVITY) & (triangles.instance > STATIC_ID)
            look_in(range_m, bounced, face, is_pane, rng.random(rays, np.float32), self.through)
        reach = min(self.edge_rad / 2 / (2 * np.pi / columns), _MOST_SHARE)
        worse = np.empty_like(range_m), np.empty_like(bounced), np.empty_like(face)
        _mix(range_m, bounced, face, at, columns, reach, pulse_m, worse)
        if self.bloom_rad > 0:
            bloom(worse, triangles.reflectivity, beams, self.bloom_rad)
        worse[1][:] *= bright
        worse[0][kept < self.lost_share] = np.inf
        return worse

    def report(self, intensity: Singles, away_m: Singles) -> Singles:
        """Return the intensities (N,) that the sensor reports of points this far away (N, 3)."""
        if self.gain == self.gamma == 1.0 and self.offset == self.fade == 0.0:
            return intensity
        scaled = np.float32(self.gain) * intensity ** np.float32(self.gamma)
        if self.fade != 0.0:
            range_m = np.maximum(np.linalg.norm(away_m, axis=1), np.float32(_LEAST_RANGE_M))
            scaled *= (range_m / np.float32(_TRUE_AT_M)) ** np.float32(-self.fade)
        reported: Singles = np.minimum(scaled + np.float32(self.offset), np.float32(1.0))
        return reported

    def drag(
        self,
        points: Singles,
        beam: Ints,
        instance: Ints,
        triangles: Triangles,
        world_SE3_base: SE3,
        origin_m: Floats,
        own_id: int | None,
    ) -> None:
        """Move points (N, 3) to where the moving things that they lie on were when their beams fired.

        `origin_m` is the sensor's place in the base frame, around which a beam's time is told by its azimuth.
        """
        if self.turn_s == 0 or triangles.parts is None or triangles.velocity is None:
            return
        whose = triangles.instance[triangles.parts.face_start[:-1].clip(max=len(triangles.instance) - 1)]
        velocity = triangles.velocity @ world_SE3_base.rotation[:2, :2]
        own = velocity[whose == own_id].sum(axis=0) * self.uncorrected
        moving = np.flatnonzero((velocity != 0).any(axis=1))
        moving = moving[np.argsort(whose[moving], kind="stable")]
        if len(moving) or own.any():
            second = self.second_unit or np.iinfo(np.int64).max
            time = self.turn_s, self.stamp, second
            _drag(points, beam, instance, whose[moving], velocity[moving], own, origin_m, time)


@njit(cache=True, nogil=True)
def look_in(range_m: Singles, bounced: Singles, face: Ints, is_pane: Mask, at: Singles, through: float) -> None:
    """Let a share of the rays (R,) on panes (F,) through, by uniform numbers `at` (R,): change range and light."""
    for ray in range(len(range_m)):
        if face[ray] < 0 or at[ray] >= through or not is_pane[face[ray]]:
            continue
        behind = 2.0 * at[ray] / through
        if behind < 1.0:
            range_m[ray] += _INSIDE_M[0] + behind * (_INSIDE_M[1] - _INSIDE_M[0])
            bounced[ray] = _INSIDE_ALBEDO
        else:
            range_m[ray] = np.inf


@njit(cache=True, nogil=True)
def _mix(
    range_m: Singles,
    bounced: Singles,
    face: Ints,
    at: Singles,
    columns: int,
    reach: float,
    pulse_m: float,
    worse: tuple[Singles, Singles, Ints],
) -> None:
    """Write the echoes of beams with a width into `worse`: range, share of light, and face, (R,) each.

    The edge between a ray's surface and its neighbour's is at the place `at` (R,), uniform in [0, 1) of the way between
    them: to the right if it is below `reach`, to the left if it is within `reach` of 1. The nearer it is, the more of
    the beam lies beyond it, up to half.
    """
    for ray in range(len(range_m)):
        worse[0][ray], worse[1][ray], worse[2][ray] = range_m[ray], bounced[ray], face[ray]
        near = min(at[ray], 1.0 - at[ray])
        if near >= reach:
            continue
        column = ray % columns
        step = -1 if at[ray] < 0.5 else 1
        other = ray - column + (column + step) % columns
        beyond = 0.5 * (1.0 - near / reach)
        have, has = np.isfinite(range_m[ray]), np.isfinite(range_m[other])
        if not have and not has:
            continue
        mine = (1.0 - beyond) * bounced[ray] if have else 0.0
        its = beyond * bounced[other] if has else 0.0
        weight = (mine + 1e-6) / range_m[ray] ** 2 if have else 0.0
        its_weight = (its + 1e-6) / range_m[other] ** 2 if has else 0.0
        if have and has and abs(range_m[ray] - range_m[other]) <= pulse_m:
            total = weight + its_weight
            worse[0][ray] = (weight * range_m[ray] + its_weight * range_m[other]) / total
            worse[1][ray] = mine + its
        elif weight >= its_weight:
            worse[1][ray] = mine
        else:
            worse[0][ray], worse[1][ray] = range_m[other], its
        if its_weight > weight:
            worse[2][ray] = face[other]


@njit(cache=True, nogil=True)
def _drag(
    points: Singles,
    beam: Ints,
    instance: Ints,
    ids: Ints,
    velocity: Floats,
    own: Floats,
    origin: Floats,
    time: tuple[float, float, int],
) -> None:
    """Move points (N, 3) by the velocities (M, 2) of the actors `ids` (M,), which rise, and by the agent's own (2,).

    `time` has the time of a revolution, the moment in it of the sweep, and the first beam of a second unit.
    """
    turn_s, stamp, second = time
    last, slot = np.int64(-1), len(ids)
    still = own[0] == 0.0 and own[1] == 0.0
    for p in range(len(points)):
        if instance[p] != last:
            last, slot = instance[p], np.searchsorted(ids, instance[p])
            if slot < len(ids) and ids[slot] != last:
                slot = len(ids)
        if slot == len(ids) and still:
            continue
        turned = math.atan2(points[p, 1] - origin[1], points[p, 0] - origin[0]) / (2 * math.pi)
        fired = (turned + (0.5 if beam[p] >= second else 0.0)) % 1.0
        age_s = (stamp - fired) * turn_s
        for axis in range(2):
            moved = own[axis] - (velocity[slot, axis] if slot < len(ids) else 0.0)
            points[p, axis] += moved * age_s
