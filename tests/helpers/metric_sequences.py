"""Sequences to compare metrics on, and the same sequences as TrackEval and motmetrics want them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import motmetrics
import numpy as np

from coopsim.geometry.boxes import Boxes3D
from coopsim.geometry.iou import iou_3d
from coopsim.geometry.se3 import Floats
from coopsim.metrics.evaluator import Evaluator
from coopsim.metrics.track_log import TrackLog
from coopsim.types import GroundTruth, Tracks


@dataclass(frozen=True)
class Frame:
    """What was there, and what was reported."""

    truth: GroundTruth
    tracks: Tracks

    @property
    def one_sided(self) -> bool:
        """Either is empty."""
        return not (len(self.truth) and len(self.tracks))

    def same_class(self) -> Floats:
        """(N, M) 1 for pairs of one class, else 0."""
        return (self.truth.label[:, None] == self.tracks.label).astype(float)

    def overlap(self) -> Floats:
        """(N, M) 3D IoU of pairs of one class, else 0."""
        return iou_3d(self.truth.boxes.array, self.tracks.boxes.array) * self.same_class()

    def distance(self) -> Floats:
        """(N, M) m between centres on the ground."""
        return np.linalg.norm(self.truth.boxes.center[:, None, :2] - self.tracks.boxes.center[None, :, :2], axis=2)

    def nearness(self) -> Floats:
        """(N, M) TrackEval's similarity by distance, which reaches 2 m."""
        return np.maximum(0, 1 - self.distance() / 2) * self.same_class()


def generate(
    seed: int, *, frames: int = 40, objects: int = 9, gap_m: float = 2.5, absences: float = 0.1, empty: float = 0.0
) -> list[Frame]:
    """Objects of three classes in a row, `gap_m` apart; tracks that miss, switch, double and appear from nowhere.

    Args:
        seed: decides everything.
        frames: how many.
        objects: how many.
        gap_m: small enough, and tracks reach several objects.
        absences: how often an object is not there.
        empty: how often nothing is there, and how often nothing is reported.
    """
    rng = np.random.default_rng(seed)
    place = np.arange(objects) * gap_m
    label = rng.choice([0, 1, 7], objects)
    name = np.arange(objects) + 100
    sequence = []
    for _ in range(frames):
        place = place + rng.normal(0, 0.3, objects)
        renamed = rng.random(objects) < 0.05
        name[renamed] = rng.integers(1000, 10**6, renamed.sum())
        a, b = rng.choice(objects, 2, replace=False)
        if rng.random() < 0.1:
            name[[a, b]] = name[[b, a]]
        there = (rng.random(objects) >= absences) & (rng.random() >= empty)
        seen = (rng.random(objects) > 0.15) & (rng.random() >= empty)
        false = rng.integers(0, 4) if seen.any() else 0
        x = np.concatenate([place[seen] + rng.normal(0, 0.4, seen.sum()), rng.uniform(-5, objects * gap_m + 5, false)])
        ids = np.concatenate([name[seen], rng.integers(10**6, 10**9, false)])
        labels = np.concatenate([label[seen], rng.choice([0, 1, 7], false)])
        truth = GroundTruth(np.flatnonzero(there), _boxes(rng, place[there], 0.0), label[there])
        tracks = Tracks(ids, _boxes(rng, x, 0.1), np.zeros((len(x), 2)), rng.random(len(x)), labels)
        sequence.append(Frame(truth, tracks))
    return sequence


def evaluate(sequence: list[Frame], match_iou: float = 0.25) -> TrackLog:
    """The log of a sequence."""
    evaluator = Evaluator(match_iou)
    for frame in sequence:
        evaluator.update(frame.truth, frame.tracks)
    return evaluator.log


def for_trackeval(sequence: list[Frame], similarity: str = "overlap") -> dict[str, Any]:
    """A sequence as TrackEval's metrics take it, with `Frame.overlap` or `Frame.nearness`."""
    data: dict[str, Any] = {
        "similarity_scores": [getattr(frame, similarity)() for frame in sequence],
        "num_timesteps": len(sequence),
    }
    for side, ids in (
        ("gt", [frame.truth.id for frame in sequence]),
        ("tracker", [frame.tracks.id for frame in sequence]),
    ):
        known = np.unique(np.concatenate(ids))
        data[f"{side}_ids"] = [np.searchsorted(known, each) for each in ids]
        data[f"num_{side}_ids"] = len(known)
        data[f"num_{side}_dets"] = sum(map(len, ids))
    return data


def for_motmetrics(sequence: list[Frame], match_iou: float = 0.25) -> motmetrics.MOTAccumulator:
    """A sequence as motmetrics takes it, with 1 - IoU as the distance."""
    accumulator = motmetrics.MOTAccumulator(auto_id=True)
    for frame in sequence:
        overlap = frame.overlap()
        accumulator.update(frame.truth.id, frame.tracks.id, np.where(overlap >= match_iou, 1 - overlap, np.nan))
    return accumulator


def without_rivals(sequence: list[Frame], least: float, similarity: str = "overlap") -> list[Frame]:
    """Only tracks that reach at most one object, and of those that reach the same, the best."""
    kept = []
    for frame in sequence:
        value = getattr(frame, similarity)()
        reaches = (value >= least) & (value > 0)
        alone = reaches.sum(axis=0) <= 1
        best = np.where(reaches & alone, value, 0)
        first = (best == best.max(axis=1, initial=0)[:, None]) & reaches
        kept.append(Frame(frame.truth, frame.tracks[alone & (first.any(axis=0) | ~reaches.any(axis=0))]))
    return kept


def on_a_line(frames: list[tuple[dict[int, float], dict[int, float]]]) -> list[Frame]:
    """Frames written by hand: cars by id with their place in m, and tracks alike."""
    return [
        Frame(
            GroundTruth(np.array(list(truth), dtype=int), _line(truth), np.zeros(len(truth), dtype=int)),
            Tracks(
                np.array(list(tracks), dtype=int),
                _line(tracks),
                np.zeros((len(tracks), 2)),
                np.ones(len(tracks)),
                np.zeros(len(tracks), dtype=int),
            ),
        )
        for truth, tracks in frames
    ]


def _line(places: dict[int, float]) -> Boxes3D:
    return Boxes3D.from_array(np.array([[x, 0, 0, 4, 2, 1.5, 0] for x in places.values()]).reshape(-1, 7))


def _boxes(rng: np.random.Generator, x: Floats, spread: float) -> Boxes3D:
    """Boxes of a car's size at x; they differ by `spread` across, in size and in heading."""
    mean = np.column_stack([x, np.zeros((len(x), 2)), np.tile([4.0, 2.0, 1.5, 0.0], (len(x), 1))])
    return Boxes3D.from_array(mean + spread * rng.normal(size=mean.shape) * [0, 1, 1, 1, 1, 1, 1])
