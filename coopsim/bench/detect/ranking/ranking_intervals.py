"""Intervals of areas: episodes drawn anew with replacement, as a set of other places and seeds would have come out."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from coopsim.bench.detect.ranking.ranking import Ranking
from coopsim.geometry.se3 import Floats
from coopsim.metrics.average_precision import ends_of_steps
from coopsim.support.rng import stream

LEAST_EPISODES = 3
"""Fewer say nothing about others."""

DRAWS = 200
_QUANTILES = (0.025, 0.975)


def area_interval(parts: Sequence[Ranking], *, pooled: bool = True) -> tuple[float, float] | None:
    """Return the 95 % interval of an area of all points by the percentile bootstrap over episodes (Efron 1979).

    With less than ten episodes such intervals are too short (Hesterberg 2015): they say how places and seeds differ,
    and prove nothing.

    Args:
        parts: the ranking of each episode.
        pooled: all frames are ranked together, as in `Ranking.area`; else as in `Ranking.area_by_frame`.

    Returns:
        Low and high end; None for fewer than `LEAST_EPISODES` with objects.
    """
    known = [part for part in parts if part.objects]
    if len(known) < LEAST_EPISODES:
        return None
    low, high = np.quantile(_drawn_areas(known, pooled=pooled), _QUANTILES)
    return float(low), float(high)


def _drawn_areas(parts: Sequence[Ranking], *, pooled: bool) -> Floats:
    """Return the areas (DRAWS,) of draws. An episode drawn twice counts twice at each of its detections."""
    draws = stream(0, "detection intervals", str(len(parts)))
    times = draws.multinomial(len(parts), np.full(len(parts), 1 / len(parts)), size=DRAWS).astype(np.float64)
    whole = Ranking.joined(parts)
    order = np.argsort(-whole.score, kind="stable") if pooled else np.arange(len(whole.score))
    episode = np.repeat(np.arange(len(parts)), [len(part.score) for part in parts])[order]
    hit = whole.hit[order]
    last = ends_of_steps(whole.score[order]) if pooled else order
    objects = times @ np.array([part.objects for part in parts], np.float64)
    areas = np.zeros(DRAWS)
    for draw in range(DRAWS):
        weight = times[draw, episode]
        hits = weight * hit
        precision = np.cumsum(hits)[last] / np.maximum(np.cumsum(weight)[last], 1.0)
        best_from_here = np.maximum.accumulate(precision[::-1])[::-1]
        areas[draw] = float(hits @ best_from_here) / objects[draw]
    return areas
