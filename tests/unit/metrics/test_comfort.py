"""Comfort has nuPlan's six bounds, each of which one motion by hand breaks, and one a little gentler keeps."""

import numpy as np
import pytest

from coopsim.metrics.comfort import uncomfortable

DT_S, FRAMES = 0.1, 60
STILL = np.zeros(FRAMES)
TIME_S = DT_S * np.arange(FRAMES)


def share(acceleration: object = STILL, speed: object = STILL, heading: object = STILL) -> float:
    """Return the share of uncomfortable frames, per cent."""
    rows = [np.broadcast_to(np.asarray(each, float), FRAMES) for each in (acceleration, speed, heading)]
    return 100 * float(uncomfortable(*rows, DT_S).mean())


@pytest.mark.parametrize(("kept", "broken"), [(2.35, 2.45), (-4.0, -4.1)])
def test_steady_acceleration_along_the_road(kept: float, broken: float) -> None:
    assert share(kept) == 0
    assert share(broken) == 100


@pytest.mark.parametrize(("speed", "kept", "broken"), [(20.0, 0.24, 0.25), (1.0, 0.94, 0.96)])
def test_steady_turns_at_the_bounds_of_acceleration_across_and_of_yaw_rate(
    speed: float, kept: float, broken: float
) -> None:
    """4.89 m/s² are 0.2445 rad/s at 20 m/s; at 1 m/s 0.95 rad/s come first."""
    assert share(0.0, speed, kept * TIME_S) == 0
    assert share(0.0, speed, broken * TIME_S) > 90


def test_a_turn_that_quickens_breaks_the_bound_of_yaw_acceleration() -> None:
    near = TIME_S - TIME_S.mean()
    short = np.where(np.abs(near) < 0.4, near, 0.4 * np.sign(near))
    slow, fast = (each / 2 * short**2 for each in (1.8, 2.1))
    assert np.abs(np.gradient(fast, DT_S)).max() < 0.95
    assert share(0.0, 0.0, slow) < share(0.0, 0.0, fast)
    assert share(0.0, 0.0, fast) > 0


@pytest.mark.parametrize(("jerk", "broken"), [(4.1, False), (4.4, True)])
def test_jerk_along_the_road(jerk: float, broken: bool) -> None:
    """A ramp between the bounds of acceleration, about as long as the filter's window."""
    ramp = np.clip(jerk * (TIME_S - 3.0), -4.0, 2.35)
    assert (share(ramp) > 0) is broken


def test_a_short_brake_counts_by_its_filtered_value() -> None:
    """nuPlan's filter of 0.8 s leaves little of a brake of one frame, and all of one that lasts."""
    one, many = STILL.copy(), STILL.copy()
    one[30], many[20:40] = -6.0, -6.0
    assert share(one) < 5 < 30 < share(many)


@pytest.mark.parametrize("frames", [1, 2, 3])
def test_drives_of_few_frames_have_accelerations_but_no_slopes(frames: int) -> None:
    strong, still = np.full(frames, -5.0), np.zeros(frames)
    assert uncomfortable(strong, still, still, DT_S).all()
    assert not uncomfortable(still, still, still, DT_S).any()


def test_other_steps_have_windows_as_long() -> None:
    coarse, fine = (np.where(np.arange(0, 6, dt) < 3, 0.0, -6.0) for dt in (0.2, 0.05))
    shares = [uncomfortable(each, 0 * each, 0 * each, dt).mean() for each, dt in ((coarse, 0.2), (fine, 0.05))]
    assert shares[0] == pytest.approx(shares[1], abs=0.06)
