"""The worst moments of policies: windows in which one fell far behind the best of the same condition and seed."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from coopsim.bench.grid.cell import CellResult
from coopsim.bench.results.result_table import ResultTable
from coopsim.geometry.se3 import Floats
from coopsim.support.checks import require_count

WINDOW_FRAMES = 25
LEAST_GAP = 0.05
"""Gap in mean reward from which a window is a worst moment."""

_REPEATED = 0.5
"""Weight of a window whose policy, condition or traffic was chosen before, once for each."""


@dataclass(frozen=True, slots=True, eq=False)
class Moment:
    """A window of two runs in the same traffic.

    Attributes:
        worst: the run that fell behind.
        best: the run with the highest mean reward of that condition and seed.
        first: first frame of the window.
        last: first frame after the window.
        gap: mean reward of the best run in the window, minus that of the worst.
    """

    worst: CellResult
    best: CellResult
    first: int
    last: int
    gap: float

    @property
    def agent(self) -> str | None:
        """The agent whose MOTA differs most between the runs; None if the results name no agent."""
        gaps = {
            name: self.best.agents[name].get("MOTA", np.nan) - values.get("MOTA", np.nan)
            for name, values in self.worst.agents.items()
            if name in self.best.agents
        }
        known = {name: -np.inf if np.isnan(gap) else gap for name, gap in gaps.items()}
        return max(sorted(known), key=known.__getitem__) if known else None


def worst_moments(table: ResultTable, count: int, window_frames: int = WINDOW_FRAMES) -> tuple[Moment, ...]:
    """Choose at most `count` windows, the worst first, varied in policy, condition and traffic.

    The widest gap is taken first; windows of the same policy, of the same condition, or of the same traffic at the same
    time then count half.

    Raises:
        InvalidValueError: a number is not accepted.
    """
    require_count(0, count=count)
    require_count(1, window_frames=window_frames)
    length = min(window_frames, table.frames)
    rewards, runs = _rewards(table)
    means = rewards.mean(axis=3)
    best = np.where(np.isnan(means), -np.inf, means).argmax(axis=0)
    leading = np.take_along_axis(rewards, best[None, :, :, None], axis=0)
    gaps = sliding_window_view(leading - rewards, length, axis=3).mean(axis=4)
    weights = np.nan_to_num(gaps, nan=-1.0)
    weights[gaps < LEAST_GAP] = -1.0
    moments: list[Moment] = []
    while len(moments) < count and weights.max(initial=-1.0) > 0:
        policy, condition, seed, first = (int(k) for k in np.unravel_index(weights.argmax(), weights.shape))
        gap = float(gaps[policy, condition, seed, first])
        leader = int(best[condition, seed])
        moments.append(Moment(runs[policy, condition, seed], runs[leader, condition, seed], first, first + length, gap))
        near = slice(max(0, first - length + 1), first + length)
        same_traffic = [each.scenario == table.conditions[condition].scenario for each in table.conditions]
        weights[policy, condition, seed, near] = -1.0
        for chosen in (np.s_[policy], np.s_[:, condition], np.s_[:, np.array(same_traffic), seed, near]):
            weights[chosen] *= _REPEATED
    return tuple(moments)


def _rewards(table: ResultTable) -> tuple[Floats, dict[tuple[int, int, int], CellResult]]:
    """Return rewards (P, C, S, F), NaN for runs that failed or are missing, and the runs by their place in it."""
    rewards = np.full((*table.finished.shape, table.frames), np.nan)
    runs = {}
    for result, place in zip(table.results, table.places, strict=True):
        if not result.failed and len(result.rewards) == table.frames:
            rewards[place], runs[place] = result.rewards, result
    return rewards, runs
