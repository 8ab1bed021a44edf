"""The worst moments: windows in which a policy fell farthest behind the best one in the same traffic."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import islice
from typing import Any

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from coopsim.bench.films.choice import Films, telling
from coopsim.bench.films.film import Film
from coopsim.bench.grid.cell import CellResult
from coopsim.bench.results.result_table import ResultTable
from coopsim.geometry.se3 import Floats

WINDOW_FRAMES = 25
LEAST_GAP = 0.05
"""Gap in mean reward from which a window is a worst moment."""


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


@dataclass(frozen=True, slots=True, eq=False)
class FilmedMoment:
    """A moment with its films, and the agent whose tracks are shown."""

    moment: Moment
    agent: str
    worst: Film
    best: Film


def filmed_moments(moments: Sequence[Moment], films: Films) -> list[FilmedMoment]:
    """Return the moments whose films can be read."""
    found = []
    for moment in moments:
        if (both := films.of(moment.worst, moment.best)) is None:
            continue
        present = list(both[0].frames[moment.first].agents)
        agent = moment.agent if moment.agent in present else present[0]
        found.append(FilmedMoment(moment, str(agent), *both))
    return found


def worst_windows(table: ResultTable, count: int, window_frames: int = WINDOW_FRAMES) -> tuple[Moment, ...]:
    """Choose at most `count` windows, the worst first, varied in policy, condition and traffic.

    The widest gap is taken first; windows of the same policy, of the same condition, or of the same traffic at the same
    time then count half.
    """
    rewards, runs = _rewards(table)
    length = min(window_frames, rewards.shape[3])
    rewards[[policy in table.bounds for policy in table.policies]] = np.nan
    means = rewards.mean(axis=3)
    best = np.where(np.isnan(means), -np.inf, means).argmax(axis=0)
    leading = np.take_along_axis(rewards, best[None, :, :, None], axis=0)
    gaps = sliding_window_view(leading - rewards, length, axis=3).mean(axis=4)
    scenarios = np.array([each.scenario for each in table.conditions])

    def alike(place: tuple[int, ...]) -> tuple[Any, list[Any]]:
        policy, condition, seed, first = place
        near, same_traffic = slice(max(0, first - length + 1), first + length), scenarios == scenarios[condition]
        return (policy, condition, seed, near), [np.s_[policy], np.s_[:, condition], np.s_[:, same_traffic, seed, near]]

    moments = []
    for place in islice(telling(np.where(gaps >= LEAST_GAP, gaps, 0.0), alike), count):
        policy, condition, seed, first = place
        leader = runs[int(best[condition, seed]), condition, seed]
        moments.append(Moment(runs[policy, condition, seed], leader, first, first + length, float(gaps[place])))
    return tuple(moments)


def _rewards(table: ResultTable) -> tuple[Floats, dict[tuple[int, int, int], CellResult]]:
    """Return rewards (P, C, S, F), NaN for runs that failed, lack or ended early, and the runs by place."""
    frames = table.frames or max((len(result.rewards) for result in table.results), default=0)
    rewards = np.full((*table.finished.shape, frames), np.nan)
    runs = {}
    for result, place in zip(table.results, table.places, strict=True):
        if not result.failed and len(result.rewards) == frames:
            rewards[place], runs[place] = result.rewards, result
    return rewards, runs
