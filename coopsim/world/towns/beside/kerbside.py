"""Parked vehicles at the kerb, speed humps and puddles."""

from __future__ import annotations

import numpy as np

from coopsim.geometry import exact
from coopsim.geometry.se3 import Floats
from coopsim.support.rng import stream
from coopsim.world.towns.beside.people_ways import PeopleWays
from coopsim.world.towns.beside.site import Site
from coopsim.world.towns.beside.surfaces import BULGE_M
from coopsim.world.towns.streets.kerb_sides import STREET, STRIP_M, Round
from coopsim.world.towns.streets.plan import LANE_M, Plan, Street

_BAY_M = 6.6
_VEHICLE_M = (6.45, 2.45)  # the room that the largest van needs
_ASIDE_M = 0.05  # from the middle of the strip to the pavement: in bends corners come close to the lane
_LEFT_OUT = 0.08  # share of bays
_HUMPS = 0.3  # share of streets of one lane
_HUMP_FREE_M = 18.0  # from stop lines, loops and crosswalks
_RAIN = 0.3  # share of towns with puddles
_PUDDLES = (4, 14)


def mark_bays(site: Site, plan: Plan, rounds: tuple[Round, ...], ways: PeopleWays, seed: int) -> None:
    """Add bays on all parking strips, away from crosswalks and driveways."""
    for each in rounds:
        for k, side in enumerate(each.sides):
            full = np.flatnonzero((each.side == k) & (each.strip_m > STRIP_M - 1e-6))
            if side.kind != STREET or not len(full):
                continue
            rng = stream(seed, "bays", str(side.number), str(side.arm))
            line = each.beside(-STRIP_M / 2)
            strips = np.split(full, np.flatnonzero(np.diff(full) > 1) + 1)  # one is interrupted where lanes split
            along = np.concatenate([_bays_along(each.along_m[strip], line[strip]) for strip in strips])
            keep = rng.random(len(along)) > _LEFT_OUT
            for street, at_m in ways.mid_block:
                keep &= (street != side.number) | (np.abs(along - at_m) > BULGE_M + _BAY_M / 2)
            _mark(site, plan.streets[side.number], side.arm, along[keep])


def _bays_along(along_m: Floats, line: Floats) -> Floats:
    """Return places (M,) along the street, evenly spaced on a line (N, 2) m beside it that has points at `along_m`."""
    steps_m = exact.norm(np.diff(line, axis=0), axis=1)
    passed_m = np.concatenate([[0.0], np.cumsum(steps_m)])
    count = int(passed_m[-1] // _BAY_M)
    middles_m = (np.arange(count) + 0.5) * passed_m[-1] / max(count, 1)
    return np.asarray(np.interp(middles_m, passed_m, along_m))


def _mark(site: Site, street: Street, way: int, along: Floats) -> None:
    if not len(along):
        return
    places = street.position(along, -way * (street.half_m(along) + STRIP_M / 2 + _ASIDE_M))
    headings = street.heading(along) + (0.0 if way > 0 else np.pi)
    for at, heading in zip(places, headings, strict=True):
        ahead, left = (
            np.array([exact.cos(heading), exact.sin(heading)]),
            np.array([-exact.sin(heading), exact.cos(heading)]),
        )
        a, b = _VEHICLE_M[0] / 2 * ahead, _VEHICLE_M[1] / 2 * left
        if site.kerbside.try_take([at + np.array([-a - b, a - b, a + b, b - a])]):
            site.add("parked", at=at.tolist(), heading_deg=float(np.degrees(heading)))


def add_humps(site: Site, plan: Plan, ways: PeopleWays, seed: int) -> None:
    """Add a hump to some streets of one lane in each direction."""
    for street in plan.streets:
        rng = stream(seed, "hump", str(street.number))
        wanted, share, height_m = rng.random() < _HUMPS, rng.uniform(0.3, 0.7), rng.uniform(0.07, 0.1)
        first, last = street.span_m
        along_m = first + share * (last - first)
        crossed = any(number == street.number and abs(at - along_m) < _HUMP_FREE_M for number, at in ways.mid_block)
        half_m = street.half_m([along_m - 4.0, along_m + 4.0])
        if not wanted or crossed or min(along_m - first, last - along_m) < _HUMP_FREE_M or half_m.max() > LANE_M + 0.01:
            continue
        site.add(
            "humps",
            at=street.position(along_m, -0.02)[0].tolist(),
            heading_deg=float(np.degrees(street.heading(along_m)[0])),
            width_m=2 * LANE_M,
            length_m=3.7,
            height_m=round(float(height_m), 3),
        )


def add_puddles(site: Site, plan: Plan, seed: int) -> None:
    """Add wet patches along the gutters, in some towns."""
    rng = stream(seed, "puddles")
    if rng.random() > _RAIN:
        return
    angle = np.arange(7) * 2 * np.pi / 7
    for _ in range(int(rng.integers(*_PUDDLES))):
        street = plan.streets[rng.integers(len(plan.streets))]
        along_m, way = rng.uniform(*street.span_m), rng.choice([-1, 1])
        half_m, long_m, wide_m = float(street.half_m(along_m)), rng.uniform(1.2, 4.0), rng.uniform(0.4, 0.9)
        reach = rng.uniform(0.8, 1.0, 7)
        along = along_m + long_m * exact.cos(angle) * reach
        aside = way * (half_m - 0.1 - wide_m + wide_m * exact.sin(angle) * reach)
        outline = street.position(along, aside)
        sides = np.roll(outline, -1, axis=0) - outline
        after = np.roll(sides, -1, axis=0)
        turns = way * (sides[:, 0] * after[:, 1] - sides[:, 1] * after[:, 0])
        if turns.min() > 0.0:  # in sharp bends some are not convex
            site.add("wet", outline=outline.tolist())
