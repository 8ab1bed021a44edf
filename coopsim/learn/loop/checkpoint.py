"""The state of a training between two steps, in one file that is replaced whole."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import torch
from torch import Tensor, nn

from coopsim.errors import InvalidValueError
from coopsim.learn.samples.sample_order import Position
from coopsim.learn.tensor_file import read_header, read_tensors, write_tensors

CHECKPOINT = "checkpoint.safetensors"
"""Name of the file in a training's folder."""

_MOST_BYTES = 2**32
_ADAM = ("exp_avg", "exp_avg_sq", "step")


@dataclass(frozen=True, slots=True)
class Checkpoint:
    """Training state besides tensors.

    Attributes:
        step: number of steps taken.
        position: position in the data.
        run: recipe and seed, as plain data.
    """

    step: int
    position: Position
    run: Mapping[str, Any]


def save_checkpoint(folder: Path, state: Checkpoint, net: nn.Module, average: nn.Module, adam: Any) -> None:
    """Replace the folder's checkpoint: state, network, its moving average, and the optimizer (`torch.optim.AdamW`)."""
    tensors = _net_tensors(net, average)
    for name, parameter in net.named_parameters():
        for key, value in adam.state.get(parameter, {}).items():
            tensors[f"adam.{key}/{name}"] = value
    said = {"step": state.step, "position": asdict(state.position), "run": state.run}
    write_tensors(folder / CHECKPOINT, tensors, {"training": json.dumps(said, sort_keys=True)})


def load_checkpoint(
    folder: Path, run: Mapping[str, Any], net: nn.Module, average: nn.Module, adam: Any
) -> Checkpoint | None:
    """Read a checkpoint into networks and optimizer; None: there is none, and nothing is changed.

    Raises:
        InvalidValueError: it is of another training, or broken.
    """
    path = folder / CHECKPOINT
    if not path.exists():
        return None
    found, texts = read_header(path, _MOST_BYTES)
    state = _state(path, texts)
    _require_same(folder, state.run, json.loads(json.dumps(run)))
    wanted, parameters = _net_tensors(net, average), dict(net.named_parameters())
    for name in found:
        kind, _, owner = name.partition("/")
        if owner in parameters and kind.removeprefix("adam.") in _ADAM:
            wanted[name] = torch.zeros(()) if kind == "adam.step" else parameters[owner]
    tensors = read_tensors(path, wanted, _MOST_BYTES)
    with torch.no_grad():
        for name, tensor in tensors.items():
            kind, _, owner = name.partition("/")
            if not kind.startswith("adam."):
                wanted[name].copy_(tensor)
                continue
            # Moments keep the memory layout of their parameter: another order of sums would be other bits.
            parameter = parameters[owner]
            kept = tensor if kind == "adam.step" else torch.empty_like(parameter).copy_(tensor)
            adam.state[parameter][kind.removeprefix("adam.")] = kept
    return state


def _net_tensors(net: nn.Module, average: nn.Module) -> dict[str, Tensor]:
    both = (("net", net), ("average", average))
    return {f"{kind}/{name}": value for kind, each in both for name, value in each.state_dict().items()}


def _state(path: Path, texts: Mapping[str, str]) -> Checkpoint:
    try:
        said = json.loads(texts["training"])
        return Checkpoint(int(said["step"]), Position(**said["position"]), dict(said["run"]))
    except (KeyError, TypeError, ValueError) as error:
        raise InvalidValueError(f"{path}: is no checkpoint of a training") from error


def _require_same(folder: Path, found: Mapping[str, Any], run: Mapping[str, Any]) -> None:
    flat_found, flat_run = _flat(found), _flat(run)
    other = sorted(key for key in flat_found.keys() | flat_run.keys() if flat_found.get(key) != flat_run.get(key))
    if other:
        changes = ", ".join(f"{key}: {flat_found.get(key)!r} there, {flat_run.get(key)!r} here" for key in other[:3])
        longer = ""
        if "recipe.steps" in other:
            longer = ". To train longer, begin with its weights in another folder: --start PATH.safetensors"
        raise InvalidValueError(
            f"{folder} holds another training ({changes}): go on with that, or take another folder{longer}"
        )


def _flat(data: Mapping[str, Any], above: str = "") -> dict[str, Any]:
    flat: dict[str, Any] = {}
    for key, value in data.items():
        flat |= _flat(value, f"{above}{key}.") if isinstance(value, dict) else {above + key: value}
    return flat
