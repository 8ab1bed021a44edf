"""States of road users between two rows of a log: along a clothoid, as wheels roll, or straight."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from coopsim.geometry import exact
from coopsim.geometry.se3 import Floats, wrap_angle

_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(12)
_SHARES, _PARTS = (_NODES + 1) / 2, _WEIGHTS / 2
"""Gauss and Legendre's rule on [0, 1]: for the angles that are accepted below, exact to 1e-9."""

_STEPS = 6
"""Newton's steps: from the first guess, four reach 1e-12 in all angles that are accepted below."""

_LEAST_M, _WIDEST_RAD = 0.2, 1.2
"""Road users that move less, or whose heading is further from their way, go straight: people, and noise."""


class States(NamedTuple):
    """States of M road users: place (M, 3) m, heading (M,) rad, velocity (M, 2) m/s."""

    place: Floats
    heading: Floats
    velocity: Floats


def between(before: States, after: States, span_s: Floats, share: Floats) -> States:
    """Return the states at shares (M,) in [0, 1] of the time `span_s` (M,) between two states.

    Vehicles follow the clothoid that has the places and headings of both (Bertolazzi and Frego, "G1 fitting with
    clothoids", 2015); one that reverses does so backwards. Speed changes by Hermite's cubic. Others go straight.
    """
    chord = after.place[:, :2] - before.place[:, :2]
    length = exact.norm(chord)
    way = exact.arctan2(chord[:, 1], chord[:, 0])
    backwards = exact.cos(before.heading - way) < 0
    turned = np.where(backwards, np.pi, 0.0)
    start, end = (wrap_angle(each.heading + turned - way) for each in (before, after))
    rolls = (length >= _LEAST_M) & (np.abs(start) <= _WIDEST_RAD) & (np.abs(end) <= _WIDEST_RAD)
    start, end = np.where(rolls, start, 0.0), np.where(rolls, end, 0.0)
    bend = _fitted(start, end)
    arc = length / _integral(start, end, bend, np.ones_like(share))[0]
    gone = _gone(before, after, arc, span_s, share)
    along, across = (arc * part for part in _integral(start, end, bend, gone))
    cos, sin = exact.cos(way), exact.sin(way)
    place = np.empty_like(before.place)
    place[:, 0] = before.place[:, 0] + cos * along - sin * across
    place[:, 1] = before.place[:, 1] + sin * along + cos * across
    place[:, 2] = before.place[:, 2] + gone * (after.place[:, 2] - before.place[:, 2])
    straight = before.heading + share * wrap_angle(after.heading - before.heading)
    heading = wrap_angle(np.where(rolls, _angle(start, end, bend, gone) + way + turned, straight))
    velocity = before.velocity + share[:, None] * (after.velocity - before.velocity)
    return States(*(exact.settled(each) for each in (place, heading, velocity)))


def _angle(start: Floats, end: Floats, bend: Floats, gone: Floats) -> Floats:
    """Return the direction of the clothoid, from its chord, at shares of its length."""
    return start + gone * (end - start - bend + bend * gone)


def _integral(start: Floats, end: Floats, bend: Floats, gone: Floats) -> tuple[Floats, Floats]:
    """Return how far (M,) along and across its chord a clothoid of length 1 leads within shares of its length."""
    angle = _angle(start[:, None], end[:, None], bend[:, None], gone[:, None] * _SHARES)
    return gone * (_PARTS * exact.cos(angle)).sum(axis=1), gone * (_PARTS * exact.sin(angle)).sum(axis=1)


def _fitted(start: Floats, end: Floats) -> Floats:
    """Return the bend for which the clothoid ends on its chord."""
    bend = 3.0 * (start + end)
    for _ in range(_STEPS):
        angle = _angle(start[:, None], end[:, None], bend[:, None], _SHARES)
        missed = (_PARTS * exact.sin(angle)).sum(axis=1)
        slope = (_PARTS * exact.cos(angle) * _SHARES * (_SHARES - 1.0)).sum(axis=1)
        bend = bend - missed / slope
    return bend


def _gone(before: States, after: States, arc: Floats, span_s: Floats, share: Floats) -> Floats:
    """Return the share of the way after a share of the time, by the speeds at both ends where they fit its length."""
    whole = np.where(arc > 0, arc, 1.0)
    first, last = (exact.norm(each.velocity) * span_s / whole for each in (before, after))
    fits = (arc >= _LEAST_M) & (first <= 3.0) & (last <= 3.0)  # so that the cubic rises everywhere
    first, last = np.where(fits, first, 1.0), np.where(fits, last, 1.0)
    gone: Floats = share * (first + share * ((3.0 - 2.0 * first - last) + share * (first + last - 2.0)))
    return gone
