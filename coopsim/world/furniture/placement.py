"""Placement of furniture along streets, people's ways and fronts of buildings, one piece after the other."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from coopsim.config.annotated import Point
from coopsim.geometry import exact
from coopsim.geometry.se3 import Floats
from coopsim.support.arrays import numbered
from coopsim.support.rng import stream
from coopsim.types import Ints, Mask
from coopsim.world.furniture import kinds
from coopsim.world.furniture.free_ground import (
    BULKY,
    CROWN,
    GROUND,
    UNPAVED,
    Candidates,
    Discs,
    Obstacles,
    are_free,
    settle,
)
from coopsim.world.furniture.sides import Sides
from coopsim.world.places.description import MapFurniture

_STEPS_M = 0.5 * np.arange(8)  # distances that a piece is moved outward, until it fits
_LINE_STEPS_M = 0.5 * np.arange(6)
_BEFORE_CROSSWALK_M = 2.9
_SEEN_M = 8.0  # from the edge of a lane to the middle of a crosswalk over it
_TABLE_M, _TABLES, _TABLE_OUT_M = 2.6, 4, 1.4
_SCAFFOLD_RUN_M, _SCAFFOLD_OUT_M = (7.5, 15.0), 0.85
_ANY_WAY = ("tree", "bush", "heap")
"""Kinds without a front."""


class Placer:
    """Draws places of furniture, and puts up the pieces that fit; each kind in each zone has draws of its own."""

    def __init__(self, seed: int, plot: Plot) -> None:
        self._seed, self._plot = seed, plot

    def zone(self, zone: str, rows: Sequence[kinds.Row], lines: Sequence[kinds.Run], sides: Sides) -> None:
        """Put up the rows and runs of a zone, "kerb" or "back", those that fill gaps last."""
        self._rows(zone, [row for row in rows if not row.fills], sides)
        self._lines(zone, lines, sides)
        self._rows(zone, [row for row in rows if row.fills], sides)

    def _rows(self, zone: str, rows: Sequence[kinds.Row], sides: Sides) -> None:
        """Put up rows along the sides of a zone; pieces of "back" look back at the way."""
        for row in rows:
            draws = stream(self._seed, "furnish", zone, row.kind)
            along = _along(row, sides, draws)
            if not len(along):
                continue
            edge, outward, heading = sides.stands(along)
            facing = heading - sides.side * row.facing_rad - sides.side * (np.pi / 2 if zone == "back" else 0.0)
            if row.kind in _ANY_WAY:
                facing = draws.uniform(0.0, 2 * np.pi, len(edge))
            sizes = _tree_sizes(zone, len(edge), draws) if row.kind == "tree" else None
            self._put_outward(row, edge, outward, facing, sizes)

    def _lines(self, zone: str, lines: Sequence[kinds.Run], sides: Sides) -> None:
        """Put up runs along the sides of a zone, each at the distance where most of it fits."""
        for line in lines:
            draws = stream(self._seed, "furnish", zone, line.kind)
            start, side = _series(line.every_m, line.share, sides, draws)
            length = draws.uniform(*line.run_m, len(start))
            count = np.minimum(length, sides.first_m[side + 1] - start) // kinds.KINDS[line.kind].step_m
            kept = count >= 1
            if kept.any():
                pieces, run = self._runs(line, sides, start[kept], count[kept].astype(np.int64))
                self._plot.put_lines(line.kind, pieces, run, bulky=line.bulky, back=sides.side > 0)

    def crosswalks(self, sides: Sides, crosswalks: Sequence[Floats], *, some_lit: bool) -> None:
        """Put up signs where streets come to crosswalks, or (with `some_lit`) traffic lights at a share of them."""
        draws = stream(self._seed, "furnish", "crosswalks")
        lit = draws.uniform(size=len(crosswalks)) < (kinds.CROSSING_LIGHTS if some_lit else 0.0)
        grid, side = sides.grid(1.0)
        if not len(grid) or not len(crosswalks):
            return
        edge, _, heading = sides.stands(grid)
        middles = np.array([outline.mean(axis=0) for outline in crosswalks])
        away = exact.hypot(edge[:, None, 0] - middles[:, 0], edge[:, None, 1] - middles[:, 1])
        first = np.searchsorted(side, np.arange(len(sides.length_m)))
        places, lights = list[float](), list[bool]()
        for s, c in np.argwhere(np.minimum.reduceat(away, first, axis=0) < _SEEN_M).tolist():
            nearest = first[s] + int(away[first[s] : np.searchsorted(side, s, "right"), c].argmin())
            toward = middles[c] - edge[nearest]
            ahead = toward[0] * exact.cos(heading[nearest]) + toward[1] * exact.sin(heading[nearest])
            before = grid[nearest] + ahead - _BEFORE_CROSSWALK_M
            if sides.first_m[s] < before < sides.first_m[s + 1] + _BEFORE_CROSSWALK_M:
                places.append(min(before, sides.first_m[s + 1] - 0.3))
                lights.append(bool(lit[c]))
        for kind, light in (("traffic_light", True), ("sign", False)):
            along = np.array(places)[np.array(lights, dtype=np.bool_) == light]
            if len(along):
                spot, outward, direction = sides.stands(along)
                self._put_outward(kinds.Row(kind, 0.0, 0.6), spot, outward, direction + np.pi, None)

    def fronts(self, ends: Floats, out: Floats) -> None:
        """Put up scaffolds and tables of cafés before some fronts, of ends (N, 2, 2) m and unit vectors (N, 2)."""
        draws = stream(self._seed, "furnish", "fronts").uniform(size=(len(ends), 3))
        for number in np.flatnonzero(draws[:, 0] < kinds.SCAFFOLDS + kinds.CAFES).tolist():
            kind, long, place = draws[number].tolist()
            start, out_here = ends[number, 0], out[number]
            length = float(exact.hypot(*(ends[number, 1] - start)))
            along = (ends[number, 1] - start) / length
            if kind < kinds.SCAFFOLDS:
                step = kinds.KINDS["scaffold"].step_m
                run = min(_SCAFFOLD_RUN_M[0] + long * (_SCAFFOLD_RUN_M[1] - _SCAFFOLD_RUN_M[0]), length - 0.5)
                steps = np.arange(int(run // step), -1, -1) * step  # its rails are outward, on the left
                points = start + _SCAFFOLD_OUT_M * out_here + (place * (length - run) + steps)[:, None] * along
                self._plot.put_lines("scaffold", _pairs(points), np.full(len(points) - 1, number))
            else:
                spots = place * max(length - _TABLES * _TABLE_M, 0.0) + _TABLE_M * (np.arange(_TABLES) + 0.5)
                points = start + _TABLE_OUT_M * out_here + spots[spots < length - 1.0, None] * along
                heading = np.full(len(points), exact.arctan2(along[1], along[0]))
                self._plot.put("cafe_table", np.column_stack([points, heading]))

    def _put_outward(self, row: kinds.Row, edge: Floats, outward: Floats, facing: Floats, sizes: Floats | None) -> None:
        """Put up pieces at the first place outward from their edge where they fit, if any."""
        steps = len(_STEPS_M)
        places = edge[:, None] + (row.first_m + _STEPS_M)[:, None] * outward[:, None]
        wished = np.concatenate([places, np.broadcast_to(facing[:, None, None], (len(edge), steps, 1))], axis=2)
        choice = np.repeat(np.arange(len(edge)), steps)
        each = None if sizes is None else np.repeat(sizes, steps, axis=0)
        self._plot.put(row.kind, wished.reshape(-1, 3), choice, bulky=row.bulky, sizes=each)

    def _runs(self, line: kinds.Run, sides: Sides, start_m: Floats, count: Ints) -> tuple[Floats, Ints]:
        """Return pieces (N, 2, 2) m of R runs, and their run (N,), each moved outward to where most of it is free.

        Runs begin at distances `start_m` (R,) along the sides and have `count` (R,) pieces.
        """
        run, place = numbered(count)
        step_m = kinds.KINDS[line.kind].step_m
        ends = [sides.stands(start_m[run] + step_m * (place + more)) for more in (0, 1)]
        (edge, outward, _), (edge_after, outward_after, _) = ends
        out_m = line.first_m + _LINE_STEPS_M[:, None, None]
        tried = np.stack([edge + out_m * outward, edge_after + out_m * outward_after], axis=2)
        free = self._plot.are_free(line.kind, tried.reshape(-1, 2, 2), bulky=line.bulky).reshape(len(_LINE_STEPS_M), -1)
        most = np.stack([np.bincount(run, each) for each in free]).argmax(axis=0)
        return tried[most[run], np.arange(len(run))], run


def _series(every_m: float, share: float, sides: Sides, draws: np.random.Generator) -> tuple[Floats, Ints]:
    """Return distances (N,) at equal steps from a random first one on each side, and the numbers (N,) of the sides.

    Only a share of the sides has any.
    """
    has, phase = draws.uniform(size=(2, len(sides.length_m)))
    counts = np.ceil(np.maximum(sides.length_m / every_m - phase, 0.0)).astype(np.int64) * (has < share)
    side, place = numbered(counts)
    return sides.first_m[side] + (phase[side] + place) * every_m, side


def _along(row: kinds.Row, sides: Sides, draws: np.random.Generator) -> Floats:
    """Return distances (N,) of a row's pieces on all sides."""
    along, side = _series(row.every_m, row.share, sides, draws)
    along = along + row.jitter * row.every_m * draws.uniform(-1.0, 1.0, len(along))
    group = (np.arange(row.group) - (row.group - 1) / 2) * row.apart_m
    along, side = (along[:, None] + group).ravel(), np.repeat(side, row.group)
    kept: Floats = along[(along > sides.first_m[side] + 0.5) & (along < sides.first_m[side + 1] - 0.5)]
    return kept


