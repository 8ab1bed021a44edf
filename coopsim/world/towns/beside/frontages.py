"""Buildings, gardens, walls and driveways along the sides of streets."""

from __future__ import annotations

import numpy as np

from coopsim.geometry import exact
from coopsim.geometry.se3 import Floats
from coopsim.support.rng import stream
from coopsim.world.places.layout import rectangle
from coopsim.world.towns.beside.corner_lots import WIDEST_RAD
from coopsim.world.towns.beside.lot_kinds import (
    CHURCH,
    KINDS,
    LotKind,
    draw_height_m,
    draw_kind,
    draw_setback_m,
    draw_style,
)
from coopsim.world.towns.beside.private_ground import PrivateGround
from coopsim.world.towns.beside.site import Frame, Site, frame_between
from coopsim.world.towns.streets.kerb_sides import CORNER

_FAITHFUL = 0.8  # share of lots that are of the street's usual kind
_STEP_M = 3.0  # on along the street where nothing fits
_LEAST_M = 7.0  # of a frontage
_DRIVEWAY_M = 3.2
_MORE_M = (0.0, 1.2, 3.0)  # farther from the street, where the building does not fit
_LESS = (1.0, 0.8, 0.6)  # of its depth


class Frontage:
    """The border between a street and private ground, by the distance along it.

    Args:
        border: (N, 2) m.
    """

    def __init__(self, border: Floats) -> None:
        steps_m = exact.norm(np.diff(border, axis=0), axis=1)
        self._border, self._along_m = border, np.concatenate([[0.0], np.cumsum(steps_m)])

    @property
    def length_m(self) -> float:
        """The length of the border."""
        return float(self._along_m[-1])

    def frame(self, from_m: float, to_m: float) -> Frame:
        """Return the ground between two places along the border."""
        x, y = (np.interp([from_m, to_m], self._along_m, self._border[:, axis]) for axis in (0, 1))
        return frame_between(np.array([x[0], y[0]]), np.array([x[1], y[1]]))


def build_frontages(site: Site, ground: PrivateGround) -> None:
    """Build along both sides of all streets, around turning loops, and where a street goes on past a junction.

    Args:
        site: the town, changed in place.
        ground: of the town.
    """
    for number, each in enumerate(ground.rounds):
        for k, side in enumerate(each.sides):
            wide = side.kind == CORNER and ground.plan.junctions[side.number].gap_rad(side.arm) >= WIDEST_RAD
            if side.kind != CORNER or wide:
                rng = stream(ground.seed, "frontage", str(side.kind), str(side.number), str(side.arm))
                index = np.flatnonzero(each.side == k)
                index = np.append(index, (index[-1] + 1) % len(each.kerb))
                _build_along(site, Frontage(ground.borders[number][index]), ground.openness, rng)


def _build_along(site: Site, frontage: Frontage, openness: float, rng: np.random.Generator) -> None:
    """Go along a border and build lot after lot."""
    usual, church_m = draw_kind(openness, rng), rng.uniform(0.0, 8.0) * frontage.length_m
    along_m = rng.uniform(0.0, 2.0)
    while along_m < frontage.length_m - _LEAST_M:
        name = usual if rng.random() < _FAITHFUL else draw_kind(openness, rng)
        kind = KINDS[name]
        if along_m > church_m:
            kind, church_m = CHURCH, np.inf
        width_m, gap_m = rng.uniform(*kind.width_m), rng.uniform(*kind.gap_m)
        width_m = min(width_m, frontage.length_m - along_m)
        gap_m = min(gap_m, frontage.length_m - along_m - width_m)
        driveway = kind.front == "garden" and gap_m > _DRIVEWAY_M and rng.random() < 0.6
        frame = frontage.frame(along_m, along_m + width_m)
        setback_m = _build(site, frame, kind, width_m, openness, rng)
        if setback_m is None:
            along_m += _STEP_M
            continue
        beside = frontage.frame(along_m + width_m, along_m + width_m + gap_m) if driveway else frame
        _finish(site, (frame, beside), kind, (width_m, setback_m, gap_m), openness, driveway, rng)
        along_m += width_m + gap_m


def _build(
    site: Site, frame: Frame, kind: LotKind, width_m: float, openness: float, rng: np.random.Generator
) -> float | None:
    """Build on a lot if there is room; return the distance from the border, None without."""
    setback_m, depth_m = draw_setback_m(kind, openness, rng), rng.uniform(*kind.depth_m)
    height_m, style = draw_height_m(kind, rng), draw_style(kind, rng)
    if not kind.shapes:
        return setback_m
    if width_m < kind.width_m[0] * 0.6:
        return None
    shape = kind.shapes[rng.integers(len(kind.shapes))]
    for more_m, less in zip(_MORE_M, _LESS, strict=True):
        parts = shape(width_m, less * depth_m, rng)
        parts = [part._replace(outline=part.outline + np.array([0.0, setback_m + more_m])) for part in parts]
        if site.build(frame, parts, height_m, 0.04, style):
            return setback_m + more_m
    return None


def _finish(
    site: Site,
    frames: tuple[Frame, Frame],
    kind: LotKind,
    size_m: tuple[float, float, float],
    openness: float,
    driveway: bool,
    rng: np.random.Generator,
) -> None:
    """Add a yard or garden before the building, a driveway beside it, a wall along the border.

    Args:
        site: the town.
        frames: the lot before the building and the gap to the next one.
        kind: of the lot.
        size_m: width of the building, distance from the border, width of the gap.
        openness: of the town.
        driveway: whether there is one in the gap.
        rng: the street's.
    """
    frame, beside = frames
    width_m, setback_m, gap_m = size_m
    draws, wall_m = rng.random(4), rng.choice([0.6, 0.9, 1.2, 1.8, 2.0])
    if setback_m > 0.4:
        before = frame.place(rectangle((0.0, width_m), (0.02, setback_m - 0.02)))
        _pave_if_clear(site, before, "yard" if kind.front == "yard" else "grass")
    if kind.front != "garden":
        return
    if driveway:
        at = (gap_m - _DRIVEWAY_M) * draws[0]
        drive = beside.place(rectangle((at, at + _DRIVEWAY_M), (0.02, max(setback_m, 1.2) + 5.6)))
        if site.room.is_free(drive):
            site.pave(drive, "yard")
            site.kerbside.take(beside.place(rectangle((at - 0.5, at + _DRIVEWAY_M + 0.5), (-8.0, 0.0))))
            if draws[1] < 0.6:
                spot = beside.place(np.array([[at + _DRIVEWAY_M / 2, max(setback_m + 2.2, 3.5)]]))[0]
                site.park(spot, beside.heading_rad + np.pi * (draws[2] < 0.5))
            site.room.take(drive)
    if setback_m > 1.5 and draws[3] < 0.8 - 0.6 * openness:
        gate_m = width_m * rng.uniform(0.3, 0.7)
        for low, high in ((0.1, gate_m - 0.6), (gate_m + 0.6, width_m - 0.1)):
            line = frame.place(np.array([[low, 0.2], [high, 0.2]]))
            site.wall(line[0], line[1], float(wall_m))


def _pave_if_clear(site: Site, outline: Floats, kind: str) -> None:
    if site.room.is_free(outline):
        site.pave(outline, kind)
