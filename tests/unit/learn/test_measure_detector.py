"""The script that measures detectors of any weights: objects, mirrored towns, velocities and pairs."""

from __future__ import annotations

import numpy as np
import pytest

torch = pytest.importorskip("torch")

from measure_detector import beside, measure_clip, values_of, velocity_errors, views_of  # noqa: E402
from synthetic_clips import SyntheticClips  # noqa: E402

from coopsim.bench.detect.perceived import Perceived  # noqa: E402
from coopsim.bench.detect.ranking import Overlaps  # noqa: E402
from coopsim.geometry.boxes import Boxes3D  # noqa: E402
from coopsim.types import Detections, GroundTruth  # noqa: E402

CLIP = SyntheticClips().clip(0)


class Perfect:
    """A detector that is told what is there: the boxes of the views in order, some backwards, at half their speed."""

    sweeps = 2

    def __init__(self, mirrored: bool, backwards: int = 0) -> None:
        self._truth = [truth for _, truth in views_of(CLIP, 2, mirrored=mirrored)]
        self._backwards = backwards

    def detect_around(self, clouds: object, reach_m: float, least_score: float) -> list[Detections]:
        return [self._found(each) for each in self._truth]

    def _found(self, truth: GroundTruth) -> Detections:
        boxes = truth.boxes.array.copy()
        boxes[: self._backwards, 6] += np.pi
        count = len(boxes)
        return Detections(Boxes3D.from_array(boxes), np.full(count, 0.9), truth.label, velocity=0.5 * truth.velocity)


def test_a_mirrored_town_is_seen_from_the_same_places() -> None:
    plain, mirrored = (list(views_of(CLIP, 2, mirrored=each)) for each in (False, True))
    assert len(plain) == 2, "scenes with a sweep before, one a member"
    for (points, truth), (other, turned) in zip(plain, mirrored, strict=True):
        assert (points[:, 4] > 0).any()
        np.testing.assert_allclose(other[:, 1], -points[:, 1])
        np.testing.assert_allclose(turned.boxes.array[:, [1, 6]], -truth.boxes.array[:, [1, 6]], atol=1e-9)
        np.testing.assert_allclose(turned.velocity[:, 1], -truth.velocity[:, 1])


@pytest.mark.parametrize("mirrored", [False, True])
def test_a_perfect_detector_is_told_from_one_that_turns_boxes(mirrored: bool) -> None:
    right, wrong = (measure_clip(Perfect(mirrored, each), CLIP, mirrored=mirrored) for each in (0, 1))
    assert values_of([right])["vehicles"] == values_of([wrong])["vehicles"] == 1.0
    assert values_of([right])["backwards"] == 0.0
    assert values_of([wrong])["backwards"] == 0.25
    assert values_of([right])["velocity"] == pytest.approx(0.5)
    assert np.isnan(values_of([right])["people"])
    assert beside([wrong, wrong], [right, right])["backwards - first"] == "+0.250 (+0.250 to +0.250)"
    assert beside([wrong], [right])["people - first"] == "-"


def test_velocities_count_of_sure_vehicles_that_move() -> None:
    boxes = Boxes3D.from_array(np.array([[10.0 * k, 5.0, 0.8, 4.5, 1.9, 1.6, 0.0] for k in range(4)]))
    velocity = np.array([[10.0, 0.0], [0.0, 4.0], [0.0, 0.0], [8.0, 0.0]])
    truth = GroundTruth(np.arange(4), boxes, np.zeros(4, np.int64), velocity=velocity)
    stated = np.array([[9.0, 0.0], [0.0, 5.0], [3.0, 0.0], [0.0, 0.0]])
    found = Detections(boxes, np.array([0.9, 0.5, 0.9, 0.2]), np.zeros(4, np.int64), velocity=stated)
    silent = Detections(boxes, np.full(4, 0.9), np.zeros(4, np.int64))
    overlaps = Overlaps.of(Perceived.of([found, silent], [truth, truth]))
    np.testing.assert_allclose(np.sort(velocity_errors(overlaps, [found, silent], [truth, truth])), [0.1, 0.25])
