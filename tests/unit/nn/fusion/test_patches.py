"""Patches: tokens of cells and back."""

from __future__ import annotations

import pytest

torch = pytest.importorskip("torch")
from coopsim.nn.fusion import AttFuse, FusionContext  # noqa: E402
from coopsim.nn.fusion.feature_fusion import Patches, masked_softmax  # noqa: E402

torch.set_num_threads(1)
SIZE = (7, 13)


def draw(*shape: int, seed: int = 0) -> torch.Tensor:
    return torch.rand(shape, generator=torch.Generator().manual_seed(seed))


def inputs() -> tuple[torch.Tensor, ...]:
    own_mask = draw(*SIZE, seed=1) < 0.8
    return draw(4, *SIZE) * own_mask, own_mask, draw(2, 4, *SIZE, seed=2), draw(2, *SIZE, seed=3) < 0.6


def weights_of(patches: Patches, maps: tuple[torch.Tensor, ...], logits: torch.Tensor) -> torch.Tensor:
    own, own_mask, others, mask = maps
    return masked_softmax(patches.logits(own, others, logits), torch.cat([own_mask[None], mask]))


@pytest.mark.parametrize(("stride", "multiple", "shape"), [(1, 1, (7, 13)), (2, 4, (4, 8)), (3, 1, (3, 5))])
def test_tokens_are_of_patches_and_maps_are_padded(stride: int, multiple: int, shape: tuple[int, int]) -> None:
    own, own_mask, others, mask = inputs()
    tokens, valid = Patches(4, 6, stride, multiple).tokens(own, own_mask, others, mask)
    assert tokens.shape == (3, *shape, 6) and valid.shape == (3, *shape)
    for each, cells in zip(valid, (own_mask, *mask), strict=True):
        for row in range(shape[0]):
            for column in range(shape[1]):
                patch = cells[row * stride : (row + 1) * stride, column * stride : (column + 1) * stride]
                assert each[row, column] == patch.any()


def test_each_cell_of_a_patch_has_its_own_part_of_the_token() -> None:
    patches, (own, _, others, mask) = Patches(4, 16, 2), inputs()
    with torch.no_grad():
        patches.add.weight.copy_(torch.eye(16))  # the token is row by row its four cells' features
    found, weights = draw(4, 7, 16), torch.zeros(3, *SIZE)
    out = patches.fuse(own, others, mask, weights, found)
    for row, column in torch.nonzero(mask.any(0)).tolist():
        cell = 4 * (row % 2 * 2 + column % 2)
        assert torch.equal(out[:, row, column], found[row // 2, column // 2, cell : cell + 4])
    alone = ~mask.any(0)
    assert torch.equal(out[:, alone], own[:, alone])


def test_fusions_on_patches_start_as_attfuse() -> None:
    maps = inputs()
    patches = Patches(4, 6, 2)
    weights = weights_of(patches, maps, torch.zeros(3, 4, 7, 4))
    out = patches.fuse(maps[0], maps[2], maps[3], weights, draw(4, 7, 6))
    assert torch.allclose(out, AttFuse(4)(*maps, FusionContext.plain(2)), atol=1e-6)


def test_pooled_weights_add_to_one_where_anyone_is_valid() -> None:
    patches, maps = Patches(4, 6, 2, 4), inputs()
    _, valid = patches.tokens(*maps)
    total = patches.pooled(weights_of(patches, maps, draw(3, 4, 8, 4))).sum(0)
    assert torch.allclose(total, valid.any(0).float(), atol=1e-5)
