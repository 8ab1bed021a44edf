"""The code of delays: real numbers, zero for what is not late."""

from __future__ import annotations

import pytest

torch = pytest.importorskip("torch")
from coopsim.nn.attention import DelayCode  # noqa: E402

WIDTH = 16


def codes(*delays_s: float) -> torch.Tensor:
    """Return what is added for delays, (S, WIDTH)."""
    code = DelayCode(WIDTH)
    with torch.no_grad():
        code.code.weight.copy_(torch.randn(code.code.weight.shape, generator=torch.Generator().manual_seed(0)))
        return code(torch.zeros(1 + len(delays_s), 1, 1, WIDTH), torch.tensor(delays_s))[1:, 0, 0]


def test_nothing_is_added_to_what_is_not_late_nor_to_the_receivers_own() -> None:
    assert not codes(0.0).any()
    tokens = torch.ones(2, 1, 1, WIDTH)
    assert torch.equal(DelayCode(WIDTH)(tokens, torch.tensor([0.4]))[0], tokens[0])


def test_delays_between_frames_have_codes_between_theirs() -> None:
    """A table of frames has none for 0.14 s, or that of 0.1 s."""
    found = codes(0.10, 0.14, 0.18)
    assert (found[1] - found[0]).norm() > 0.1
    assert (found[1] - (found[0] + found[2]) / 2).norm() < 0.5 * (found[2] - found[0]).norm()


def test_each_delay_of_a_training_has_a_code_of_its_own() -> None:
    found = codes(*[0.05 * k for k in range(21)])
    apart = (found[:, None] - found[None]).norm(dim=-1) + 10 * torch.eye(21)
    assert apart.min() > 0.1


def test_delays_that_no_message_has_are_finite() -> None:
    assert torch.equal(codes(-1.0, 1e9), codes(0.0, 10.0))
