"""Ranked hits and misses of detections: matchings, areas, recalls, rates, and intervals of areas over episodes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from coopsim.bench.detect.perceived import Perceived
from coopsim.geometry.iou import iou_3d_and_bev
from coopsim.geometry.se3 import Floats
from coopsim.metrics.average_precision import area_of_all_points, ends_of_steps, match_by_score, order_by_score
from coopsim.metrics.matching import SequenceArrays, frame_of
from coopsim.support.kernels import njit
from coopsim.support.rng import stream
from coopsim.types import Ints, Mask

SURE = 0.3
"""Score above which a detection is believed, where a recall or a rate of false boxes is counted."""

_RECALLS = np.linspace(0.0, 1.0, 101)


@dataclass(frozen=True, slots=True, eq=False)
class Ranking:
    """The K detections that count in a metric, frame by frame, and within each by falling score.

    Attributes:
        score: (K,).
        hit: (K,) mask of the detections on an object.
        objects: number of objects to be found.
        frames: number of frames of receivers.
    """

    score: Floats
    hit: Mask
    objects: int
    frames: int

    @classmethod
    def of(cls, found_start: Ints, score: Floats, hit: Mask, kept: Mask, objects: int) -> Ranking:
        """Rank the detections `kept` (N,) of frames that begin at the rows `found_start` (R + 1,)."""
        frame = np.repeat(np.arange(len(found_start) - 1), np.diff(found_start))
        order = np.lexsort((-score, frame))
        order = order[kept[order]]
        return cls(score[order], hit[order], objects, len(found_start) - 1)

    @classmethod
    def joined(cls, parts: Sequence[Ranking]) -> Ranking:
        """Join the rankings of several episodes."""
        return cls(
            np.concatenate([np.zeros(0), *(part.score for part in parts)]),
            np.concatenate([np.zeros(0, np.bool_), *(part.hit for part in parts)]),
            sum(part.objects for part in parts),
            sum(part.frames for part in parts),
        )

    @property
    def pooled(self) -> Mask:
        """The hits (K,) by falling score over all frames; equal scores stay in the order in which they are listed."""
        ranked: Mask = self.hit[np.argsort(-self.score, kind="stable")]
        return ranked

    def area(self) -> float:
        """Compute the area of all points under precision over recall, frames ranked together; NaN without objects.

        Equal scores are one step of the curve.
        """
        return area_of_all_points(self.hit, self.objects, self.score) if self.objects else np.nan

    def area_by_frame(self) -> float:
        """Compute the area with frames ranked one after another, each by its own scores: OpenCOOD's default."""
        return area_of_all_points(self.hit, self.objects) if self.objects else np.nan

    def area_without_first_step(self) -> float:
        """Compute the area without the step of the very first detection: DAIR-V2X sums from the second one on.

        Each detection is a step, and equal ones stay in the order in which they are listed, as in its code.
        """
        if not self.objects:
            return np.nan
        ranked = self.pooled
        # A first hit has precision 1, the best that there is, so its step is 1 / objects high.
        return area_of_all_points(ranked, self.objects) - float(ranked[:1].sum()) / self.objects

    def area_of_101_points(self, least_recall: float = 0.1, least_precision: float = 0.1) -> float:
        """Compute nuScenes' area: mean precision at recalls beyond the least, in steps of 0.01.

        Precision above the least is scaled to [0, 1]. Recalls that are not reached have precision 0.
        """
        if not self.objects:
            return np.nan
        true = np.cumsum(self.pooled)
        if not len(true) or not true[-1]:
            return 0.0
        precision, recall = true / np.arange(1, len(true) + 1), true / self.objects
        at_recalls = np.interp(_RECALLS, recall, precision, right=0)[round(100 * least_recall) + 1 :]
        return min(1.0, float(np.mean(np.maximum(at_recalls - least_precision, 0.0)) / (1.0 - least_precision)))

    def recall(self, least_score: float = SURE) -> float:
        """Return the share of the objects with a detection above a score; NaN without objects."""
        return float(np.count_nonzero(self.hit[self.score > least_score])) / self.objects if self.objects else np.nan

    def share(self, least_score: float = SURE) -> float:
        """Return the share of hits among detections above a score; NaN without any."""
        sure = self.hit[self.score > least_score]
        return float(np.count_nonzero(sure)) / len(sure) if len(sure) else np.nan

    def false_per_frame(self, least_score: float = SURE) -> float:
        """Return the number of detections above a score that are on no object, in a frame of a receiver."""
        return float(np.count_nonzero(~self.hit[self.score > least_score])) / max(self.frames, 1)


LEAST_EPISODES = 3
"""Fewer say nothing about others."""

DRAWS = 200
_QUANTILES = (0.025, 0.975)


def area_interval(parts: Sequence[Ranking], *, pooled: bool = True) -> tuple[float, float] | None:
    """Return the 95 % interval of an area of all points by the percentile bootstrap over episodes (Efron 1979).

    With less than ten episodes such intervals are too short (Hesterberg 2015): they say how places and seeds differ,
    and prove nothing. None for fewer than `LEAST_EPISODES` with objects.

    Args:
        parts: ranking of each episode.
        pooled: rank all frames together, as in `Ranking.area`; else as in `Ranking.area_by_frame`.
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


FARTHEST_PAIR_M = 4.0
"""Largest distance of centres over ground at which a pair is kept: nuScenes' largest threshold."""

