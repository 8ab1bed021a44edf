"""Devices on which networks compute, by name, and the numbers in which they multiply there."""

from __future__ import annotations

import dataclasses
import re
from typing import Any

import torch
from torch import Tensor

from coopsim.errors import InvalidValueError
from coopsim.support.precision import multiplies_bfloat16
from coopsim.support.precision import precision as setting


def find_device(name: str = "cpu") -> torch.device:
    """Return a device by name: "cpu", "cuda", "cuda:1", or "auto" for a GPU if there is one, else the processor.

    Raises:
        InvalidValueError: there is no such device; the message names those that are there.
    """
    gpus = torch.cuda.device_count() if torch.cuda.is_available() else 0
    if name == "auto":
        name = "cuda" if gpus else "cpu"
    there = ["cpu", *["cuda"] * (gpus > 0), *(f"cuda:{number}" for number in range(gpus))]
    if name not in there:
        why = "" if gpus or not re.fullmatch(r"cuda(:\d+)?", str(name)) else ": torch finds no GPU"
        raise InvalidValueError(f"device must be auto or one that is here ({', '.join(there)}), got {name!r}{why}")
    return torch.device(name)


def numbers_on(device: torch.device, precision: str = "auto") -> torch.dtype:
    """Return the numbers in which networks multiply on a device; "auto" leaves that to the process' setting.

    With that "auto", too, they are bfloat16 where the device multiplies it itself.
    """
    chosen = setting() if precision == "auto" else precision
    if chosen == "auto":
        cuda = device.type == "cuda"
        has = torch.cuda.is_bf16_supported(including_emulation=False) if cuda else multiplies_bfloat16()
        chosen = "bfloat16" if has else "float32"
    return torch.bfloat16 if chosen == "bfloat16" else torch.float32


def to_device(batch: Any, device: torch.device) -> Any:
    """Return a batch with all its tensors on a device: tensors in dataclasses, lists, tuples and mappings."""
    if device.type == "cpu":
        return batch
    if isinstance(batch, Tensor):
        return batch.to(device, non_blocking=True)
    if dataclasses.is_dataclass(batch) and not isinstance(batch, type):
        moved = {each.name: to_device(getattr(batch, each.name), device) for each in dataclasses.fields(batch)}
        return dataclasses.replace(batch, **moved)
    if isinstance(batch, (list, tuple)):
        return type(batch)(to_device(each, device) for each in batch)
    if isinstance(batch, dict):
        return {key: to_device(value, device) for key, value in batch.items()}
    return batch
