"""The motion models: their mathematics, which end is the front, and what one bad measurement may not do."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from filterpy.kalman import ExtendedKalmanFilter
from hypothesis import given
from hypothesis import strategies as st

from coopsim.errors import InvalidValueError
from coopsim.geometry.se3 import wrap_angle
from coopsim.tracking.motion.constant_velocity import Beliefs, ConstantVelocity, Motion
from coopsim.tracking.motion.turning import (
    SPEED,
    TURN_RATE,
    ConstantTurnRate,
    ConstantTurnRateAcceleration,
    advance,
    face_forwards,
    turn_moments,
)

CTRV, CTRA = ConstantTurnRate(), ConstantTurnRateAcceleration()
TURNING = pytest.mark.parametrize("motion", [CTRV, CTRA], ids=["ctrv", "ctra"])
MODELS = pytest.mark.parametrize("motion", [ConstantVelocity(), CTRV, CTRA], ids=["cv", "ctrv", "ctra"])
TURN_RATES = [0.0, 1e-300, 1e-12, -1e-6, 1e-3, 0.4, -0.4, 1.999, 2.001, -2.0, 7.0, -60.0]  # x 0.5 s crosses 1 rad


def states(count: int, size: int, seed: int = 0) -> np.ndarray:
    mean = np.random.default_rng(seed).normal(size=(count, size))
    mean[:, SPEED] *= 10
    return mean


def drive(seconds: float, speed: float, turn_rate: float = 0.0, acceleration: float = 0.0, yaw: float = 0.5):
    """Boxes (K, 7) of a car at 10 Hz, integrated in tiny steps: an independent computation of the motion."""
    fine = np.arange(round(seconds * 10_000)) / 10_000
    heading, along = yaw + turn_rate * fine, (speed + acceleration * fine) / 10_000
    boxes = np.zeros((len(fine), 7))
    boxes[:, 0], boxes[:, 1] = np.cumsum(along * np.cos(heading)), np.cumsum(along * np.sin(heading))
    boxes[:, 3:6], boxes[:, 6] = (4.5, 1.9, 1.6), heading
    return boxes[::1000]


def track(motion: Motion, truth: np.ndarray, wrong: np.ndarray, count: int = 1, seed: int = 0) -> list[Beliefs]:
    """Beliefs after each frame; a detector with noise, whose heading is half a turn off where `wrong` (K, count)."""
    rng = np.random.default_rng(seed)
    beliefs, history = None, []
    for box, turned in zip(truth, wrong, strict=True):
        seen = box + rng.normal(size=(count, 7)) * [0.2, 0.2, 0.1, 0.1, 0.1, 0.1, 0.1]
        seen[:, 6] = wrap_angle(seen[:, 6] + np.pi * turned)
        beliefs = (
            motion.initiate(seen, None) if beliefs is None else motion.update(motion.predict(beliefs, 0.1), seen, None)
        )
        history.append(beliefs)
    return history


@pytest.mark.parametrize("angle", [0.0, 1e-9, 0.3, -0.999999, 1.0, -1.000001, 2.5, -30.0])
def test_turn_moments_are_the_integrals_they_stand_for(angle: float) -> None:
    nodes, weights = np.polynomial.legendre.leggauss(60)
    s = (nodes + 1) / 2
    expected = [(weights / 2 * s**k * np.exp(1j * angle * s)).sum() for k in range(3)]
    np.testing.assert_allclose(turn_moments(np.array([angle]))[:, 0], expected, atol=1e-15)


@pytest.mark.parametrize("turn_rate", TURN_RATES)
@pytest.mark.parametrize("size", [10, 11])
def test_jacobians_are_the_derivatives(size: int, turn_rate: float) -> None:
    mean, dt_s, step = states(5, size), 0.5, 1e-5
    mean[:, TURN_RATE] = turn_rate
    jacobian = advance(mean, dt_s)[1]
    for column in range(size):
        nudge = step * np.eye(size)[column]
        slope = (advance(mean + nudge, dt_s)[0] - advance(mean - nudge, dt_s)[0]) / (2 * step)
        np.testing.assert_allclose(jacobian[:, :, column], slope, atol=2e-8)


@pytest.mark.parametrize(("turn_rate", "acceleration"), [(0.0, 0.0), (0.6, 0.0), (-0.3, -2.0), (0.0, 1.5)])
def test_prediction_is_the_motion(turn_rate: float, acceleration: float) -> None:
    truth = drive(2.0, 8.0, turn_rate, acceleration)
    mean = np.array([[*truth[0], 8.0, turn_rate, 0.0, acceleration]])
    moved = advance(mean, 1.5)[0]
    np.testing.assert_allclose(moved[0, :7], truth[15], atol=2e-3)
    assert moved[0, SPEED] == 8.0 + 1.5 * acceleration


@TURNING
def test_many_short_steps_are_one_long_step(motion: Motion) -> None:
    beliefs = track(motion, drive(2.0, 8.0, 0.3), np.zeros((20, 1)))[-1]
    short = beliefs
    for _ in range(10):
        short = motion.predict(short, 0.1)
    long = motion.predict(beliefs, 1.0)
    np.testing.assert_allclose(short.mean, long.mean, atol=1e-12)
    deviations = [np.sqrt(np.diagonal(each.covariance[0])) for each in (short, long)]
    np.testing.assert_allclose(deviations[0], deviations[1], rtol=0.15)


@TURNING
def test_the_filter_is_filterpys(motion: ConstantTurnRate) -> None:
    rng = np.random.default_rng(3)
    boxes = rng.normal(size=(4, 7)) * 0.3 + [0, 0, 0, 4.5, 1.9, 1.6, 0]
    beliefs = motion.initiate(boxes, None)
    size = beliefs.mean.shape[1]
    growth = np.diag([0.02, 0.02, 0.01, 0.01, 0.01, 0.01, 0.01, 4.0, 0.1, 0.1, 0][:size])
    if size == 11:
        growth[SPEED, SPEED], growth[10, 10] = 0.1, 4.0
    references = []
    for k in range(4):
        reference = ExtendedKalmanFilter(dim_x=size, dim_z=7)
        reference.x, reference.P = beliefs.mean[k].copy(), beliefs.covariance[k].copy()
        reference.R = np.diag([0.1, 0.1, 0.05, 0.1, 0.05, 0.05, 0.05])
        references.append(reference)
    for _ in range(30):
        beliefs = motion.predict(beliefs, 0.1)
        boxes = boxes + rng.normal(scale=0.05, size=boxes.shape) + [0.8, 0.2, 0, 0, 0, 0, 0.01]
        innovation_covariance = beliefs.covariance[:, :7, :7] + np.diag([0.1, 0.1, 0.05, 0.1, 0.05, 0.05, 0.05])
        beliefs = motion.update(beliefs, boxes, None)
        for k, reference in enumerate(references):
            moved, jacobian = (each[0] for each in advance(reference.x[None], 0.1))
            reference.F, reference.Q = jacobian, jacobian @ growth @ jacobian.T * 0.05 + growth * 0.05
            reference.predict_x = lambda u=0, reference=reference, moved=moved: setattr(reference, "x", moved)
            reference.predict()
            reference.update(boxes[k], lambda _: np.eye(7, size), lambda x: x[:7])
            np.testing.assert_allclose(innovation_covariance[k], reference.S, atol=1e-9)
    np.testing.assert_allclose(beliefs.mean, [reference.x for reference in references], atol=1e-9)
    np.testing.assert_allclose(beliefs.covariance, [reference.P for reference in references], atol=1e-9)


@MODELS
def test_a_turned_world_gives_turned_tracks(motion: Motion) -> None:
    truth = drive(3.0, 8.0, 0.3)
    angle = 2.0
    turn = np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
    turned = truth.copy()
    turned[:, :2] = truth[:, :2] @ turn
    turned[:, 6] += angle
    results = []
    for boxes in (truth, turned):
        beliefs = motion.initiate(boxes[:1], None)
        for box in boxes[1:]:
            beliefs = motion.update(motion.predict(beliefs, 0.1), box[None], None)
        results.append((motion.boxes(beliefs), motion.velocity(beliefs)))
    np.testing.assert_allclose(results[1][1], results[0][1] @ turn, atol=1e-9)
    np.testing.assert_allclose(results[1][0][:, :2], results[0][0][:, :2] @ turn, atol=1e-9)
    np.testing.assert_allclose(wrap_angle(results[1][0][:, 6] - results[0][0][:, 6] - angle), 0, atol=1e-9)


@MODELS
def test_a_detector_that_confuses_front_and_back_turns_no_track(motion: Motion) -> None:
    wrong = np.random.default_rng(1).random((50, 100)) < 0.3
    wrong[0] = False
    history = track(motion, drive(5.0, 10.0), wrong, count=100)
    for beliefs in history:
        assert (np.cos(motion.boxes(beliefs)[:, 6] - 0.5) > 0.5).all()
    for beliefs in history[20:]:
        velocity = motion.velocity(beliefs)
        assert (np.abs(velocity - [10 * np.cos(0.5), 10 * np.sin(0.5)]) < 4).all()
    error = motion.velocity(history[-1]) - [10 * np.cos(0.5), 10 * np.sin(0.5)]
    assert np.sqrt((error**2).mean()) < 0.6


@TURNING
def test_a_track_born_with_the_wrong_heading_recovers(motion: Motion) -> None:
    wrong = np.random.default_rng(1).random((30, 100)) < 0.3
    wrong[0] = True
    history = track(motion, drive(3.0, 8.0), wrong, count=100)
    assert (np.cos(motion.boxes(history[0])[:, 6] - 0.5) < -0.5).all()
    assert (np.cos(motion.boxes(history[5])[:, 6] - 0.5) > 0.5).all()
    assert (motion.velocity(history[5]) @ [np.cos(0.5), np.sin(0.5)] > 5).all()


@TURNING
def test_a_car_may_reverse_slowly_and_a_walker_does_not(motion: ConstantTurnRate) -> None:
    wrong = np.zeros((40, 100), dtype=bool)
    reversing = track(motion, drive(4.0, -0.7), wrong, count=100)[-1]
    assert (np.cos(motion.boxes(reversing)[:, 6] - 0.5) > 0.5).mean() > 0.95
    walker = replace(motion, reverse_speed_mps=0.2, process_speed_variance_per_s=0.5)
    wrong[0] = True
    walking = track(walker, drive(4.0, 1.4), wrong, count=100)[-1]
    assert (np.cos(walker.boxes(walking)[:, 6] - 0.5) > 0.5).mean() > 0.95


@TURNING
def test_facing_forward_tells_the_same_motion_from_the_other_end(motion: Motion) -> None:
    size = motion.initiate(np.zeros((1, 7)), None).mean.shape[1]
    backwards = np.array([[1.0, 2, 0, 4, 2, 1.5, 0.3, -9, 0.4, 0.1, -1.5]])[:, :size]
    root = np.random.default_rng(0).normal(size=(1, size, size)) * 0.3
    before = Beliefs(backwards, root @ root.transpose(0, 2, 1))
    after = face_forwards(before, 1.0)
    assert after.mean[0, SPEED] == 9.0
    np.testing.assert_allclose(motion.velocity(after), motion.velocity(before), atol=1e-12)
    first, second = motion.predict(before, 0.8), motion.predict(after, 0.8)
    np.testing.assert_allclose(second.mean[:, :6], first.mean[:, :6], atol=1e-12)
    np.testing.assert_allclose(second.covariance[:, :7, :7], first.covariance[:, :7, :7], atol=1e-12)


def test_a_turning_car_is_predicted_better_by_the_models_that_turn() -> None:
    truth = drive(6.0, 8.0, 0.5)
    errors = []
    for motion in (ConstantVelocity(), CTRV, CTRA):
        history = track(motion, truth, np.zeros((60, 50), dtype=bool), count=50)
        ahead = motion.boxes(motion.predict(history[-11], 1.0))[:, :2] - truth[-1, :2]
        errors.append(np.linalg.norm(ahead, axis=1).mean())
    assert errors[1] < 1.2 and errors[2] < 1.4 and errors[0] > 3 * errors[2]


@TURNING
def test_beliefs_are_as_sure_as_they_are_right(motion: Motion) -> None:
    """The normalised squared error of a predicted position is 2 on average where a filter is consistent."""
    truth = drive(6.0, 8.0, 0.3)
    history = track(motion, truth, np.zeros((60, 100), dtype=bool), count=100)
    squares = []
    for beliefs, box in zip(history[10:-1], truth[11:], strict=True):
        ahead = motion.predict(beliefs, 0.1)
        error = ahead.mean[:, :2] - box[:2]
        squares.append((error[:, None] @ np.linalg.inv(ahead.covariance[:, :2, :2]) @ error[:, :, None]).mean())
    assert 0.4 < np.mean(squares) < 2.5


@MODELS
def test_no_time_changes_nothing(motion: Motion) -> None:
    beliefs = track(motion, drive(1.0, 8.0, 0.3, yaw=3.0), np.zeros((10, 3)), count=3)[-1]
    after = motion.predict(beliefs, 0.0)
    assert np.array_equal(after.mean, beliefs.mean) and np.array_equal(after.covariance, beliefs.covariance)


@MODELS
def test_every_track_is_filtered_as_if_it_were_alone(motion: Motion) -> None:
    boxes = np.random.default_rng(0).normal(size=(6, 7))
    together = motion.update(motion.predict(motion.initiate(boxes, None), 0.1), boxes + 0.1, None)
    for k in range(6):
        one = boxes[k : k + 1]
        alone = motion.update(motion.predict(motion.initiate(one, None), 0.1), one + 0.1, None)
        np.testing.assert_allclose(together.mean[k], alone.mean[0], atol=1e-12)
        np.testing.assert_allclose(together.covariance[k], alone.covariance[0], rtol=1e-9, atol=1e-12)


@MODELS
@pytest.mark.parametrize(
    "bad",
    [np.full((7, 7), np.nan), np.diag([np.inf] * 7), np.zeros((7, 7)), -np.eye(7), np.eye(7, k=1) * 1e9 + np.eye(7)],
    ids=["nan", "infinite", "singular", "negative", "skew"],
)
def test_a_bad_covariance_is_replaced_and_poisons_nothing(motion: Motion, bad: np.ndarray) -> None:
    boxes = np.random.default_rng(0).normal(size=(3, 7))
    good = np.eye(7) * 0.3
    born = motion.initiate(boxes, np.stack([good, bad, good]))
    start = motion.predict(born, 0.1)
    after = motion.update(start, boxes + 0.1, np.stack([good, bad, good]))
    stated, own = motion.update(start, boxes + 0.1, np.stack([good] * 3)), motion.update(start, boxes + 0.1, None)
    for k, expected in enumerate([stated, own, stated]):
        np.testing.assert_allclose(after.mean[k], expected.mean[k], atol=1e-12)
        np.testing.assert_allclose(after.covariance[k], expected.covariance[k], atol=1e-9)
    np.testing.assert_array_equal(born.covariance[1], motion.initiate(boxes, None).covariance[1])


@TURNING
@given(st.lists(st.tuples(st.floats(0, 2), st.booleans()), min_size=1, max_size=40), st.integers(0, 2**31))
def test_covariances_stay_symmetric_and_positive_definite(
    motion: Motion, steps: list[tuple[float, bool]], seed: int
) -> None:
    rng = np.random.default_rng(seed)
    beliefs = motion.initiate(rng.normal(size=(3, 7)), None)
    for dt_s, seen in steps:
        beliefs = motion.predict(beliefs, dt_s)
        if seen:
            beliefs = motion.update(beliefs, rng.normal(scale=100, size=(3, 7)), None)
    assert_covariances(beliefs)


@MODELS
def test_covariances_last_for_ten_thousand_steps_with_misses(motion: Motion) -> None:
    rng = np.random.default_rng(0)
    noise = np.eye(7) * np.repeat([1e-6, 0.1], 4)[:, None, None]  # four tracks of each variance
    beliefs = motion.initiate(np.zeros((8, 7)), noise)
    for _ in range(10_000):
        beliefs = motion.predict(beliefs, rng.choice([0.0, 0.05, 0.1, 0.5]))
        if rng.random() < 0.5:
            beliefs = motion.update(beliefs, rng.normal(size=(8, 7)), noise)
    assert_covariances(beliefs)


@MODELS
def test_a_track_can_be_missed_ten_thousand_times_and_found_again(motion: Motion) -> None:
    beliefs = track(motion, drive(3.0, 10.0, 0.3), np.zeros((30, 1)))[-1]
    for _ in range(10_000):
        beliefs = motion.predict(beliefs, 0.1)
    assert_covariances(beliefs)
    found = motion.update(beliefs, np.array([[50.0, 60, 0, 4.5, 1.9, 1.6, 0.2]]), None)
    assert_covariances(found)
    np.testing.assert_allclose(motion.boxes(found)[0, :2], [50, 60], atol=0.1)


def assert_covariances(beliefs: Beliefs) -> None:
    assert np.isfinite(beliefs.mean).all()
    np.testing.assert_allclose(beliefs.covariance, beliefs.covariance.transpose(0, 2, 1), rtol=1e-12)
    assert (np.linalg.eigvalsh(beliefs.covariance) > 0).all()


@MODELS
def test_no_tracks_are_fine(motion: Motion) -> None:
    for covariance in (None, np.zeros((0, 7, 7))):
        none = motion.update(
            motion.predict(motion.initiate(np.zeros((0, 7)), covariance), 0.1), np.zeros((0, 7)), covariance
        )
        assert motion.boxes(none).shape == (0, 7) and motion.velocity(none).shape == (0, 2)


@pytest.mark.parametrize("model", [ConstantVelocity, ConstantTurnRate, ConstantTurnRateAcceleration])
def test_variances_are_one_number_or_seven(model: type[ConstantVelocity]) -> None:
    boxes = np.zeros((1, 7))
    for given_, expected in ((2, [2.0] * 7), (np.arange(1, 8), np.arange(1.0, 8))):
        motion = model(measurement_variance=given_, initial_variance=given_)
        born = motion.initiate(boxes, None)
        np.testing.assert_array_equal(born.covariance[0, :7, :7], np.diag(expected))
        updated = motion.update(born, boxes, None)
        np.testing.assert_allclose(updated.covariance[0, :7, :7], np.diag(expected) / 2)
        hash(motion)


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"measurement_variance": (1.0, 2.0)}, r"measurement_variance must be a number, or 7, got \(1.0, 2.0\)"),
        ({"process_variance_per_s": (1, 1, 1, 0, 1, 1, 1)}, r"process_variance_per_s\[3\] must be a finite number > 0"),
        ({"initial_variance": np.nan}, "initial_variance must be a finite number > 0, got nan"),
        ({"initial_speed_variance": [1.0] * 7}, "initial_speed_variance must be a number, got"),
        ({"reverse_speed_mps": -1}, "reverse_speed_mps must be a finite number > 0, got -1"),
        ({"initial_acceleration_variance": "much"}, "initial_acceleration_variance must be a finite number > 0"),
    ],
)
def test_wrong_settings_are_refused(settings: dict[str, object], message: str) -> None:
    with pytest.raises(InvalidValueError, match=message):
        ConstantTurnRateAcceleration(**settings)  # type: ignore[arg-type]
