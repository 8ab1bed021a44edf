"""The state of a training in a file: all of it, in the same memory layout, and of no other training."""

from __future__ import annotations

from pathlib import Path

import pytest
import torch
from torch import nn

from coopsim.errors import InvalidValueError
from coopsim.learn.loop.checkpoint import CHECKPOINT, Checkpoint, load_checkpoint, save_checkpoint
from coopsim.learn.loop.train_loop import AveragedNet
from coopsim.learn.samples.sample_order import Position
from coopsim.learn.tensor_file import write_tensors

RUN = {"recipe": {"lr": 0.1, "steps": 5}, "seed": 1}


def make(steps: int) -> tuple[nn.Module, nn.Module, torch.optim.AdamW]:
    net = nn.Conv2d(4, 4, 3)
    net.to(memory_format=torch.channels_last)  # type: ignore[call-overload]
    with torch.no_grad():
        for each in net.parameters():
            each.copy_(torch.linspace(0, 1, each.numel()).view(each.shape))
    adam = torch.optim.AdamW(net.parameters())
    average = AveragedNet(net, 0.5)
    for step in range(steps):
        net(torch.ones(1, 4, 5, 5) * step).square().mean().backward()
        adam.step()
        average.update(net, step)
    return net, average.net, adam


def test_all_comes_back_in_the_same_layout(tmp_path: Path) -> None:
    state = Checkpoint(3, Position(1, 1, 2), RUN)
    saved, empty = make(3), make(0)
    assert load_checkpoint(tmp_path, RUN, *empty) is None
    save_checkpoint(tmp_path, state, *saved)
    assert load_checkpoint(tmp_path, RUN, *empty) == state
    for before, after in zip(saved[:2], empty[:2], strict=True):
        assert all(torch.equal(after.state_dict()[name], value) for name, value in before.state_dict().items())
    for before, after in zip(saved[0].parameters(), empty[0].parameters(), strict=True):
        mine, other = saved[2].state[before], empty[2].state[after]
        assert before.stride() == after.stride()
        assert mine.keys() == other.keys() and all(torch.equal(mine[key], other[key]) for key in mine)
        assert mine["exp_avg"].stride() == other["exp_avg"].stride()


def test_another_training_and_broken_files_are_refused(tmp_path: Path) -> None:
    save_checkpoint(tmp_path, Checkpoint(3, Position(), RUN), *make(1))
    with pytest.raises(InvalidValueError, match=r"another training \(seed: 1 there, 2 here\)"):
        load_checkpoint(tmp_path, {**RUN, "seed": 2}, *make(0))
    with pytest.raises(InvalidValueError, match=r"another folder\. To train longer, begin with its weights .*--start"):
        load_checkpoint(tmp_path, {**RUN, "recipe": {"steps": 10**6}}, *make(0))
    write_tensors(tmp_path / CHECKPOINT, {}, {"training": "{}"})
    with pytest.raises(InvalidValueError, match="is no checkpoint"):
        load_checkpoint(tmp_path, RUN, *make(0))
    (tmp_path / CHECKPOINT).write_bytes(b"\0" * 100)
    with pytest.raises(InvalidValueError, match="is no "):
        load_checkpoint(tmp_path, RUN, *make(0))
