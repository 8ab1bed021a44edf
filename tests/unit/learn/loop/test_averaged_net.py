"""The moving average of weights."""

import torch
from torch import nn

from coopsim.learn.loop.train_loop import AveragedNet


def test_it_follows_slowly_and_counts_along() -> None:
    net = nn.BatchNorm1d(1)
    average = AveragedNet(net, 0.9)
    with torch.no_grad():
        net.weight.fill_(2.0)
        net.num_batches_tracked.fill_(7)
    expected = 1.0
    for step in range(200):
        average.update(net, step)
        decay = min(0.9, (1 + step) / (10 + step))
        expected = decay * expected + (1 - decay) * 2.0
        assert abs(average.net.state_dict()["weight"].item() - expected) < 1e-5
    assert average.net.state_dict()["num_batches_tracked"].item() == 7
    assert expected > 1.99 and net.weight.requires_grad and not average.net.training
