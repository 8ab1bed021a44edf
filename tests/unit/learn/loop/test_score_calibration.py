"""Calibration of scores: lines that are known come back, and trainings of heads with a second look store them."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
import torch
from synthetic_clips import SyntheticClips

from coopsim.geometry.boxes import Boxes3D
from coopsim.learn.loop.calibration import calibrate, expected_error, fit, graded
from coopsim.learn.recipe import TrainingRecipe
from coopsim.learn.samples.targets import make_targets
from coopsim.learn.tasks.training_task import FoundMap
from coopsim.learn.train import train
from coopsim.learn.weights import load_detector
from coopsim.nn.detector.detector_net import JudgedHead
from coopsim.types import BevGrid, Detections
from coopsim.types.taxonomy import ObjectClass

GRID = BevGrid((-19.2, 19.2), (-19.2, 19.2), 1.2)
CAR, PERSON = int(ObjectClass.CAR), int(ObjectClass.PEDESTRIAN)


def test_a_line_that_scores_are_off_by_is_found_for_each_group() -> None:
    rng = np.random.default_rng(0)
    group, logit = rng.integers(0, 3, 60_000), rng.normal(0, 2, 60_000)
    true = np.array([[0.5, -1.0], [2.0, 0.5], [1.0, 0.0]])
    p = 1 / (1 + np.exp(-(true[group, 0] * logit + true[group, 1])))
    np.testing.assert_allclose(fit((group, logit, (rng.random(60_000) < p).astype(float))), true, atol=0.08)


def test_calibrated_scores_keep_their_order_whatever_the_boxes_say() -> None:
    rng = np.random.default_rng(0)
    logit = rng.normal(0, 2, 3000)
    wrong_way = (rng.random(3000) < 1 / (1 + np.exp(logit + 1))).astype(float)
    slope, shift = fit((np.zeros(3000, np.int64), logit, wrong_way))[0]
    assert slope > 0
    score = 1 / (1 + np.exp(-(slope * logit + shift)))
    assert (np.diff(score[np.argsort(logit)]) >= 0).all()
    assert score.mean() == pytest.approx(wrong_way.mean(), abs=0.02)


def test_without_boxes_scores_stay_as_they_are() -> None:
    empty = (np.zeros(0, np.int64), np.zeros(0), np.zeros(0))
    np.testing.assert_array_equal(fit(empty), [[1.0, 0.0]] * 3)


def test_the_error_is_the_distance_of_scores_from_the_share_of_right_boxes() -> None:
    score = np.array([0.95] * 10 + [0.15] * 10)
    right = np.array([1.0] * 8 + [0.0] * 2 + [1.0] * 1 + [0.0] * 9)
    assert expected_error(score, right) == pytest.approx((0.15 + 0.05) / 2)


def found_map(score: float, *, off_m: float = 0.0, again: int = 1) -> FoundMap:
    """Return a map with a car and a person, found with a score and an error, the car once more with a lower score."""
    boxes = np.array([[3.0, 4.0, 0.8, 4.4, 1.8, 1.5, 0.3], [-6.0, -7.0, 0.9, 0.8, 0.6, 1.8, 0.0]])
    label = np.array([CAR, PERSON])
    moved = np.concatenate([boxes, boxes[:again]])
    moved[:, 0] += off_m
    rows = slice(0, len(moved))
    scores, labels = np.array([score, score, score - 0.05])[rows], np.array([CAR, PERSON, CAR])[rows]
    found = Detections(Boxes3D.from_array(moved), scores, labels)
    return FoundMap(found, make_targets(boxes, np.zeros((2, 2)), label, GRID), GRID)


def test_an_object_has_one_right_box() -> None:
    group, logit, right = graded([found_map(0.7), found_map(0.7, off_m=5.0)])
    assert group.tolist() == [0, 2, 0] * 2
    np.testing.assert_allclose(1 / (1 + np.exp(-logit)), [0.7, 0.7, 0.65] * 2)
    assert right.tolist() == [1.0, 1.0, 0.0, 0.0, 0.0, 0.0]


def test_calibrated_scores_are_the_share_of_right_boxes() -> None:
    head, maps = JudgedHead(8), [found_map(0.3, off_m=5.0 * (k // 2 % 4 == 0), again=0) for k in range(400)]
    said = calibrate(head, maps)
    assert said["calibration_error"] < 0.05 < said["calibration_error_before"]
    slope, shift = head.get_buffer("calibration")[2].tolist()
    assert 1 / (1 + np.exp(-(slope * np.log(0.3 / 0.7) + shift))) == pytest.approx(0.75, abs=0.02)
    head.uncalibrate()
    assert head.get_buffer("calibration").tolist() == [[1.0, 0.0]] * 3


def test_a_training_stores_the_calibration_of_its_scores(tmp_path: Path) -> None:
    recipe = TrainingRecipe(
        "tiny",
        steps=60,
        batch=4,
        block=1,
        lr=0.02,
        average=0.9,
        held_out=1,
        network={
            "pillar_features": 8,
            "channels": [8, 8, 8],
            "layers": [0, 0, 0],
            "features": 8,
            "layout": "sparse",
            "head": "judged",
        },
        samples={"reach_m": 19.2, "crop_cells": None, "merged": 0.0, "thinned": 0.0},
    )
    detector = load_detector(train(recipe, tmp_path, source=SyntheticClips()))
    stored = detector.head.get_buffer("calibration")
    assert stored.shape == (3, 2) and not torch.equal(stored, torch.tensor([[1.0, 0.0]] * 3))
    said = json.loads((tmp_path / "card.json").read_text())["calibration"]
    assert 0 <= said["calibration_error"] <= 1