View = Literal["3D", "BEV"]


@dataclass(frozen=True, slots=True, eq=False)
class Overlaps:
    """The P pairs of an episode whose boxes overlap or whose centres are near, frame by frame.

    Attributes:
        perceived: the episode.
        frame: (P,).
        truth: (P,) row among all objects.
        found: (P,) row among all detections.
        similarity: IoU (P,) by view; under "distance" the negative distance of the centres over ground, m.
    """

    perceived: Perceived
    frame: Ints
    truth: Ints
    found: Ints
    similarity: dict[str, Floats]

    @classmethod
    def of(cls, perceived: Perceived) -> Overlaps:
        """Compute all pairs of an episode."""
        parts = [_pairs_of_frame(perceived, frame) for frame in range(perceived.receiver_frames)]
        none, nothing = np.zeros(0, np.int64), np.zeros(0)
        frame, truth, found, solid, flat, away_m = (
            np.concatenate([empty, *(part[k] for part in parts)])
            for k, empty in enumerate((none, none, none, nothing, nothing, nothing))
        )
        return cls(perceived, frame, truth, found, {"3D": solid, "BEV": flat, "distance": -away_m})

    def matched_by_score(self, found: Mask, truth: Mask, by: str, least: float, *, listed: bool = True) -> Ints:
        """Match detections by falling score within each frame, each to the free object of largest similarity.

        Args:
            found: (N,) the detections that take part.
            truth: (M,) the objects that take part.
            by: "3D", "BEV" or "distance", see `similarity`.
            least: smallest similarity of a match.
            listed: take equal scores in the order of the list, as the code of other benchmarks does; else by their IoU.

        Returns:
            (N,) row of each detection's object, or -1.
        """
        score, sequence = self.perceived.found_score, self._sequence(self._kept(found, truth, by, least), by)
        in_list = np.lexsort((-score, frame_of(sequence.track_start)))
        return match_by_score(sequence, in_list if listed else order_by_score(sequence, score))

    def matched_by_object(self, found: Mask, truth: Mask, by: str, least: float) -> Ints:
        """Match objects in order, each with the free detection of largest similarity, whatever its score.

        The lowest of equal scores wins, as in DAIR-V2X's code. Arguments and result are those of `matched_by_score`.
        """
        there, kept = self.perceived, self._kept(found, truth, by, least)
        pairs = np.flatnonzero(kept)
        ordered = pairs[
            np.lexsort((there.found_score[self.found[pairs]], -self.similarity[by][pairs], self.truth[pairs]))
        ]
        return _match_objects(self.truth[ordered], self.found[ordered], len(there.found_score))

    def best_on(self, truth: Mask, by: str) -> Floats:
        """Return (N,) the largest similarity that each detection has with any of the objects (M,); 0 with none."""
        best = np.zeros(len(self.perceived.found_score))
        kept = truth[self.truth]
        np.maximum.at(best, self.found[kept], self.similarity[by][kept])
        return best

    def _kept(self, found: Mask, truth: Mask, by: str, least: float) -> Mask:
        return found[self.found] & truth[self.truth] & (self.similarity[by] >= least)

    def _sequence(self, kept: Mask, by: str) -> SequenceArrays:
        there, frame = self.perceived, self.frame[kept]
        return SequenceArrays(
            there.true_start,
            np.arange(len(there.true_label)),
            there.found_start,
            np.arange(len(there.found_label)),
            np.searchsorted(frame, np.arange(there.receiver_frames + 1)),
            self.truth[kept] - there.true_start[frame],
            self.found[kept] - there.found_start[frame],
            self.similarity[by][kept],
        )


def _pairs_of_frame(there: Perceived, frame: int) -> tuple[Ints, Ints, Ints, Floats, Floats, Floats]:
    first_truth, end_truth = there.true_start[frame], there.true_start[frame + 1]
    first_found, end_found = there.found_start[frame], there.found_start[frame + 1]
    truth, found = there.true_box[first_truth:end_truth], there.found_box[first_found:end_found]
    solid, flat = iou_3d_and_bev(truth, found)
    away_m = np.hypot(truth[:, None, 0] - found[None, :, 0], truth[:, None, 1] - found[None, :, 1])
    rows, columns = np.nonzero((flat > 0) | (away_m <= FARTHEST_PAIR_M))
    of_pairs = solid[rows, columns], flat[rows, columns], away_m[rows, columns]
    return np.full(len(rows), frame), first_truth + rows, first_found + columns, *of_pairs


@njit(cache=True, nogil=True)
def _match_objects(truth: Ints, found: Ints, count: int) -> Ints:
    """Take pairs (P,) in order, each if both of its sides are free. Return the object (N,) of each detection, or -1."""
    object_of = np.full(count, -1)
    last = -1
    for p in range(len(truth)):
        if truth[p] != last and object_of[found[p]] < 0:
            object_of[found[p]] = last = truth[p]
    return object_of
