"""YOLOO's cost: looks and distance add up; where looks are unknown, distance counts twice."""

from __future__ import annotations

import numpy as np
import pytest

from coopsim.geometry.assignment import greedy
from coopsim.geometry.boxes import Boxes3D
from coopsim.tracking.appearance import LastEmbedding, YolooAffinity
from coopsim.tracking.cascade import Cascade, Stage
from coopsim.tracking.lifecycle import HitsAndAge
from coopsim.tracking.motion.constant_velocity import ConstantVelocity
from coopsim.tracking.tracker import Tracker
from coopsim.types import Detections

DIAGONAL_M = np.hypot(4.0, 3.0)
RED, BLUE, NONE = [1.0, 0.0], [0.0, 1.0], [0.0, 0.0]


def found(*x_m: float, looks: object = None, label: int = 0) -> Detections:
    boxes = np.array([[x, 0.0, 0.8, 4.0, 3.0, 1.6, 0.0] for x in x_m]).reshape(-1, 7)
    embedding = None if looks is None else np.array(looks, dtype=float)
    return Detections(Boxes3D.from_array(boxes), np.full(len(boxes), 0.8), np.full(len(boxes), label), None, embedding)


def tracker(counts: list[tuple[int, int]] | None = None) -> Tracker:
    cost = YolooAffinity(lambda *each: (counts if counts is not None else []).append(each))
    stage = Stage(cost, greedy, gate=0.0)
    return Tracker(ConstantVelocity(), Cascade([stage]), HitsAndAge(1, 5), appearance=LastEmbedding())


def affinity(before: Detections, now: Detections) -> np.ndarray:
    follows = tracker()
    follows.step(before, 0)
    return YolooAffinity(lambda *each: None)(follows.predict(0), now)


def test_the_cost_is_the_sum_of_both() -> None:
    got = affinity(found(0.0, looks=[RED]), found(1.0, 2.0, 9.0, looks=[RED, BLUE, RED]))
    assert got == pytest.approx(np.array([[2 - 1 / DIAGONAL_M, 1 - 2 / DIAGONAL_M, -np.inf]]))


def test_opposite_looks_cost_no_more_than_different_ones() -> None:
    got = affinity(found(0.0, looks=[RED]), found(0.0, 0.0, looks=[[-1.0, 0.0], BLUE]))
    assert got == pytest.approx(np.array([[1.0, 1.0]]))


def test_without_looks_distance_counts_twice() -> None:
    unknown = found(1.0, 1.0, looks=[NONE, [np.nan, 1.0]])
    assert affinity(found(0.0, looks=[RED]), unknown) == pytest.approx(np.full((1, 2), 2 - 2 / DIAGONAL_M))
    assert affinity(found(0.0), found(1.0, looks=[RED])) == pytest.approx(2 - 2 / DIAGONAL_M)
    assert affinity(found(0.0, looks=[RED]), found(1.0, looks=[[1.0, 0.0, 0.0]])) == pytest.approx(2 - 2 / DIAGONAL_M)


def test_looks_keep_ids_apart_that_distance_swaps() -> None:
    """Two objects stand side by side and change places between two frames."""
    for looks, swapped in (([RED, BLUE], [2, 1]), (None, [1, 2])):
        follows = tracker()
        assert follows.step(found(0.0, 1.0, looks=looks), 0).id.tolist() == [1, 2]
        tracks = follows.step(found(0.1, 0.9, looks=None if looks is None else looks[::-1]), 100_000_000)
        assert tracks.id[np.argsort(tracks.boxes.array[:, 0])].tolist() == swapped


def test_a_track_keeps_its_last_look_only() -> None:
    follows = tracker()
    for k, look in enumerate((RED, NONE, BLUE, NONE)):
        follows.step(found(0.0, looks=[look]), k)
    memory = follows.state.tracked.appearance
    assert memory.vectors[:, :, :].tolist() == [[BLUE]] and memory.known.all()


def test_possible_pairs_of_one_class_are_counted() -> None:
    counts: list[tuple[int, int]] = []
    follows = tracker(counts)
    follows.step(found(0.0, 50.0, looks=[RED, NONE]), 0)
    follows.step(found(1.0, 51.0, 90.0, looks=[RED, RED, RED]), 0)
    follows.step(found(0.0, looks=[RED], label=3), 0)
    assert counts == [(1, 1), (0, 0)]
