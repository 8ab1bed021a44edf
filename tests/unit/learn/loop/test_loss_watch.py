"""A training is stopped where it fails, and not before."""

from __future__ import annotations

import math

import pytest

from coopsim.errors import TrainingError
from coopsim.learn.loop.train_loop import LossWatch


@pytest.mark.parametrize(
    ("losses", "gradient", "message"),
    [
        ({"loss": math.nan, "heat": 1.0}, 1.0, "step 7: loss is nan; kept here"),
        ({"loss": 1.0, "heat": math.inf}, 1.0, "heat is inf"),
        ({"loss": 1.0}, math.nan, "the gradient's length is nan"),
    ],
)
def test_what_is_no_number_stops(losses: dict[str, float], gradient: float, message: str) -> None:
    with pytest.raises(TrainingError, match=message):
        LossWatch("kept here").check(7, losses, gradient)


def test_a_loss_that_stays_high_stops_and_a_short_peak_does_not() -> None:
    watch = LossWatch("kept here")
    for step in range(60):
        watch.check(step, {"loss": 2.0}, 1.0)
    for step in range(200):
        watch.check(step, {"loss": 30.0 if step % 50 else 2.0}, 1.0)
    with pytest.raises(TrainingError, match=r"step 200: the loss is 30, .* above 20, far above its median 2"):
        watch.check(200, {"loss": 30.0}, 1.0)  # the fiftieth in a row


def test_a_likelihood_that_falls_below_nought_is_no_divergence() -> None:
    watch = LossWatch("kept here")
    for step in range(2000):
        watch.check(step, {"loss": 4.0 - step / 300 + (step % 7) / 5}, 1.0)
    for step in range(49):
        watch.check(step, {"loss": 60.0}, 1.0)
    with pytest.raises(TrainingError, match="it diverges"):
        watch.check(49, {"loss": 60.0}, 1.0)
