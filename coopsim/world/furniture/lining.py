"""Lines the sides of streets, people's ways and fronts of buildings with furniture."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from coopsim.geometry.se3 import Floats
from coopsim.support.rng import stream
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
from coopsim.world.furniture.stations import Side

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

    def rows(self, zone: str, rows: Sequence[Row], sides: Sequence[Side]) -> None:
        """Put up rows along the sides of a zone, "kerb" or "back"; of the latter, pieces look back at the way."""
        for row in rows:
            draws = stream(self._seed, "furnish", zone, row.kind)
            stands = [side.stands(along) for side in sides if len(along := _along(row, side.length_m, draws))]
            if not stands:
                continue
            edge, outward, heading = (np.concatenate(each) for each in zip(*stands, strict=True))
            facing = heading + row.facing_rad + (np.pi / 2 if zone == "back" else 0.0)
            if row.kind in _ANY_WAY:
                facing = draws.uniform(0.0, 2 * np.pi, len(edge))
            sizes = _tree_sizes(zone, len(edge), draws) if row.kind == "tree" else None
            self._put_outward(row, edge, outward, facing, sizes)

    def lines(self, zone: str, lines: Sequence[Line], sides: Sequence[Side]) -> None:
        """Put up runs along the sides of a zone, each at the distance where most of it fits."""
        for line in lines:
            draws = stream(self._seed, "furnish", zone, line.kind)
            runs = list[Floats]()
            for side in sides:
                has, phase = draws.uniform(size=2)
                starts = np.arange((phase - 0.5) * line.every_m, side.length_m, line.every_m)
                ends = starts + draws.uniform(*line.run_m, len(starts))
                spans = np.clip(np.column_stack([starts, ends]), 0.0, side.length_m)
                runs += [self._run(line, side, span) for span in spans if has < line.share]
            runs = [run for run in runs if len(run)]
            if runs:
                number = np.repeat(np.arange(len(runs)), [len(run) for run in runs])
                self._plot.put_lines(line.kind, np.concatenate(runs), number, bulky=line.bulky)

    def crosswalks(self, sides: Sequence[Side], crosswalks: Sequence[Floats]) -> None:
        """Put up signs or traffic lights where streets come to crosswalks."""
        draws = stream(self._seed, "furnish", "crosswalks")
        lit = draws.uniform(size=len(crosswalks)) < CROSSING_LIGHTS
        row = Row("", 0.0, 0.6)
        for side in sides:
            grid = np.arange(0.5, side.length_m, 1.0)
            if not len(grid) or not len(crosswalks):
                continue
            edge, _, heading = side.stands(grid)
            middles = np.array([outline.mean(axis=0) for outline in crosswalks])
            away = middles[:, None] - edge
            nearest = np.hypot(away[..., 0], away[..., 1]).argmin(axis=1)
            away = away[np.arange(len(middles)), nearest]
            ahead = np.column_stack([np.cos(heading), np.sin(heading)])[nearest]
            before = grid[nearest] + (away * ahead).sum(axis=1) - _BEFORE_CROSSWALK_M
            comes = (np.hypot(away[:, 0], away[:, 1]) < _SEEN_M) & (before > 0) & (before < side.length_m + 3.0)
            for kind, chosen in (("traffic_light", comes & lit), ("sign", comes & ~lit)):
                if chosen.any():
                    along = np.minimum(before[chosen], side.length_m - 0.3)
                    spot, outward, direction = side.stands(along)
                    self._put_outward(row._replace(kind=kind), spot, outward, direction + np.pi, None)

    def fronts(self, fronts: Sequence[tuple[Floats, Floats]]) -> None:
        """Put up scaffolds and tables of cafés before the fronts of some buildings."""
        draws = stream(self._seed, "furnish", "fronts")
        number = 0
        for ends, out in fronts:
            kind, length_share, place = draws.uniform(size=3).tolist()
            length = float(np.hypot(*(ends[1] - ends[0])))
            along = (ends[1] - ends[0]) / length
            if kind < SCAFFOLDS:
                run = min(_SCAFFOLD_RUN_M[0] + length_share * np.ptp(_SCAFFOLD_RUN_M), length - 0.5)
                steps = np.arange(int(run // KINDS["scaffold"].step_m), -1, -1) * KINDS["scaffold"].step_m
                points = ends[0] + _SCAFFOLD_OUT_M * out + (place * (length - run) + steps)[:, None] * along
                self._plot.put_lines("scaffold", _pairs(points), np.full(len(points) - 1, number))
                number += 1
            elif kind < SCAFFOLDS + CAFES:
                spots = place * max(length - _TABLES * _TABLE_M, 0.0) + _TABLE_M * (np.arange(_TABLES) + 0.5)
                points = ends[0] + _TABLE_OUT_M * out + spots[spots < length - 1.0, None] * along
                heading = np.full(len(points), np.arctan2(along[1], along[0]))
                self._plot.put("cafe_table", np.column_stack([points, heading]))

    def _put_outward(self, row: Row, edge: Floats, outward: Floats, facing: Floats, sizes: Floats | None) -> None:
        """Put up pieces at the first place outward from their edge where they fit, if any."""
        steps = len(_STEPS_M)
        places = edge[:, None] + (row.first_m + _STEPS_M)[:, None] * outward[:, None]
        wished = np.concatenate([places, np.broadcast_to(facing[:, None, None], (len(edge), steps, 1))], axis=2)
        choice = np.repeat(np.arange(len(edge)), steps)
        each = None if sizes is None else np.repeat(sizes, steps, axis=0)
        self._plot.put(row.kind, wished.reshape(-1, 3), choice, bulky=row.bulky, sizes=each)

    def _run(self, line: Line, side: Side, span_m: Floats) -> Floats:
        """Return pieces (N, 2, 2) m of a run along a side."""
        step_m = KINDS[line.kind].step_m
        count = int((span_m[1] - span_m[0]) // step_m)
        edge, outward, _ = side.stands(span_m[0] + step_m * np.arange(count + 1))
        tried = [_pairs(edge + (line.first_m + step) * outward) for step in _LINE_STEPS_M]
        free = [self._plot.count_free(line.kind, pieces, bulky=line.bulky) for pieces in tried]
        return tried[int(np.argmax(free))]


def _along(row: Row, length_m: float, draws: np.random.Generator) -> Floats:
    """Return places (N,) m of a row on a side of some length."""
    has, phase = draws.uniform(size=2)
    along = np.arange(phase * row.every_m, length_m, row.every_m)
    along = along + row.jitter * row.every_m * draws.uniform(-1.0, 1.0, len(along))
    group = (np.arange(row.group) - (row.group - 1) / 2) * row.apart_m
    along = (along[:, None] + group).ravel()
    kept: Floats = along[(along > 0.5) & (along < length_m - 0.5) & (has < row.share)]
    return kept


def _tree_sizes(zone: str, count: int, draws: np.random.Generator) -> Floats:
    """Draw heights, widths of crowns and heights of stems (N, 3) m."""
    sizes = np.array(TREE_SIZES_M)[draws.integers(len(TREE_SIZES_M), size=count)]
    return np.column_stack([sizes, np.full(count, STREET_STEM_M if zone == "kerb" else YARD_STEM_M)])


def _pairs(points: Floats) -> Floats:
    """Return the pieces (N, 2, 2) of a line through points (N + 1, 2)."""
    return np.stack([points[:-1], points[1:]], axis=1)
