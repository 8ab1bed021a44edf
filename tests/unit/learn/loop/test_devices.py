"""Devices and types of numbers."""

from dataclasses import dataclass
from typing import Any

import pytest
import torch

from coopsim.errors import InvalidValueError
from coopsim.learn.loop.devices import autocast_type, find_device, to_device


@dataclass(frozen=True)
class Batch:
    maps: torch.Tensor
    parts: tuple[Any, ...]
    count: int


def test_all_tensors_of_a_batch_move() -> None:
    batch = Batch(torch.zeros(2), ([torch.ones(1)], {"x": torch.ones(1)}), 3)
    moved = to_device(batch, torch.device("meta"))
    assert moved.maps.is_meta and moved.parts[0][0].is_meta and moved.parts[1]["x"].is_meta and moved.count == 3
    assert to_device(batch, torch.device("cpu")) is batch


def test_what_is_asked_for_is_used() -> None:
    cpu = torch.device("cpu")
    assert autocast_type("float32", cpu) is None and autocast_type("bfloat16", cpu) is torch.bfloat16
    assert autocast_type("auto", cpu) in (None, torch.bfloat16)
    assert find_device("cpu") == cpu
    with pytest.raises(InvalidValueError, match="device must be cpu or a GPU"):
        find_device("cuda:99")
