"""Overlaps with gradients: those of boxes, and gradients that are finite everywhere."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

torch = pytest.importorskip("torch")

from coopsim.geometry.iou import giou_3d, xiou  # noqa: E402
from coopsim.learn.losses.instance_losses import giou_of_pairs, xiou_of_pairs  # noqa: E402

torch.set_num_threads(1)
BOTH = pytest.mark.parametrize(("of_pairs", "of_all"), [(giou_of_pairs, giou_3d), (xiou_of_pairs, xiou)])


def boxes(count: int, seed: int) -> Any:
    rng = np.random.default_rng(seed)
    size, yaw = rng.uniform(0.5, 5, (count, 3)), rng.uniform(-4, 4, count)
    return np.column_stack([rng.uniform(-3, 3, (count, 2)), rng.uniform(-1, 1, count), size, yaw])


def pairs() -> tuple[Any, Any]:
    """Pairs at random, and those in which sides run on sides, boxes lie in boxes, or far apart."""
    first, second = boxes(600, 0), boxes(600, 1)
    second[:300] = first[:300]
    second[50:100, 6] += np.pi / 2 * np.random.default_rng(2).integers(0, 4, 50)
    second[100:150, 0] += 1.5
    second[150:200, 3:6] /= 2
    second[200:250, 6] = np.random.default_rng(3).uniform(-4, 4, 50)
    second[250:300, :2] += 100.0
    first[300:350, 6] = second[300:350, 6] = 0.0
    return first, second


@BOTH
def test_overlaps_of_pairs_are_those_of_all_pairs(of_pairs: Callable[..., Any], of_all: Callable[..., Any]) -> None:
    first, second = pairs()
    expected = [of_all(a[None], b[None])[0, 0] for a, b in zip(first, second, strict=True)]
    found = of_pairs(torch.from_numpy(first), torch.from_numpy(second))
    np.testing.assert_allclose(found.numpy(), expected, atol=1e-9)
    single = of_pairs(torch.from_numpy(first).float(), torch.from_numpy(second).float())
    assert single.dtype == torch.float32
    np.testing.assert_allclose(single.numpy(), expected, atol=2e-5)
    assert of_pairs(torch.zeros(0, 7), torch.zeros(0, 7)).shape == (0,)


@BOTH
def test_gradients_are_finite_for_any_pair(of_pairs: Callable[..., Any], of_all: Callable[..., Any]) -> None:
    first, second = (torch.from_numpy(each).requires_grad_() for each in pairs())
    of_pairs(first, second).sum().backward()
    for each in (first, second):
        assert each.grad is not None and bool(torch.isfinite(each.grad).all())
    far = first.grad[250:300]
    assert bool((far[:, :2].abs().sum(1) > 0).all())  # even far apart a box knows which way to go


@BOTH
def test_gradients_are_those_of_small_steps(of_pairs: Callable[..., Any], of_all: Callable[..., Any]) -> None:
    first, second = (torch.from_numpy(each[500:504]) for each in pairs())
    assert torch.autograd.gradcheck(of_pairs, (first.requires_grad_(), second.requires_grad_()))


def test_a_box_is_drawn_to_the_true_one_heading_and_all() -> None:
    true = torch.tensor([[1.0, 2.0, 0.5, 4.0, 2.0, 1.5, 0.7]]).double()
    box = torch.tensor([[3.0, -1.0, 0.0, 3.0, 1.0, 1.0, -0.6]]).double().requires_grad_()
    adam = torch.optim.Adam([box], 0.1)
    for _ in range(80):
        adam.zero_grad()
        (1 - xiou_of_pairs(box, true)).sum().backward()
        adam.step()
    assert float(xiou_of_pairs(box, true).detach()) > 0.9
