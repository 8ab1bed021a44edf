"""Classes are confused at the given rates, for as long as said, and nothing else changes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from coopsim.detection.oracle import Oracle
from coopsim.detection.presets import preset
from coopsim.detection.simulated.correlated import CorrelatedDetector
from coopsim.detection.simulated.curves import ClassConfusion, Curve, Curves, LabelNoise
from coopsim.detection.simulated.persistence import Persistence
from coopsim.detection.simulated.simulated import SimulatedDetector, SimulatedDetectorConfig
from coopsim.errors import InvalidValueError, UnknownNameError
from coopsim.geometry.boxes import Boxes3D
from coopsim.geometry.se3 import SE3
from coopsim.types import AgentSpec, Detections, ObjectClass, Odometry, SensorView
from coopsim.world.snapshot import Actors

CAR, VAN, TRUCK = (int(each) for each in (ObjectClass.CAR, ObjectClass.VAN, ObjectClass.TRUCK))
SHARES = {"car": {"van": 0.2, "truck": 0.1}, "truck": {"car": 1.0}}
VIEW = SensorView("cav_0", 0, Odometry(np.zeros(4)))


def oracle(count: int, label: int = CAR) -> Oracle:
    rows = np.tile([20.0, 0, 0.8, 4.5, 1.9, 1.6, 0.2], (count, 1))
    rows[:, 1] = np.linspace(-30, 30, count)
    zeros = np.zeros(count, dtype=int)
    boxes = Boxes3D.from_array(rows)
    actors = Actors(np.arange(1, count + 1), boxes, np.zeros((count, 2)), zeros + label, zeros, np.zeros((count, 3)))
    return Oracle(actors, zeros + 1000, SE3.identity())


def step(noise: LabelNoise, label: np.ndarray) -> np.ndarray:
    """Labels of one owner's objects, whose ids count from 0."""
    ids = np.arange(len(label))
    return noise.step(np.zeros(1, np.int64), np.array([0, len(ids)]), ids, ids, label)


def test_curves_together_have_the_bits_of_each_alone() -> None:
    rng = np.random.default_rng(0)
    alone = [Curve((3.0,), (0.5,))]
    alone += [Curve(tuple(np.sort(rng.uniform(0, 80, k))), tuple(rng.normal(size=k))) for k in (2, 5, 12)]
    at = np.concatenate([rng.uniform(-20, 120, 500), [0.0, 3.0, np.inf], *(curve.at for curve in alone)])
    np.testing.assert_array_equal(Curves(*alone)(at), [curve(at) for curve in alone])


def test_the_matrix_has_the_shares_and_rows_that_sum_to_one() -> None:
    matrix = ClassConfusion(SHARES).matrix
    assert matrix[CAR, [CAR, VAN, TRUCK]].tolist() == pytest.approx([0.7, 0.2, 0.1])
    np.testing.assert_allclose(matrix.sum(axis=1), 1.0)
    fitted = preset("pointpillars_v2v4real").confusion
    assert fitted is not None
    np.testing.assert_allclose(fitted.matrix.sum(axis=1), 1.0)
    assert (np.diag(fitted.matrix) > 0.75).all()


def test_labels_are_confused_at_the_rates_of_the_matrix() -> None:
    noise = LabelNoise(ClassConfusion(SHARES), 0, ["a"], [0.1])
    reported = step(noise, np.full(40_000, CAR))
    shares = np.bincount(reported, minlength=9) / len(reported)
    np.testing.assert_allclose(shares[[CAR, VAN, TRUCK]], [0.7, 0.2, 0.1], atol=0.01)
    assert set(step(noise, np.full(5, TRUCK)).tolist()) == {CAR}
    assert set(step(noise, np.full(5, VAN)).tolist()) == {VAN}


def test_the_default_lasts_as_measured() -> None:
    """On KITTI, a wrong label is wrong again after 0.1 s with probability 0.48."""
    label = np.full(100_000, int(ObjectClass.PEDESTRIAN))
    shares = {"pedestrian": {"bicycle": 0.031}}
    fitted = preset("pointpillars_v2v4real").confusion
    assert fitted is not None
    noise = LabelNoise(ClassConfusion(shares, fitted.persistence), 0, ["a"], [0.1])
    first, second = (step(noise, label) != label for _ in range(2))
    assert first.mean() == pytest.approx(0.031, abs=0.003)
    assert second[first].mean() == pytest.approx(0.48, abs=0.1)


def test_both_simulated_detectors_confuse_and_keep_their_boxes() -> None:
    confusion = ClassConfusion(SHARES, Persistence(0.5, 0.3, 1.0))
    for plain, confused in (
        (SimulatedDetector(), SimulatedDetector(SimulatedDetectorConfig(confusion=confusion))),
        (
            CorrelatedDetector(replace(preset("pointpillars_v2v4real"), confusion=None)),
            CorrelatedDetector(replace(preset("pointpillars_v2v4real"), confusion=confusion)),
        ),
    ):
        found: list[Detections] = []
        for detector in (plain, confused):
            begun = detector.begin({"cav_0": AgentSpec("cav_0", "cav", 0.1, "none")}, seed=3)
            found.append(begun.detect(VIEW, oracle(2000), np.random.default_rng(0)))
        real = found[0].label[:1500]
        assert (real == CAR).all() and (found[1].label[:1500] == VAN).mean() == pytest.approx(0.2, abs=0.04)
        count = min(map(len, found)) if plain.__class__ is SimulatedDetector else len(found[0])
        same = found[0].boxes.array[: count - 50] == found[1].boxes.array[: count - 50]
        assert same.all()


def test_phantoms_are_confused_as_the_cars_that_they_are_taken_for() -> None:
    shares = {"car": {"truck": 0.5}}
    detector = CorrelatedDetector(replace(preset("pointpillars_v2v4real"), confusion=ClassConfusion(shares)))
    labels: list[int] = []
    for seed in range(40):
        begun = detector.begin({"cav_0": AgentSpec("cav_0", "cav", 0.1, "none")}, seed)
        labels += begun.detect(VIEW, oracle(0), np.random.default_rng(0)).label.tolist()
    assert set(labels) == {CAR, TRUCK} and np.mean(np.array(labels) == TRUCK) == pytest.approx(0.5, abs=0.15)


@pytest.mark.parametrize(
    ("shares", "error", "match"),
    [
        ({"carr": {"van": 0.1}}, UnknownNameError, "unknown class in shares 'carr'. Did you mean 'car'"),
        ({"car": {"vann": 0.1}}, UnknownNameError, "unknown class in shares of car 'vann'"),
        ({"car": {"van": 1.1}}, InvalidValueError, r"share of car reported as van must be in \[0, 1\]"),
        ({"car": {"van": 0.6, "bus": 0.6}}, InvalidValueError, "shares of car must be of other classes and at most 1"),
        ({"car": {"car": 0.6}}, InvalidValueError, "shares of car must be of other classes"),
        ({"car": 0.1}, InvalidValueError, "shares must be a mapping of mappings"),
        (None, InvalidValueError, "shares must be a mapping of mappings"),
    ],
)
def test_bad_shares(shares: object, error: type[Exception], match: str) -> None:
    with pytest.raises(error, match=match):
        ClassConfusion(shares)  # type: ignore[arg-type]
