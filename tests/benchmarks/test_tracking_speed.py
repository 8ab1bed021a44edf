"""How fast tracking and scoring are: rotated overlap, and real recordings from detections to the score.

Run by `make bench`. Nothing here fails by time; the figures are printed.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import psutil
import pytest
from filterpy.kalman import KalmanFilter
from shapely import Polygon
from shapely import box as shapely_box
from shapely.affinity import rotate

import coopsim
from coopsim.data.recording_set import Recording, RecordingSet
from coopsim.geometry.assignment import greedy, hungarian
from coopsim.geometry.boxes import Boxes3D
from coopsim.geometry.iou import giou_3d, giou_bev, iou_3d, iou_3d_and_bev, iou_bev
from coopsim.metrics.evaluator import Evaluator
from coopsim.metrics.score import summarize
from coopsim.metrics.track_log import TrackLog
from coopsim.tracking.ab3dmot_tracker import ab3dmot
from coopsim.types import Detections, Tracks

FRAME_NS = 100_000_000


def median_ms(call: Callable[[], Any], repeats: int = 20) -> float:
    call()  # compiles
    spent = []
    for _ in range(repeats):
        began = time.perf_counter()
        call()
        spent.append(time.perf_counter() - began)
    return 1000 * float(np.median(spent))


def a_street_of_200_twice() -> tuple[np.ndarray, np.ndarray]:
    """A street's density: most pairs are apart, some overlap."""
    rng = np.random.default_rng(0)
    rows = np.column_stack(
        [
            rng.uniform(-60, 60, (400, 2)),
            rng.normal(0.8, 0.2, 400),
            rng.uniform(1, 6, (400, 3)),
            rng.uniform(-4, 4, 400),
        ]
    )
    return rows[:200], rows[200:]


def print_200_by_200(name: str, call: Callable[[], Any]) -> None:
    print(f"{name:>14}, 200 x 200: {median_ms(call):5.2f} ms")


def test_overlap_of_200_by_200_boxes() -> None:
    first, second = a_street_of_200_twice()
    print()
    for kernel in (iou_bev, iou_3d, iou_3d_and_bev, giou_bev, giou_3d):
        print_200_by_200(kernel.__name__, lambda kernel=kernel: kernel(first, second))


def test_assignment_of_200_by_200() -> None:
    """By GIoU, so that every pair is possible; and by random numbers, where all compete with all."""
    overlap, random = giou_3d(*a_street_of_200_twice()), np.random.default_rng(1).random((200, 200))
    print()
    for assigner in (greedy, hungarian):
        print_200_by_200(assigner.__name__, lambda assigner=assigner: assigner(overlap, -0.2))
        print_200_by_200(f"{assigner.__name__}*", lambda assigner=assigner: assigner(random, 0.0))
    print("* random affinities")


