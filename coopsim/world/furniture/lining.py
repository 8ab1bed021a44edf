"""Lines the sides of streets, people's ways and fronts of buildings with furniture."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from coopsim.geometry import exact
from coopsim.geometry.se3 import Floats
from coopsim.support.rng import stream
from coopsim.types import Ints
from coopsim.world.furniture.densities import (
    CAFES,
    CROSSING_LIGHTS,
    SCAFFOLDS,
    STREET_STEM_M,
    TREE_SIZES_M,
    YARD_STEM_M,
    Line,
    Row,
)
from coopsim.world.furniture.kinds import KINDS
from coopsim.world.furniture.plot import Plot
from coopsim.world.furniture.stations import Sides

_STEPS_M = 0.5 * np.arange(8)
"""How far a piece is moved outward until it fits."""

_LINE_STEPS_M = 0.5 * np.arange(6)
_BEFORE_CROSSWALK_M = 2.9
_SEEN_M = 8.0  # from the edge of a lane to the middle of a crosswalk over it
_TABLE_M, _TABLES, _TABLE_OUT_M = 2.6, 4, 1.4
_SCAFFOLD_RUN_M, _SCAFFOLD_OUT_M = (7.5, 15.0), 0.85
_ANY_WAY = ("tree", "bush", "heap")
"""Kinds without a front."""


class Lining:
    """Draws where furniture is wished for, and puts up what fits; each kind in each zone has draws of its own.

    Args:
        seed: of all draws.
        plot: where furniture is put up.
    """

    def __init__(self, seed: int, plot: Plot) -> None:
        self._seed, self._plot = seed, plot

    def rows(self, zone: str, rows: Sequence[Row], sides: Sides) -> None:
        """Put up rows along the sides of a zone, "kerb" or "back"; of the latter, pieces look back at the way."""
        for row in rows:
            draws = stream(self._seed, "furnish", zone, row.kind)
            along = _along(row, sides, draws)
            if not len(along):
                continue
            edge, outward, heading = sides.stands(along)
            facing = heading + row.facing_rad + (np.pi / 2 if zone == "back" else 0.0)
            if row.kind in _ANY_WAY:
                facing = draws.uniform(0.0, 2 * np.pi, len(edge))
            sizes = _tree_sizes(zone, len(edge), draws) if row.kind == "tree" else None
            self._put_outward(row, edge, outward, facing, sizes)

    def lines(self, zone: str, lines: Sequence[Line], sides: Sides) -> None:
        """Put up runs along the sides of a zone, each at the distance where most of it fits."""
        for line in lines:
            draws = stream(self._seed, "furnish", zone, line.kind)
            start, side = _series(line.every_m, line.share, sides, draws)
            length = draws.uniform(*line.run_m, len(start))
            count = np.minimum(length, sides.first_m[side + 1] - start) // KINDS[line.kind].step_m
            kept = count >= 1
            if kept.any():
                pieces, run = self._runs(line, sides, start[kept], count[kept].astype(np.int64))
                self._plot.put_lines(line.kind, pieces, run, bulky=line.bulky)

    def crosswalks(self, sides: Sides, crosswalks: Sequence[Floats]) -> None:
        """Put up signs or traffic lights where streets come to crosswalks."""
        draws = stream(self._seed, "furnish", "crosswalks")
        lit = draws.uniform(size=len(crosswalks)) < CROSSING_LIGHTS
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
                self._put_outward(Row(kind, 0.0, 0.6), spot, outward, direction + np.pi, None)

    def fronts(self, ends: Floats, out: Floats) -> None:
        """Put up scaffolds and tables of cafés before some fronts, of ends (N, 2, 2) m and unit vectors (N, 2)."""
        draws = stream(self._seed, "furnish", "fronts").uniform(size=(len(ends), 3))
        for number in np.flatnonzero(draws[:, 0] < SCAFFOLDS + CAFES).tolist():
            kind, long, place = draws[number].tolist()
            start, out_here = ends[number, 0], out[number]
            length = float(exact.hypot(*(ends[number, 1] - start)))
            along = (ends[number, 1] - start) / length
            if kind < SCAFFOLDS:
                step = KINDS["scaffold"].step_m
                run = min(_SCAFFOLD_RUN_M[0] + long * (_SCAFFOLD_RUN_M[1] - _SCAFFOLD_RUN_M[0]), length - 0.5)
                steps = np.arange(int(run // step), -1, -1) * step  # its rails are outward, on the left
                points = start + _SCAFFOLD_OUT_M * out_here + (place * (length - run) + steps)[:, None] * along
                self._plot.put_lines("scaffold", _pairs(points), np.full(len(points) - 1, number))
            else:
                spots = place * max(length - _TABLES * _TABLE_M, 0.0) + _TABLE_M * (np.arange(_TABLES) + 0.5)
                points = start + _TABLE_OUT_M * out_here + spots[spots < length - 1.0, None] * along
                heading = np.full(len(points), exact.arctan2(along[1], along[0]))
                self._plot.put("cafe_table", np.column_stack([points, heading]))

    def _put_outward(self, row: Row, edge: Floats, outward: Floats, facing: Floats, sizes: Floats | None) -> None:
        """Put up pieces at the first place outward from their edge where they fit, if any."""
        steps = len(_STEPS_M)
        places = edge[:, None] + (row.first_m + _STEPS_M)[:, None] * outward[:, None]
        wished = np.concatenate([places, np.broadcast_to(facing[:, None, None], (len(edge), steps, 1))], axis=2)
        choice = np.repeat(np.arange(len(edge)), steps)
        each = None if sizes is None else np.repeat(sizes, steps, axis=0)
        self._plot.put(row.kind, wished.reshape(-1, 3), choice, bulky=row.bulky, sizes=each)

    def _runs(self, line: Line, sides: Sides, start_m: Floats, count: Ints) -> tuple[Floats, Ints]:
        """Return pieces (N, 2, 2) m of R runs, and their run (N,), each moved outward to where most of it is free.

        Args:
            line: their kind.
            sides: along which they are.
            start_m: (R,) distances where they begin.
            count: (R,) numbers of pieces.
        """
        run = np.repeat(np.arange(len(count)), count)
        place = np.arange(len(run)) - np.repeat(np.cumsum(count) - count, count)
        step_m = KINDS[line.kind].step_m
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
    side = np.repeat(np.arange(len(counts)), counts)
    place = np.arange(len(side)) - np.repeat(np.cumsum(counts) - counts, counts)
    return sides.first_m[side] + (phase[side] + place) * every_m, side


def _along(row: Row, sides: Sides, draws: np.random.Generator) -> Floats:
    """Return distances (N,) of a row's pieces on all sides."""
    along, side = _series(row.every_m, row.share, sides, draws)
    along = along + row.jitter * row.every_m * draws.uniform(-1.0, 1.0, len(along))
    group = (np.arange(row.group) - (row.group - 1) / 2) * row.apart_m
    along, side = (along[:, None] + group).ravel(), np.repeat(side, row.group)
    kept: Floats = along[(along > sides.first_m[side] + 0.5) & (along < sides.first_m[side + 1] - 0.5)]
    return kept


def _tree_sizes(zone: str, count: int, draws: np.random.Generator) -> Floats:
    """Draw heights, widths of crowns and heights of stems (N, 3) m."""
    sizes = np.array(TREE_SIZES_M)[draws.integers(len(TREE_SIZES_M), size=count)]
    return np.column_stack([sizes, np.full(count, STREET_STEM_M if zone == "kerb" else YARD_STEM_M)])


def _pairs(points: Floats) -> Floats:
    """Return the pieces (N, 2, 2) of a line through points (N + 1, 2)."""
    return np.stack([points[:-1], points[1:]], axis=1)
