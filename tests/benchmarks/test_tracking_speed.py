"""How fast tracking and scoring are: rotated overlap, and real recordings from detections to the score.

Run by `make bench`. Nothing here fails by time; the figures are printed.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

import coopsim
from coopsim.agents.ab3dmot import ab3dmot
from coopsim.data.recording import RecordingSet
from coopsim.geometry.iou import giou_3d, iou_3d, iou_bev


def median_ms(call: Callable[[], Any], repeats: int = 20) -> float:
    call()  # compiles
    spent = []
    for _ in range(repeats):
        began = time.perf_counter()
        call()
        spent.append(time.perf_counter() - began)
    return 1000 * float(np.median(spent))


def test_overlap_of_200_by_200_boxes() -> None:
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
    print()
    for kernel in (iou_bev, iou_3d, giou_3d):
        spent = median_ms(lambda kernel=kernel: kernel(rows[:200], rows[200:]))
        print(f"{kernel.__name__:>8}, 200 x 200: {spent:5.2f} ms")


def test_frames_per_second_of_tracking_and_scoring(v2v4real: Path) -> None:
    """AB3DMOT on the recordings; files are read before the clock starts."""
    recordings = RecordingSet(v2v4real)
    played = [recordings.load(name, ("cobevt",)).detections["cobevt"] for name in recordings.sequences]
    frames = sum(map(len, played))

    def track() -> None:
        for sequence in played:
            tracker = ab3dmot()
            for k, found in enumerate(sequence):
                tracker.step(found, k * 100_000_000)

    alone = median_ms(track, repeats=3) / 1000
    print(f"\ntracker alone: {frames} frames in {alone:.2f} s, {frames / alone:.0f} frames/s")
    coopsim.evaluate_recordings("ab3dmot", v2v4real, ("cobevt",))  # compiles
    result = coopsim.evaluate_recordings("ab3dmot", v2v4real, ("cobevt",))
    print(f"through the environment, with both scores: {result.seconds:.2f} s, {frames / result.seconds:.0f} frames/s")
