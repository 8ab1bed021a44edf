"""The learning rate of every step."""

import pytest
import torch

from coopsim.learn.loop.train_loop import one_cycle


def test_it_is_that_of_torch() -> None:
    adam = torch.optim.AdamW([torch.nn.Parameter(torch.zeros(1))])
    schedule = torch.optim.lr_scheduler.OneCycleLR(
        adam, 0.002, total_steps=101, cycle_momentum=False, pct_start=31 / 101, final_div_factor=400
    )
    theirs = []
    for _ in range(101):
        theirs.append(schedule.get_last_lr()[0])
        adam.step()
        if len(theirs) < 101:
            schedule.step()
    ours = [one_cycle(step, 101, 0.002, rising=30 / 101) for step in range(101)]
    assert ours == pytest.approx(theirs)


@pytest.mark.parametrize("steps", [1, 2, 3, 10])
def test_short_trainings_have_rates_too(steps: int) -> None:
    assert all(0 < one_cycle(step, steps, 1.0) <= 1 for step in range(steps))
