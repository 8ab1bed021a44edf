"""Networks at work run on one thread of torch each, and leave torch as it was."""

from __future__ import annotations

from collections.abc import Iterator
from threading import Barrier, get_ident

import pytest

torch = pytest.importorskip("torch")

from coopsim.nn.inference.backend import PROCESSOR, Backend, find_backend  # noqa: E402


@pytest.fixture(autouse=True)
def two_threads() -> Iterator[None]:
    before = torch.get_num_threads()
    torch.set_num_threads(2)
    yield
    torch.set_num_threads(before)


def process_threads() -> str:
    """The number of threads of the process' linear algebra, as torch tells it."""
    lines = torch.__config__.parallel_info().splitlines()
    return next((line.split()[-1] for line in lines if "mkl_get_max_threads" in line), "1")


def test_torch_is_left_as_it_was() -> None:
    with PROCESSOR.inference():
        assert torch.get_num_threads() == 1 and torch.is_inference_mode_enabled()
        with PROCESSOR.inference():
            pass
        assert torch.get_num_threads() == 1
    assert torch.get_num_threads() == 2 and not torch.is_inference_mode_enabled()


@pytest.mark.parametrize("precision", ["float32", "bfloat16"])
def test_a_task_gives_the_same_on_any_thread(precision: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("COOPSIM_PRECISION", precision)
    draws = torch.Generator().manual_seed(1)
    values, weights = (torch.randn(40, 40, generator=draws) for _ in range(2))
    both = Barrier(2)

    def task() -> tuple[int, torch.Tensor, torch.Tensor]:
        both.wait(10)  # each thread has one
        outside = values @ weights
        with find_backend().inference():
            return get_ident(), outside, values @ weights

    with torch.autocast("cpu", torch.bfloat16):  # of a caller's own
        (here, *one), (there, *other) = find_backend(threads=2).side_by_side([task, task])
    assert here != there and all(torch.equal(*each) for each in zip(one, other, strict=True))
    assert torch.equal(one[0], values @ weights)  # geometry is float32
    assert one[1].dtype == getattr(torch, precision)


def test_tasks_have_one_thread_until_the_last_one_ends() -> None:
    both, one_ended = Barrier(2), Barrier(2)

    def short() -> tuple[int, str]:
        with PROCESSOR.inference():
            both.wait(10)
        one_ended.wait(10)
        return torch.get_num_threads(), process_threads()

    def long() -> tuple[int, str]:
        with PROCESSOR.inference():
            both.wait(10)
            one_ended.wait(10)
            return torch.get_num_threads(), process_threads()

    assert Backend(threads=2).side_by_side([short, long]) == [(1, "1")] * 2
    assert torch.get_num_threads() == 2
