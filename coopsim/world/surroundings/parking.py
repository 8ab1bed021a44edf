"""Vehicles in bays and driveways, facing either way, with people between them."""

from __future__ import annotations

import numpy as np

from coopsim.geometry import exact
from coopsim.geometry.se3 import Floats, wrap_angle
from coopsim.world.places.layout import Bay, Bystander
from coopsim.world.surroundings.cast import Cast, Role

_TAKEN, _BACKWARDS, _OF_CYCLES = 0.85, 0.3, 0.05
"""Shares of bays: with something in them, with a car against the direction of traffic, with bicycles. Ours."""

_BETWEEN, _ROOM_M = 0.3, 0.12
"""Share of the gaps between two parked cars in which somebody stands, and the least distance from both of them."""

_PLANTED = 0.25
"""Share of the other gaps in which a small tree stands."""

_TREE_ROOM_M = 0.5
_BAY_M, _NEXT_M = 6.3, 10.0
_CYCLE_STEP_M = 0.75
_DRIVEWAY_M, _SHORTEST_M = (2.3, 4.6), 4.8


def in_bays(
    bays: tuple[Bay, ...], cast: Cast, rng: np.random.Generator
) -> tuple[list[Bystander], list[tuple[float, float]]]:
    """Return what is parked in bays that have no class of their own, with people between, and places (m) for trees."""
    usual = [bay for bay in bays if bay.label is None]
    taken, backwards, of_cycles, between, aside = rng.random((5, len(usual)))
    found, trees, before = list[Bystander](), list[tuple[float, float]](), None
    for k, bay in enumerate(usual):
        if taken[k] > _TAKEN:
            before = None
        elif of_cycles[k] < _OF_CYCLES:
            found += _cycles(bay, cast, rng)
            before = None
        else:
            vehicle = _in_bay(bay, cast.vehicle, rng, backwards=bool(backwards[k] < _BACKWARDS))
            found.append(vehicle)
            if before is not None and between[k] < _BETWEEN:
                found += _between(before, vehicle, bay.heading_rad, aside[k] - 0.5, cast, rng)
            elif before is not None and between[k] < _BETWEEN + _PLANTED:
                trees += _gap(before, vehicle, _TREE_ROOM_M)
            before = vehicle
    return found, trees


def _in_bay(bay: Bay, role: Role, rng: np.random.Generator, *, backwards: bool) -> Bystander:
    model = role.draw(rng)
    room_m = max((_BAY_M - float(model.size_m[0])) / 2, 0.0)
    forth, tilt = room_m * rng.uniform(-0.8, 0.8), rng.normal(0.0, 0.01)
    x, y = bay.x_m + forth * exact.cos(bay.heading_rad), bay.y_m + forth * exact.sin(bay.heading_rad)
    return Bystander.of(model, float(x), float(y), bay.heading_rad + tilt + (np.pi if backwards else 0.0))


def _cycles(bay: Bay, cast: Cast, rng: np.random.Generator) -> list[Bystander]:
    """Fill a bay with bicycles across it."""
    ahead = np.array([exact.cos(bay.heading_rad), exact.sin(bay.heading_rad)])
    found = []
    for along in _CYCLE_STEP_M * (np.arange(7) - 3.0):
        if rng.random() < 0.75:
            x, y = np.array([bay.x_m, bay.y_m]) + along * ahead
            turn = rng.choice((-0.5, 0.5)) * np.pi + rng.normal(0.0, 0.08)
            found.append(Bystander.of(cast.cycle.draw(rng), float(x), float(y), bay.heading_rad + turn))
    return found


def _between(
    behind: Bystander, ahead: Bystander, heading_rad: float, aside: float, cast: Cast, rng: np.random.Generator
) -> list[Bystander]:
    """Return a person in the gap between two parked vehicles; none if there is too little room."""
    model, across = cast.standing.draw(rng), rng.choice((-0.5, 0.5)) * np.pi + rng.normal(0.0, 0.3)
    left = np.array([-exact.sin(heading_rad), exact.cos(heading_rad)])
    spots = np.array(_gap(behind, ahead, max(model.size_m[:2]) + 2 * _ROOM_M)).reshape(-1, 2) + aside * left
    return [Bystander.of(model, x, y, heading_rad + float(across)) for x, y in spots.tolist()]


def _gap(behind: Bystander, ahead: Bystander, least_m: float) -> list[tuple[float, float]]:
    """Return the middle x, y (m) of the gap between two parked vehicles; none if it is shorter than `least_m`."""
    x, y = ahead.x_m - behind.x_m, ahead.y_m - behind.y_m
    away_m = float(exact.hypot(x, y))
    gap_m = away_m - (behind.length_m + ahead.length_m) / 2
    if away_m > _NEXT_M or gap_m < least_m:
        return []
    share = (behind.length_m + gap_m) / 2 / away_m
    return [(behind.x_m + share * x, behind.y_m + share * y)]


def driveways(yards: tuple[Floats, ...]) -> list[tuple[Floats, float]]:
    """Return middles (2,) m and headings of places for a car on driveways among paved outlines (K, 2) m."""
    found = []
    for yard in yards:
        if len(yard) != 4:
            continue
        sides = np.roll(yard, -1, axis=0) - yard
        length = exact.hypot(sides[:, 0], sides[:, 1])
        longer = int(length[1] > length[0])
        wide_m, long_m = sorted((float(length[0]), float(length[1])))
        if _DRIVEWAY_M[0] <= wide_m <= _DRIVEWAY_M[1] and long_m >= _SHORTEST_M:
            along = sides[longer] / length[longer]
            for share in (0.5,) if long_m < 2 * _SHORTEST_M + 1.0 else (0.25, 0.75):
                spot = yard.mean(axis=0) + (share - 0.5) * long_m * along
                found.append((spot, float(wrap_angle(exact.arctan2(along[1], along[0])))))
    return found
