"""The device of a training, and the numbers in which it computes there."""

from __future__ import annotations

import dataclasses
from typing import Any

import torch
from torch import Tensor

from coopsim.errors import InvalidValueError
from coopsim.support.precision import multiplies_bfloat16
from coopsim.support.precision import precision as setting


def find_device(name: str | None = None) -> torch.device:
    """Return a device by name, as "cuda" or "cuda:1"; None: a GPU if there is one, else the processor.

    Raises:
        InvalidValueError: there is no such device.
    """
    if name is None:
        name = "cuda" if torch.cuda.is_available() else "cpu"
    try:
        device = torch.device(name)
        torch.empty(1, device=device)
    except (RuntimeError, AssertionError) as error:  # torch without CUDA raises the latter
        reason = str(error).splitlines()[0] if name.startswith("cuda") else "torch cannot use it here"
        raise InvalidValueError(
            f"device must be cpu or a GPU that torch has, as cuda, got {name!r}: {reason}"
        ) from error
    return device


def autocast_type(precision: str, device: torch.device) -> torch.dtype | None:
    """Return the type of the quick arithmetic; None: float32 throughout. "auto" leaves it to the process' setting."""
    if precision == "auto":
        precision = setting()
    if precision == "float32" or (precision == "auto" and not _has_bfloat16(device)):
        return None
    return torch.bfloat16


def _has_bfloat16(device: torch.device) -> bool:
    """Return whether a device multiplies bfloat16 itself; a processor that does not is slower with it."""
    if device.type == "cuda":
        return bool(torch.cuda.is_bf16_supported())
    return multiplies_bfloat16()


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
