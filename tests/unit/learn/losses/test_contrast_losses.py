"""Losses that tell objects apart: as written out by hand, and blind to sightings of the same object."""

import math

import pytest
import torch
from torch.nn.functional import normalize

from coopsim.learn.losses.contrast_losses import hardest_triplets, paired_contrast


def _unit(*shape: int) -> torch.Tensor:
    return normalize(torch.randn(*shape, generator=torch.Generator().manual_seed(1), dtype=torch.float64), dim=1)


def test_pairs_are_compared_with_all_others_both_ways() -> None:
    first, second = _unit(6, 4).chunk(2)
    scale = torch.tensor(math.log(5.0), dtype=torch.float64)
    e = (5 * first @ second.T).exp()
    by_hand = -sum((e[k, k] / e[k].sum()).log() + (e[k, k] / e[:, k].sum()).log() for k in range(3)) / 6
    assert float(paired_contrast(first, second, torch.arange(3), scale)) == pytest.approx(float(by_hand))


def test_pairs_of_one_object_are_not_told_apart() -> None:
    first, second = _unit(8, 4).chunk(2)
    scale = torch.tensor(1.0, dtype=torch.float64)
    identity = torch.tensor([0, 1, 1, 2])
    e = (math.e * first @ second.T).exp()
    apart = identity[:, None] != identity
    rows = [(e[k, k] / (e[k, k] + e[k][apart[k]].sum())).log() for k in range(4)]
    columns = [(e[k, k] / (e[k, k] + e[:, k][apart[k]].sum())).log() for k in range(4)]
    found = paired_contrast(first, second, identity, scale)
    assert float(found) == pytest.approx(-float(sum(rows + columns)) / 8)


def test_without_pairs_there_is_no_loss_and_a_gradient_of_nothing() -> None:
    first, scale = _unit(0, 4).requires_grad_(), torch.tensor(2.0, requires_grad=True)
    loss = paired_contrast(first, first, torch.arange(0), scale)
    loss.backward()
    assert float(loss.detach()) == 0.0 and scale.grad == 0.0


def test_the_temperature_is_learned_but_not_without_bound() -> None:
    first = _unit(4, 4)
    scale = torch.tensor(1.0, dtype=torch.float64, requires_grad=True)
    paired_contrast(first, first, torch.arange(4), scale).backward()
    assert scale.grad is not None and scale.grad < 0  # sharper is better where all pairs are right
    at_most, beyond = (
        paired_contrast(first, first.flip(0), torch.arange(4), torch.tensor(value)) for value in (math.log(100), 9.0)
    )
    assert float(at_most) == pytest.approx(float(beyond))


def test_the_farthest_of_the_same_is_set_against_the_nearest_of_others() -> None:
    angle = torch.tensor([0.0, 0.5, 1.0, 1.2, 3.0], dtype=torch.float64)
    vectors = torch.stack([angle.cos(), angle.sin()], dim=1)
    identity = torch.tensor([0, 0, 0, 1, 2])
    # 1 and 2 have no second sighting, so only the first three count.
    expected = [
        (1 - math.cos(1.0)) - (1 - math.cos(1.2)),
        (1 - math.cos(0.5)) - (1 - math.cos(0.7)),
        (1 - math.cos(1.0)) - (1 - math.cos(0.2)),
    ]
    by_hand = sum(max(each + 0.3, 0.0) for each in expected) / 3
    assert float(hardest_triplets(vectors, identity, 0.3)) == pytest.approx(by_hand)


@pytest.mark.parametrize("identity", [[], [0], [0, 0], [0, 1]])
def test_nothing_to_compare_costs_nothing(identity: list[int]) -> None:
    vectors = _unit(len(identity), 4).requires_grad_()
    of = torch.tensor(identity, dtype=torch.int64)
    found = hardest_triplets(vectors, of) + paired_contrast(vectors[:0], vectors[:0], of[:0], torch.tensor(1.0))
    found.backward()
    assert float(found.detach()) == 0.0 and vectors.grad is not None and not vectors.grad.any()
