"""The derivative of maps, and maps that are moved on by it."""

from __future__ import annotations

import pytest

torch = pytest.importorskip("torch")
from coopsim.errors import InvalidValueError  # noqa: E402
from coopsim.nn.cooperative.cooperative_net import FeatureFlow, moved_on  # noqa: E402

torch.set_num_threads(1)


def draw(*shape: int, seed: int = 0) -> torch.Tensor:
    return torch.randn(shape, generator=torch.Generator().manual_seed(seed))


def some_flow() -> FeatureFlow:
    """Return a network whose weights are all random, also those that start as zeros."""
    flow = FeatureFlow(3, 4)
    source = torch.Generator().manual_seed(5)
    with torch.no_grad():
        for weights in flow.parameters():
            weights.copy_(torch.randn(weights.shape, generator=source) * 0.2)
    return flow


def test_without_delay_maps_come_back_bit_for_bit() -> None:
    values, change = draw(2, 3, 4, 5), draw(2, 3, 4, 5, seed=1)
    values[0, 0, 0, 0] = -0.0
    moved = moved_on(values, change, torch.zeros(2))
    assert moved.numpy().tobytes() == values.numpy().tobytes()


@pytest.mark.parametrize("delay_s", [1e-4, 0.13, 0.5, 0.77, -0.2])
def test_a_map_moves_in_proportion_to_its_own_delay(delay_s: float) -> None:
    values, change = draw(2, 3, 4, 5), draw(2, 3, 4, 5, seed=1)
    moved = moved_on(values, change, torch.tensor([delay_s, 0.0]))
    torch.testing.assert_close(moved[0], values[0] + delay_s * change[0])
    assert torch.equal(moved[1], values[1])


def test_changes_of_another_shape_are_refused() -> None:
    with pytest.raises(InvalidValueError, match=r"change must have the shape \(2, 3, 4, 5\)"):
        moved_on(draw(2, 3, 4, 5), draw(2, 3, 4, 6), torch.zeros(2))
    with pytest.raises(InvalidValueError, match="delay_s a number for each"):
        moved_on(draw(2, 3, 4, 5), draw(2, 3, 4, 5), torch.zeros(3))


@pytest.mark.parametrize("size", [(8, 12), (9, 7), (1, 1)])
def test_a_new_network_says_that_nothing_moves(size: tuple[int, int]) -> None:
    known = torch.ones(2, *size, dtype=torch.bool)
    change = FeatureFlow(3, 4)(draw(2, 3, *size), draw(2, 3, *size, seed=1), known, torch.full((2,), 0.1))
    assert change.shape == (2, 3, *size) and not change.any()


def test_derivatives_are_per_second() -> None:
    """The same two maps twice as far apart in time: half the speed."""
    given = draw(1, 3, 8, 8), draw(1, 3, 8, 8, seed=1), torch.ones(1, 8, 8, dtype=torch.bool)
    slow, fast = (some_flow()(*given, torch.tensor([interval_s])) for interval_s in (0.2, 0.1))
    assert slow.any()
    torch.testing.assert_close(fast, 2 * slow)


def test_gradients_reach_every_weight() -> None:
    flow = some_flow()
    known = draw(2, 9, 10, seed=2) > 0
    flow(draw(2, 3, 9, 10), draw(2, 3, 9, 10, seed=1), known, torch.tensor([0.1, 0.4])).square().sum().backward()
    for name, weights in flow.named_parameters():
        assert weights.grad is not None and weights.grad.isfinite().all() and weights.grad.any(), name
