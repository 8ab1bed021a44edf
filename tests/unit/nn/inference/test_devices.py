"""Devices by name, and types of numbers."""

from dataclasses import dataclass
from typing import Any

import pytest

torch = pytest.importorskip("torch")

from coopsim.errors import InvalidValueError  # noqa: E402
from coopsim.nn.inference import backend  # noqa: E402
from coopsim.nn.inference.backend import find_device, numbers_on, to_device  # noqa: E402

CPU, GPU = torch.device("cpu"), torch.device("cuda")


@pytest.fixture
def two_gpus(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(torch.cuda, "is_available", lambda: True)
    monkeypatch.setattr(torch.cuda, "device_count", lambda: 2)


@pytest.fixture
def no_gpu(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(torch.cuda, "is_available", lambda: False)


@dataclass(frozen=True)
class Batch:
    maps: torch.Tensor
    parts: tuple[Any, ...]
    count: int


def test_all_tensors_of_a_batch_move() -> None:
    batch = Batch(torch.zeros(2), ([torch.ones(1)], {"x": torch.ones(1)}), 3)
    moved = to_device(batch, torch.device("meta"))
    assert moved.maps.is_meta and moved.parts[0][0].is_meta and moved.parts[1]["x"].is_meta and moved.count == 3
    assert to_device(batch, CPU) is batch


@pytest.mark.parametrize(("precision", "setting"), [("auto", "{}"), ("{}", "auto"), ("{}", "float32")])
@pytest.mark.parametrize("name", ["float32", "bfloat16"])
def test_the_precision_that_is_asked_for_goes_before_the_setting(
    precision: str, setting: str, name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("COOPSIM_PRECISION", setting.format(name))
    assert numbers_on(CPU, precision.format(name)) is getattr(torch, name)


@pytest.mark.parametrize("has", [True, False])
def test_auto_asks_the_device(has: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("COOPSIM_PRECISION", "auto")
    monkeypatch.setattr(backend, "multiplies_bfloat16", lambda: has)
    monkeypatch.setattr(torch.cuda, "is_bf16_supported", lambda including_emulation: not (has or including_emulation))
    assert numbers_on(CPU) is (torch.bfloat16 if has else torch.float32)
    assert numbers_on(GPU) is (torch.float32 if has else torch.bfloat16)


def test_gpus_are_found_by_name(two_gpus: None) -> None:
    for name in ("cpu", "cuda", "cuda:0", "cuda:1"):
        assert find_device(name) == torch.device(name)
    assert find_device("auto") == GPU
    with pytest.raises(InvalidValueError, match=r"one that is here \(cpu, cuda, cuda:0, cuda:1\), got 'cuda:2'$"):
        find_device("cuda:2")


@pytest.mark.parametrize(("name", "why"), [("cuda", ": torch finds no GPU"), ("cuda:1", ": torch finds no GPU"),
    ("abacus", ""), ("meta", ""), (None, "")])  # fmt: skip
def test_a_device_that_is_not_there_is_one_error(name: Any, why: str, no_gpu: None) -> None:
    assert find_device("auto") == find_device("cpu") == CPU
    with pytest.raises(InvalidValueError, match=rf"auto or one that is here \(cpu\), got {name!r}{why}$"):
        find_device(name)
