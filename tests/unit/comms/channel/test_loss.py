"""Bursts are as long, and losses as frequent, as the parameters say."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from coopsim.comms.channel.loss import BernoulliLoss, GilbertElliottLoss, Loss
from coopsim.errors import InvalidValueError


def run(loss: Loss, count: int, seed: int = 0) -> np.ndarray:
    rng, burst, lost = np.random.default_rng(seed), None, []
    for _ in range(count):
        gone, burst = loss.draw(rng, burst)
        lost.append(gone)
    return np.array(lost)


def test_bursts_have_the_mean_length_and_share_of_the_chain() -> None:
    loss = GilbertElliottLoss(begin=0.05, end=0.25)
    lost = run(loss, 40_000)
    starts = np.count_nonzero(lost[1:] & ~lost[:-1]) + lost[0]
    assert lost.sum() / starts == pytest.approx(1 / 0.25, rel=0.05)
    assert lost.mean() == pytest.approx(0.05 / 0.30, rel=0.05)


@given(loss_bad=st.floats(0, 1), loss_good=st.floats(0, 1))
def test_a_link_without_bursts_is_bernoulli(loss_bad: float, loss_good: float) -> None:
    lost = run(GilbertElliottLoss(0.0, 0.5, loss_bad, loss_good), 200)
    chances = np.random.default_rng(0).random((200, 2))[:, 1]
    np.testing.assert_array_equal(lost, chances < loss_good)


def test_the_first_message_finds_the_link_settled() -> None:
    first = [run(GilbertElliottLoss(0.1, 0.1), 1, seed)[0] for seed in range(2000)]
    assert np.mean(first) == pytest.approx(0.5, abs=0.04)


@pytest.mark.parametrize(
    ("make", "match"),
    [
        (lambda: GilbertElliottLoss(1.1, 0.5), r"begin must be in \[0, 1\], got 1.1"),
        (lambda: GilbertElliottLoss(0.1, 0.0), "end must be in"),
        (lambda: GilbertElliottLoss(0.1, 0.5, loss_bad=float("nan")), "loss_bad"),
        (lambda: GilbertElliottLoss(0.1, 0.5, loss_good=-1), "loss_good"),
        (lambda: BernoulliLoss(None), "probability must be"),  # type: ignore[arg-type]
    ],
)
def test_bad_loss(make, match: str) -> None:  # type: ignore[no-untyped-def]
    with pytest.raises(InvalidValueError, match=match):
        make()
