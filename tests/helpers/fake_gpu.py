"""A GPU in name only: tensors "on" it are the processor's, but where those of two devices meet there are its errors."""

from __future__ import annotations

from typing import Any

import pytest
import torch
from torch.overrides import TorchFunctionMode
from torch.utils._pytree import tree_leaves, tree_map

GPU = torch.device("cuda")
_LAYERS = {"conv2d", "linear", "bmm", "matmul", "scaled_dot_product_attention"}


class FakeGpu(TorchFunctionMode):
    """Within, "cuda" is a device. Results are those of the processor, bit for bit.

    Attributes:
        layers: number of calls of layers on the GPU.
        elsewhere: names of layers that were called on the processor.
    """

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        super().__init__()
        monkeypatch.setattr(torch.cuda, "is_available", lambda: True)
        monkeypatch.setattr(torch.cuda, "device_count", lambda: 1)
        monkeypatch.setattr(torch.cuda, "is_bf16_supported", lambda including_emulation=True: False)
        monkeypatch.setattr(torch.nn.Parameter, "__deepcopy__", _copied)
        self.layers = 0
        self.elsewhere: list[str] = []

    def __torch_function__(self, func: Any, types: Any, args: Any = (), kwargs: Any = None) -> Any:
        kwargs = dict(kwargs or {})
        if func == torch.Tensor.device.__get__:
            return GPU if is_on_gpu(args[0]) else func(*args)
        name = getattr(func, "__name__", "")
        if name == "to" and len(args) > 1 and isinstance(args[1], str):
            args = (args[0], torch.device(args[1]), *args[2:])
        given = [each for each in tree_leaves((args, kwargs)) if isinstance(each, torch.Tensor)]
        wanted = next((each for each in tree_leaves((args, kwargs)) if isinstance(each, torch.device)), None)
        if name == "_parse_to":  # of `Module.to`
            return func(*args, **kwargs)
        if name == "__set__":
            if func == torch.Tensor.data.__set__:
                _mark(args[0], is_on_gpu(args[1]))
            return func(*args)
        if func == torch.Tensor.grad.__get__:  # made by `backward`, where the tensor is
            if (gradient := func(*args)) is not None:
                _mark(gradient, is_on_gpu(args[0]))
            return gradient
        if name in ("numpy", "__array__") and is_on_gpu(args[0]) and not kwargs.get("force"):
            raise TypeError("can't convert cuda:0 device type tensor to numpy")
        if name == "__deepcopy__":  # its second argument has the copies that were made before, of any device
            copied = func(*args, **kwargs)
            _mark(copied, is_on_gpu(args[0]))
            return copied
        if name == "to" and len(given) == 2:
            wanted = GPU if is_on_gpu(given[1]) else torch.device("cpu")
        if wanted is None and name not in ("copy_", "__get__", "_has_compatible_shallow_copy_type"):
            _require_one_device(name, given)
        if name in _LAYERS and any(each.dim() > 1 for each in given):
            self.layers += is_on_gpu(given[0])
            self.elsewhere += [] if is_on_gpu(given[0]) else [name]
        on_gpu = any(map(is_on_gpu, given)) if wanted is None else wanted.type == "cuda"
        if name in ("cpu", "numpy"):
            on_gpu = False
        args, kwargs = tree_map(_really, (args, kwargs))
        made = func(*args, **kwargs)
        moves = wanted is not None or name in ("cpu", "numpy")
        own = [] if moves else given  # what is changed in place stays where it is
        return tree_map(lambda each: each if any(each is one for one in own) else _placed(each, on_gpu, moves), made)


def is_on_gpu(tensor: torch.Tensor) -> bool:
    """Return whether a tensor is taken to be on the GPU."""
    return bool(tensor.__dict__.get("on_gpu", False))


def _mark(tensor: torch.Tensor, on_gpu: bool) -> None:
    tensor.__dict__["on_gpu"] = on_gpu


_copy = torch.nn.Parameter.__deepcopy__


def _copied(parameter: torch.nn.Parameter, memo: dict[int, Any]) -> torch.nn.Parameter:
    """Return a copy on the same device."""
    made = _copy(parameter, memo)
    _mark(made, is_on_gpu(parameter))
    return made


def _placed(made: Any, on_gpu: bool, moves: bool) -> Any:
    if isinstance(made, torch.Tensor) and is_on_gpu(made) != on_gpu:
        made = made.clone() if moves else made  # a move to another device copies; a view stays one
        _mark(made, on_gpu)
    return made


def _really(given: Any) -> Any:
    return torch.device("cpu") if isinstance(given, torch.device) else given


def _require_one_device(name: str, given: list[torch.Tensor]) -> None:
    """Raise as torch does; tensors of one number may come from the processor."""
    if any(map(is_on_gpu, given)) and any(each.dim() and not is_on_gpu(each) for each in given):
        shapes = [(tuple(each.shape), "cuda" if is_on_gpu(each) else "cpu") for each in given]
        raise RuntimeError(f"{name}: Expected all tensors to be on the same device, but got {shapes}")
