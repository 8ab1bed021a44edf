"""Expansion: delay has the effect that was learned, and none at 0."""

from __future__ import annotations

import pytest

torch = pytest.importorskip("torch")
from coopsim.nn.cooperative.cooperative_net import Expand  # noqa: E402

torch.set_num_threads(1)


def maps(senders: int) -> torch.Tensor:
    return torch.randn(senders, 4, 6, 7, generator=torch.Generator().manual_seed(1))


def learned(told_errors: bool = False) -> Expand:
    """Return an expansion that does something about delays, its surroundings, and errors that it is told."""
    torch.manual_seed(2)
    expand = Expand(4, 8, told_errors)
    with torch.no_grad():
        for weights in expand.parameters():
            weights += torch.randn(weights.shape) * 0.2
    return expand


def test_delay_is_without_effect_until_learned() -> None:
    expand = Expand(4, 8)
    assert torch.equal(expand(maps(2), torch.tensor([0.0, 0.0])), expand(maps(2), torch.tensor([0.4, 9.0])))


def test_learning_about_delays_leaves_what_is_not_late_alone() -> None:
    before, after = Expand(4, 8), learned()
    state = after.state_dict()
    before.load_state_dict({**state, "delayed.weight": torch.zeros_like(state["delayed.weight"])})
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


@pytest.mark.parametrize("told_errors", [False, True])
@pytest.mark.parametrize("numbers", [torch.float32, torch.bfloat16])
def test_few_wanted_cells_are_computed_alone_and_are_the_same(told_errors: bool, numbers: torch.dtype) -> None:
    expand, received, delay_s = learned(told_errors), maps(3), torch.tensor([0.3, 0.0, 0.1])
    error_m, range_m = torch.rand(2, 3, 6, 7, generator=torch.Generator().manual_seed(3)) * 20
    wanted = torch.zeros(3, 6, 7, dtype=torch.bool)
    wanted[0, [0, 5, 2, 2], [0, 6, 3, 4]] = wanted[2, 5, 0] = True  # corners, the middle, and no cell of the second
    with torch.autocast("cpu", torch.bfloat16, enabled=numbers is torch.bfloat16):
        whole = expand(received, delay_s, error_m, range_m)
        few = expand(received, delay_s, error_m, range_m, wanted)
        most = expand(received, delay_s, error_m, range_m, wanted | True)
    assert few.dtype == whole.dtype == numbers and few.shape == whole.shape and torch.equal(most, whole)
    expected = torch.where(wanted[:, None], whole, 0.0)
    assert expected.any() and torch.count_nonzero(few) == torch.count_nonzero(expected)
    torch.testing.assert_close(few, expected, **({"rtol": 0.05, "atol": 0.05} if numbers is torch.bfloat16 else {}))


def test_gradients_of_few_cells_are_those_of_all() -> None:
    wanted = torch.zeros(2, 6, 7, dtype=torch.bool)
    wanted[:, 3, 2:5] = True
    gradients = []
    for asked in (wanted, None):
        expand, received = learned(), maps(2).requires_grad_()
        (expand(received, torch.tensor([0.2, 0.0]), wanted=asked) * wanted[:, None]).square().sum().backward()
        gradients.append([received.grad, *(each.grad for each in expand.parameters())])
    assert all(each is not None and each.any() for each in gradients[0])
    torch.testing.assert_close(*gradients)
