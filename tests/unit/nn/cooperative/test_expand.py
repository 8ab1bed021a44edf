"""Expansion: delay has the effect that was learned, and none at 0."""

from __future__ import annotations

import pytest

torch = pytest.importorskip("torch")
from coopsim.nn.cooperative.cooperative_net import Expand  # noqa: E402

torch.set_num_threads(1)


def maps(senders: int) -> torch.Tensor:
    return torch.randn(senders, 4, 6, 7, generator=torch.Generator().manual_seed(1))


def learned() -> Expand:
    """Return an expansion that does something about delays."""
    expand = Expand(4, 8)
    with torch.no_grad():
        weights = expand.delayed.weight
        weights.copy_(torch.randn(weights.shape, generator=torch.Generator().manual_seed(2)) * 0.2)
    return expand


def test_delay_is_without_effect_until_learned() -> None:
    expand = Expand(4, 8)
    assert torch.equal(expand(maps(2), torch.tensor([0.0, 0.0])), expand(maps(2), torch.tensor([0.4, 9.0])))


def test_learning_about_delays_leaves_what_is_not_late_alone() -> None:
    before, after = Expand(4, 8), learned()
    before.hidden.load_state_dict(after.hidden.state_dict())
    before.mix.load_state_dict(after.mix.state_dict())
    now = torch.zeros(2)
    assert torch.equal(before(maps(2), now), after(maps(2), now))
    late = after(maps(2), torch.tensor([0.3, 0.0]))
    assert (late[0] - after(maps(2), now)[0]).abs().max() > 0.05
    assert torch.allclose(late[1], after(maps(2), now)[1])


def test_any_delay_gives_finite_non_negative_features() -> None:
    out = learned()(maps(3), torch.tensor([1e9, -5.0, 0.25]))
    assert out.isfinite().all() and (out >= 0).all() and out.any()


def test_gradients_reach_delay_weights_from_their_zeros() -> None:
    expand = Expand(4, 8)
    expand(maps(2), torch.tensor([0.2, 0.0])).sum().backward()
    assert expand.delayed.weight.grad is not None and expand.delayed.weight.grad.any()
