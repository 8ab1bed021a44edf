"""Duplicates go, neighbours stay."""

import numpy as np

from coopsim.fusion.late import merge_duplicates
from coopsim.geometry.boxes import Boxes3D
from coopsim.types import Detections


def found(*rows: tuple[float, float, int], z: float = 0.0) -> Detections:
    """x, score, label of cars in a row."""
    boxes = Boxes3D.from_array(np.array([[x, 0, z, 4, 2, 1.5, 0] for x, _, _ in rows]).reshape(-1, 7))
    return Detections(boxes, np.array([s for _, s, _ in rows]), np.array([c for _, _, c in rows], dtype=int))


def kept(detections: Detections, iou_threshold: float = 0.2) -> list[tuple[float, float]]:
    merged = merge_duplicates(detections, iou_threshold)
    return list(zip(merged.boxes.center[:, 0].tolist(), merged.score.tolist(), strict=True))


def test_the_best_of_a_heap_stays() -> None:
    assert kept(found((0.0, 0.5, 0), (0.3, 0.9, 0), (0.1, 0.2, 0), (10.0, 0.4, 0))) == [(0.3, 0.9), (10.0, 0.4)]


def test_a_suppressed_box_suppresses_nobody() -> None:
    """A chain of three: the middle one goes to the first, so the last has no rival left."""
    assert kept(found((0.0, 0.9, 0), (2.5, 0.8, 0), (5.0, 0.7, 0))) == [(0.0, 0.9), (5.0, 0.7)]


def test_other_classes_are_no_rivals() -> None:
    assert len(kept(found((0.0, 0.9, 0), (0.0, 0.8, 7)))) == 2


def test_height_does_not_matter() -> None:
    low, high = found((0.0, 0.9, 0)), found((0.0, 0.8, 0), z=1.4)
    assert len(kept(Detections.concatenate([low, high]))) == 1


def test_nothing_and_rubbish() -> None:
    assert kept(Detections.empty()) == []
    assert kept(found((np.nan, 0.9, 0), (1.0, 0.3, 0), (1.0, np.nan, 0))) == [(1.0, 0.3)]
