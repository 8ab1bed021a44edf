"""Training of covariances that see features: which boxes err more is learned from what the map shows there."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import torch
from numpy.typing import NDArray
from synthetic_clips import SyntheticClips

from coopsim.errors import InvalidValueError
from coopsim.geometry.boxes import Boxes3D
from coopsim.geometry.se3 import Floats
from coopsim.learn.recipe import TrainingRecipe
from coopsim.learn.tasks.covariance_task import SeenCovarianceTask
from coopsim.learn.weights import load_covariance, load_detector, make_network, save_weights
from coopsim.nn.inference.detectors import CloudDetector
from coopsim.types import Detections

RECIPE = TrainingRecipe("mine", kind="seen_covariance", precision="float32")
OBJECTS, POINTS = 8, 40
CLIP = SyntheticClips(objects=OBJECTS, frames=6).clip(0)


class Scripted:
    """Detects the objects that points are on: every other one with an error of 2 m, which its patch shows."""

    sweeps = 1

    def __init__(self, features: int) -> None:
        self._features, self._rng = features, np.random.default_rng(0)

    def detect_patches(
        self, points: NDArray[np.float32], reach_m: float, least_score: float
    ) -> tuple[Detections, Floats]:
        middles = points[: OBJECTS * POINTS, :3].reshape(-1, POINTS, 3).mean(axis=1).astype(np.float64)
        blurred = np.arange(len(middles)) % 2 == 1
        boxes = np.column_stack([middles, np.tile([4.5, 1.8, 1.6, 0.0], (len(middles), 1))])
        boxes[:, :2] += self._rng.normal(size=(len(boxes), 2)) * np.where(blurred, 2.0, 0.05)[:, None]
        patches = np.repeat(blurred[:, None], 9 * self._features, axis=1).astype(np.float32)
        return Detections(Boxes3D.from_array(boxes), np.ones(OBJECTS), np.zeros(OBJECTS, np.int64)), patches


def test_it_learns_from_features_which_boxes_err() -> None:
    task = SeenCovarianceTask(RECIPE, 0)
    task._detector = Scripted(task.net.config.features)  # type: ignore[assignment]
    (window,) = task.cut(CLIP, np.random.default_rng(0))
    assert task.cut(CLIP, np.random.default_rng(0))[0] is window  # detected once for all passes
    adam = torch.optim.Adam(task.net.parameters(), 0.02)
    losses = []
    for _ in range(40):
        losses.append(task([window])["loss"])
        adam.zero_grad()
        losses[-1].backward()
        adam.step()
    assert losses[-1] < losses[0] - 1.0
    assert window.patches is not None
    variance = task.net.variances(window.numbers, window.patches)[:, :2].mean(axis=1)
    assert set(task.evaluate(task.net, [[window]])) == {"updated", "innovation", "mahalanobis"}
    blurred = window.patches[:, 0] > 0
    assert np.median(variance[blurred]) > 4 * np.median(variance[~blurred])


def test_its_weights_judge_the_boxes_of_the_detector_that_it_was_trained_on(tmp_path: Path) -> None:
    task = SeenCovarianceTask(RECIPE, 0)
    torch.nn.init.normal_(task.net.last.weight, std=0.1)  # type: ignore[union-attr]
    (file,) = task.files(task.net, "mine")
    save_weights(tmp_path / "mine.safetensors", file.net, file.metadata)
    detector = load_detector("pillars")
    judge = load_covariance(tmp_path / "mine.safetensors", detector)
    points = np.concatenate([agent.points for agent in CLIP.scenes[0].agents])
    points = np.column_stack([points, np.zeros(len(points), np.float32)])
    plain, judged = (CloudDetector(detector, covariance=each) for each in (None, judge))
    found, patches = plain.detect_patches(points, 40.0, 0.01)
    (stated,) = judged.detect_around([points], 40.0, 0.01)
    assert len(found) > 0
    np.testing.assert_array_equal(stated.boxes.array, found.boxes.array)
    assert stated.covariance is not None and found.covariance is not None
    assert not np.allclose(stated.covariance, found.covariance)
    assert patches.shape == (len(found), 9 * detector.config.features)
    with pytest.raises(InvalidValueError, match="another encoder"):
        load_covariance(tmp_path / "mine.safetensors", make_network("detector", {}, seed=3))


def test_without_features_it_is_told_places_alone() -> None:
    task = SeenCovarianceTask(TrainingRecipe("mine", kind="seen_covariance", network={"features": 0}), 0)
    task._detector = Scripted(64)  # type: ignore[assignment]
    (window,) = task.cut(CLIP, np.random.default_rng(0))
    assert window.patches is None
    assert torch.isfinite(task([window])["loss"])


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ({"samples": {"late": 0.1}}, "samples must be left out"),
        ({"start": "dmstrack"}, "start must be left out"),
        ({"network": {"features": 7}}, "features must be the detector's"),
    ],
)
def test_what_has_no_meaning_is_refused(given: dict[str, object], said: str) -> None:
    with pytest.raises(InvalidValueError, match=said):
        SeenCovarianceTask(TrainingRecipe("mine", kind="seen_covariance", **given), 0)  # type: ignore[arg-type]
