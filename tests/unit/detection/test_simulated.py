"""The simulated detector follows the returns: recall, noise and score; and it never sees what was not hit."""

from dataclasses import replace

import numpy as np
import pytest

from coopsim.detection.oracle import Oracle
from coopsim.detection.simulated.simulated import SimulatedDetector, SimulatedDetectorConfig
from coopsim.errors import InvalidValueError
from coopsim.geometry.boxes import Boxes3D
from coopsim.geometry.se3 import SE3
from coopsim.types import Odometry, SensorView
from coopsim.world.snapshot import Actors

QUIET = SimulatedDetectorConfig(false_positives=0.0, yaw_flip=0.0)


def actors(count: int, range_m: float = 20.0) -> Actors:
    rows = np.tile([range_m, 0, 0.8, 4.5, 1.9, 1.6, 0.2], (count, 1))
    zeros = np.zeros(count, dtype=int)
    # Ids in no order: a detector must not rely on one.
    ids = np.arange(count, 0, -1) * 3
    return Actors(ids, Boxes3D.from_array(rows), np.zeros((count, 2)), zeros, zeros, np.zeros((count, 3)))


VIEW = SensorView("cav_0", 0, Odometry(np.zeros(4)))
"""A simulated detector needs no sensors."""


def oracle(truth: Actors, returns: object) -> Oracle:
    return Oracle(truth, np.broadcast_to(returns, len(truth)).astype(int), SE3.identity())


def detect(returns_each: int, *, range_m: float = 20.0, count: int = 2000, config: SimulatedDetectorConfig = QUIET):  # type: ignore[no-untyped-def]
    truth = actors(count, range_m)
    return SimulatedDetector(config).detect(VIEW, oracle(truth, returns_each), np.random.default_rng(0)), truth


def test_too_few_returns_are_never_detected() -> None:
    assert len(detect(QUIET.min_points - 1)[0]) == 0


def test_recall_rises_with_returns_as_documented() -> None:
    rates = [len(detect(n)[0]) / 2000 for n in (5, 10, 20, 100)]
    expected = SimulatedDetector(QUIET).recall(np.array([5, 10, 20, 100]))
    np.testing.assert_allclose(rates, expected, atol=0.03)
    assert (np.diff(expected) > 0).all() and expected[-1] <= QUIET.max_recall


def test_noise_grows_with_range_and_shrinks_with_returns() -> None:
    def spread(returns: int, range_m: float) -> float:
        found, _ = detect(returns, range_m=range_m)
        return float(found.boxes.center[:, 0].std())

    assert spread(200, 60) > 1.2 * spread(200, 10)
    assert spread(10, 20) > 1.2 * spread(400, 20)


def test_score_is_higher_for_what_is_better_seen() -> None:
    assert detect(100)[0].score.mean() > detect(6)[0].score.mean() + 0.3


def test_false_positives_have_their_rate_and_low_scores() -> None:
    config = SimulatedDetectorConfig(false_positives=3.0)
    detector, rng = SimulatedDetector(config), np.random.default_rng(1)
    found = [detector.detect(VIEW, oracle(actors(0), 0), rng) for _ in range(400)]
    assert np.mean([len(each) for each in found]) == pytest.approx(3.0, rel=0.1)
    scores = np.concatenate([each.score for each in found])
    assert scores.mean() < 0.4 < detect(100)[0].score.mean()


def test_hiding_one_actor_does_not_shift_the_noise_of_the_others() -> None:
    truth = actors(3)
    detector = SimulatedDetector(replace(QUIET, max_recall=1.0))
    all_seen = detector.detect(VIEW, oracle(truth, 500), np.random.default_rng(5))
    one_hidden = detector.detect(VIEW, oracle(truth, [500, 0, 500]), np.random.default_rng(5))
    assert len(all_seen) == 3
    np.testing.assert_array_equal(one_hidden.boxes.array, all_seen.boxes.array[[0, 2]])


@pytest.mark.parametrize(
    ("setting", "match"),
    [
        ({"max_recall": 1.1}, r"max_recall must be in \[0, 1\]"),
        ({"min_points": 0}, "min_points must be an integer >= 1"),
        ({"position_noise_m": -1.0}, "position_noise_m must be a finite number >= 0"),
        ({"false_positives": np.nan}, "false_positives must be a finite number"),
    ],
)
def test_bad_settings(setting: dict[str, float], match: str) -> None:
    with pytest.raises(InvalidValueError, match=match):
        SimulatedDetectorConfig(**setting)  # type: ignore[arg-type]


def test_only_the_agents_that_are_asked_for_are_simulated() -> None:
    detector, truth = SimulatedDetector(QUIET), oracle(actors(5), 100)
    alone = detector.detect(VIEW, truth, np.random.default_rng(0))
    view = replace(VIEW, agent="cav_1")
    rngs = {"cav_1": np.random.default_rng(0)}
    found = detector.detect_all({"cav_1": view}, {"cav_0": truth, "cav_1": truth}, rngs)
    assert list(found) == ["cav_1"]
    np.testing.assert_array_equal(found["cav_1"].boxes.array, alone.boxes.array)
    assert detector.detect_all({}, {}, {}) == {}