def street(count: int, frames: int, seed: int = 0) -> list[Detections]:
    """Cars on a grid, each with its own speed, seen a little noisily in every frame."""
    rng = np.random.default_rng(seed)
    start = np.stack(np.meshgrid(np.arange(20) * 15.0, np.arange(-(-count // 20)) * 8.0), -1).reshape(-1, 2)[:count]
    speed = rng.uniform(-1.0, 1.0, (count, 2))
    found = []
    for k in range(frames):
        xy = start + 0.1 * k * speed + rng.normal(0, 0.05, (count, 2))
        rows = np.column_stack([xy, np.tile([0.8, 4.5, 1.9, 1.6, 0.0], (count, 1))])
        found.append(Detections(Boxes3D.from_array(rows), np.full(count, 0.9), np.zeros(count, dtype=int)))
    return found


@pytest.mark.parametrize("count", [15, 300])
def test_milliseconds_a_frame_by_the_number_of_tracks(count: int) -> None:
    tracker, spent = ab3dmot(), []
    for k, found in enumerate(street(count, 60)):
        began = time.perf_counter()
        tracks = tracker.step(found, k * FRAME_NS)
        spent.append(time.perf_counter() - began)
    assert len(tracks) == count
    print(f"\n{count:>4} tracks and detections: {1000 * np.median(spent[5:]):.2f} ms a frame")


def test_a_hundred_thousand_frames_leave_nothing_behind() -> None:
    """Short-lived tracks, so that ids and births go on for ever."""
    tracker, frames = ab3dmot(), street(5, 50)
    process = psutil.Process()

    def play(first: int, last: int) -> int:
        for k in range(first, last):
            tracker.step(frames[k % 50], k * FRAME_NS)
        return int(process.memory_info().rss)

    before = play(0, 5_000)
    grown_mb = (play(5_000, 100_000) - before) / 2**20
    print(f"\nresident memory grew by {grown_mb:.2f} MB from frame 5,000 to 100,000")
    assert grown_mb < 5


def test_scoring_against_tracking_with_filterpy_objects(v2v4real: Path) -> None:
    """The usual way: a filterpy object for each track and, in the reference code, overlap pair by pair."""
    recordings = RecordingSet(v2v4real)
    played = [recordings.load(name, ("cobevt",)) for name in recordings.sequences]
    spent, reports = {}, []
    for name, affinity in {"ours": giou_3d, "pair by pair": giou_pair_by_pair}.items():
        began = time.perf_counter()
        reports = [track_with_filterpy(recording.detections["cobevt"], affinity) for recording in played]
        spent[name] = time.perf_counter() - began
    summarize([score_all(*sequence) for sequence in zip(played, reports, strict=True)])  # compiles
    began = time.perf_counter()
    score = summarize([score_all(*sequence) for sequence in zip(played, reports, strict=True)])
    scoring = time.perf_counter() - began
    assert score["sAMOTA"] > 70
    print(f"\nscoring, every metric: {scoring:.2f} s")
    for name, seconds in spent.items():
        print(f"filterpy objects, overlap {name}: {seconds:.2f} s, {seconds / scoring:.0f} times as long")


def score_all(recording: Recording, reported: Sequence[Tracks]) -> TrackLog:
    evaluator = Evaluator(0.25)
    for truth, tracks in zip(recording.truth, reported, strict=True):
        evaluator.update(truth, tracks)
    return evaluator.log


def giou_pair_by_pair(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    def footprint(box: np.ndarray) -> Polygon:
        return rotate(shapely_box(*(box[:2] - box[3:5] / 2), *(box[:2] + box[3:5] / 2)), box[6], use_radians=True)

    def giou(first: np.ndarray, second: np.ndarray) -> float:
        p, q = footprint(first), footprint(second)
        low, high = (np.array([box[2] + sign * box[5] / 2 for box in (first, second)]) for sign in (-1, 1))
        inter = p.intersection(q).area * max(0.0, high.min() - low.max())
        union = first[3:6].prod() + second[3:6].prod() - inter
        hull = p.union(q).convex_hull.area * (high.max() - low.min())
        return float(inter / union - (hull - union) / hull)

    return np.array([[giou(first, second) for second in b] for first in a]).reshape(len(a), len(b))


def track_with_filterpy(frames: Sequence[Detections], affinity: Callable[..., Any]) -> list[Tracks]:
    """AB3DMOT as it is usually written."""
    alive: list[Any] = []
    reports, born = [], 0
    for number, found in enumerate(frames, start=1):
        for track in alive:
            track.predict()
            track.misses += 1
        boxes = found.boxes.array
        known = np.array([track.x[:7, 0] for track in alive]).reshape(-1, 7)
        rows, columns = hungarian(affinity(known, boxes), -0.2)
        for row, column in zip(rows, columns, strict=True):
            track, box = alive[row], boxes[column].copy()
            box[6] = track.x[6, 0] + (box[6] - track.x[6, 0] + np.pi / 2) % np.pi - np.pi / 2
            track.update(box)
            track.misses, track.hits, track.score = 0, track.hits + 1, found.score[column]
        for column in np.setdiff1d(np.arange(len(found)), columns):
            track = KalmanFilter(dim_x=10, dim_z=7)
            track.F[[0, 1, 2], [7, 8, 9]] = 1.0
            track.H[:7, :7] = np.eye(7)
            track.P = np.diag([10.0] * 7 + [1e4] * 3)
            track.Q = np.diag([1.0] * 7 + [0.01] * 3)
            track.x[:7, 0] = boxes[column]
            born += 1
            track.id, track.misses, track.hits, track.score = born, 0, 1, found.score[column]
            alive.append(track)
        alive = [track for track in alive if track.misses < 2]
        shown = [track for track in alive if track.hits >= 3 or number <= 3]
        rows_shown = np.array([track.x[:7, 0] for track in shown]).reshape(-1, 7)
        rows_shown[:, 3:6] = np.maximum(rows_shown[:, 3:6], 1e-3)
        reports.append(
            Tracks(
                np.array([track.id for track in shown], dtype=int),
                Boxes3D.from_array(rows_shown),
                np.zeros((len(shown), 2)),
                np.array([track.score for track in shown], dtype=float),
                np.zeros(len(shown), dtype=int),
            )
        )
    return reports


def test_frames_per_second_of_tracking_and_scoring(v2v4real: Path) -> None:
    """AB3DMOT on the recordings; files are read before the clock starts."""
    recordings = RecordingSet(v2v4real)
    played = [recordings.load(name, ("cobevt",)).detections["cobevt"] for name in recordings.sequences]
    frames = sum(map(len, played))

    def track() -> None:
        for sequence in played:
            tracker = ab3dmot()
            for k, found in enumerate(sequence):
                tracker.step(found, k * FRAME_NS)

    alone = median_ms(track, repeats=3) / 1000
    print(f"\ntracker alone: {frames} frames in {alone:.2f} s, {frames / alone:.0f} frames/s")
    coopsim.evaluate_recordings("ab3dmot", v2v4real, ("cobevt",))  # compiles
    result = coopsim.evaluate_recordings("ab3dmot", v2v4real, ("cobevt",))
    print(f"through the environment, with both scores: {result.seconds:.2f} s, {frames / result.seconds:.0f} frames/s")