def _tree_sizes(zone: str, count: int, draws: np.random.Generator) -> Floats:
    """Draw heights, widths of crowns and heights of stems (N, 3) m."""
    sizes = np.array(kinds.TREE_SIZES_M)[draws.integers(len(kinds.TREE_SIZES_M), size=count)]
    return np.column_stack([sizes, np.full(count, kinds.STREET_STEM_M if zone == "kerb" else kinds.YARD_STEM_M)])


def _pairs(points: Floats) -> Floats:
    """Return the pieces (N, 2, 2) of a line through points (N + 1, 2)."""
    return np.stack([points[:-1], points[1:]], axis=1)


_GAP_M = 0.4
"""Between two pieces."""

_IN_YARDS = ("cafe_table", "scaffold")
_LAMP_HEAD_M = 0.6
_HEAD_AHEAD_M = 1.2  # of a lamp, before its post


class Plot:
    """Free ground around obstacles, and the furniture put on it so far."""

    def __init__(self, obstacles: Obstacles) -> None:
        self.entries: list[MapFurniture] = []
        self._obstacles = obstacles
        self._standing = Discs(np.zeros((0, 2)), np.zeros(0), np.zeros(0, np.int64))

    def put(
        self,
        kind: str,
        stands: Floats,
        choice: Ints | None = None,
        *,
        bulky: bool = False,
        sizes: Floats | None = None,
        obstacles: Obstacles | None = None,
    ) -> None:
        """Put up the pieces of a kind that fit.

        Args:
            kind: name of the kind.
            stands: (N, 3) places x, y (m) and headings (rad).
            choice: (N,) pieces that follow each other with one number are alternatives; None: there are none.
            bulky: pieces hide people who are about to cross.
            sizes: (N, S) m, in the order of the kind's; None: the usual ones.
            obstacles: obstacles for these pieces; None: those of the plot.
        """
        count = len(stands)
        discs, each = self._discs(kind, stands, bulky=bulky, sizes=sizes)
        none = np.full(count, -1)
        fits = self._settle(discs, each, none if choice is None else choice, none, obstacles)
        degrees = np.round(np.degrees(stands[:, 2]), 3)
        for n in np.flatnonzero(fits).tolist():
            own = {} if sizes is None else dict(zip(kinds.KINDS[kind].sizes, sizes[n].tolist(), strict=True))
            self.entries.append(MapFurniture(kind, _rounded(stands[n, :2]), float(degrees[n]), **own))

    def are_free(self, kind: str, ends: Floats, *, bulky: bool) -> Mask:
        """Return the mask (N,) of pieces (N, 2, 2) m of a line that keep off obstacles; furniture is ignored."""
        return are_free(ends.mean(axis=1), 1.1 * _half_m(kind), _layers(kind, bulky=bulky), self._obstacles)

    def put_lines(self, kind: str, ends: Floats, run: Ints, *, bulky: bool = False, back: bool = False) -> None:
        """Put up the pieces of lines that fit: their ends (N, 2, 2) m, and the number (N,) of the line of each.

        With `back` lines lead back: what is on their left, as rails are, then is on the right of the given ones.
        """
        along = ends[:, 1] - ends[:, 0]
        length = exact.hypot(along[:, 0], along[:, 1])
        radius = _half_m(kind)
        each = np.maximum(np.ceil(length / (2 * radius)), 1).astype(np.int64)
        owner, place = numbered(each)
        share = (place + 0.5) / each[owner]
        layers = np.full(len(owner), _layers(kind, bulky=bulky))
        discs = Discs(ends[owner, 0] + share[:, None] * along[owner], np.full(len(owner), 1.1 * radius), layers)
        fits = np.flatnonzero(self._settle(discs, each, np.full(len(ends), -1), run))
        line: list[Point] = []
        for n, after in zip(fits.tolist(), [*fits.tolist(), -1][1:], strict=True):
            line = line or [_rounded(ends[n, 0])]
            line.append(_rounded(ends[n, 1]))
            if after < 0 or run[after] != run[n] or not np.array_equal(ends[after, 0], ends[n, 1]):
                ends_of_line = (0, len(line) - 1)
                straight = tuple(each for k, each in enumerate(line) if k in ends_of_line or not _between(line, k))
                self.entries.append(MapFurniture(kind, along=straight[::-1] if back else straight))
                line = []

    def _settle(self, discs: Discs, each: Ints, choice: Ints, run: Ints, obstacles: Obstacles | None = None) -> Mask:
        candidates = Candidates(discs, np.concatenate([[0], np.cumsum(each)]), choice, run)
        fits, self._standing = settle(candidates, obstacles or self._obstacles, self._standing, _GAP_M)
        return fits

    def _discs(self, kind: str, stands: Floats, *, bulky: bool, sizes: Floats | None) -> tuple[Discs, Ints]:
        """Return the discs that pieces cover, and their number (N,) for each."""
        length, width = kinds.KINDS[kind].ground_m
        longest, shortest = max(length, width), min(length, width)
        count = int(np.ceil(longest / shortest - 1e-6))
        radius = exact.hypot(shortest, longest / count) / 2
        offsets = ((np.arange(count) + 0.5) / count - 0.5) * longest
        local = np.zeros((count, 2))
        local[:, 0 if length > width else 1] = offsets
        radii, layers = np.full(count, radius), np.full(count, _layers(kind, bulky=bulky))
        if kind in ("tree", "lamp"):
            local = np.vstack([local, [[_HEAD_AHEAD_M if kind == "lamp" else 0.0, 0.0]]])
            radii, layers = np.append(radii, _LAMP_HEAD_M), np.append(layers, CROWN)
        cos, sin = exact.cos(stands[:, 2, None]), exact.sin(stands[:, 2, None])
        turned = np.stack([local[:, 0] * cos - local[:, 1] * sin, local[:, 0] * sin + local[:, 1] * cos], axis=-1)
        all_radii = np.tile(radii, (len(stands), 1))
        if kind == "tree" and sizes is not None:
            all_radii[:, -1] = sizes[:, 1] / 2 - 0.2
        middles = (stands[:, None, :2] + turned).reshape(-1, 2)
        return Discs(middles, all_radii.ravel(), np.tile(layers, len(stands))), np.full(len(stands), len(radii))


def _layers(kind: str, *, bulky: bool) -> int:
    """Return the layers that a piece stands in."""
    return GROUND | (BULKY if bulky else 0) | (0 if kind in _IN_YARDS else UNPAVED)


def _half_m(kind: str) -> float:
    """Return half the thickness of a kind along a line, or a little more of thin ones."""
    return max(kinds.KINDS[kind].ground_m[1] / 2, 0.2)


def _rounded(point: Floats) -> Point:
    x, y = np.round(point, 3).tolist()
    return x, y


def _between(line: list[Point], k: int) -> bool:
    """Return whether a point of a line is, to a millimetre, on the straight line between its neighbours."""
    (ax, ay), (bx, by), (cx, cy) = line[k - 1], line[k], line[k + 1]
    return bool(abs((bx - ax) * (cy - ay) - (by - ay) * (cx - ax)) < 1e-3 * exact.hypot(cx - ax, cy - ay))
