"""Every registered fusion passes the check that users have, and the check finds what it says it finds."""

from __future__ import annotations

from collections.abc import Callable

import pytest

torch = pytest.importorskip("torch")
from torch import Tensor  # noqa: E402

from coopsim.nn.fusion import FUSIONS, FeatureFusion, FusionContext  # noqa: E402
from coopsim.testing import check_fusion  # noqa: E402

torch.set_num_threads(1)


@pytest.mark.parametrize("name", FUSIONS.names())
def test_registered_fusions_pass(name: str) -> None:
    check_fusion(name, features=16)


@pytest.mark.parametrize(
    "name", ["cobevt", "disconet", "gsaf", "v2vnet", pytest.param("v2x_vit", marks=pytest.mark.long)]
)
def test_their_reference_sizes_pass(name: str) -> None:
    check_fusion(lambda features: FUSIONS.get(name)(features, size="reference"), features=16)


def fusion_of(fuse: Callable[[Tensor, Tensor, Tensor, Tensor], Tensor]) -> Callable[[int], FeatureFusion]:
    class Wrong(FeatureFusion):
        def fuse(self, own: Tensor, own_mask: Tensor, others: Tensor, mask: Tensor, context: FusionContext) -> Tensor:
            return fuse(own, own_mask, others, mask)

    return lambda features: Wrong()


WRONG = {
    "must return \\(": lambda own, own_mask, others, mask: own[:1],
    "finite numbers": lambda own, own_mask, others, mask: own + (others * mask[:, None]).sum(0) / mask.sum(0),
    "own map in cells": lambda own, own_mask, others, mask: (own + (others * mask[:, None]).sum(0)) / 2,
    "order": lambda own, own_mask, others, mask: own + others[0] * mask[0],
    "masked cells hold": lambda own, own_mask, others, mask: own + others.sum(0) * mask.any(0),
    "reports no cell": lambda own, own_mask, others, mask: own + (others * mask[:, None]).mean(0),
    "gradients reach": lambda own, own_mask, others, mask: own + 0 * others.sum(0),
    "leave maps": lambda own, own_mask, others, mask: own.add_((others * mask[:, None]).sum(0)),
}  # fmt: skip


@pytest.mark.parametrize("complaint", WRONG)
def test_what_is_wrong_is_named(complaint: str) -> None:
    with pytest.raises(AssertionError, match=complaint):
        check_fusion(fusion_of(WRONG[complaint]), features=4)
