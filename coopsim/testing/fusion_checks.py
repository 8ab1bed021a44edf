"""The conformance check of a fusion of feature maps."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from torch import Tensor

    from coopsim.nn.fusion import FeatureFusion

_SENDERS, _SIZE, _OTHER_SIZES = 4, (7, 13), ((8, 8), (1, 1), (5, 2))
_EQUAL = 1e-4


def check_fusion(fusion: str | Callable[[int], FeatureFusion], features: int = 64) -> None:
    """Check that a fusion keeps what the cooperative network relies on.

    It must give maps of finite numbers for any number of senders and any size of map, with and without confidences;
    return the own map where nobody else reports anything, and so for one agent alone; be indifferent to the order of
    the senders, to senders that report no cell, and to what masked cells hold; leave its inputs as they are; and let
    gradients reach every sender's valid cells. Weights are drawn at random, those that start as zeros, too.

    Args:
        fusion: a registered name, a place such as "mine.py:MyFusion", or a class or function that is called with the
            number of channels.
        features: number of channels.

    Raises:
        AssertionError: a check failed; the message names it.
        UnknownNameError: no fusion of that name is registered.
        MissingDependencyError: torch is not installed.
    """
    import coopsim.nn  # noqa: F401  (says how to install torch, where it is not)
    from coopsim.nn.fusion import FeatureFusion
    from coopsim.nn.fusion.feature_fusion import find_fusion

    made: Any = find_fusion(fusion)(features) if isinstance(fusion, str) else fusion(features)
    name = fusion if isinstance(fusion, str) else type(made).__name__
    assert isinstance(made, FeatureFusion), f"{name} must be a coopsim.nn.fusion.FeatureFusion, got {made!r}"
    _draw_weights(made)
    _check_shapes(made, name, features)
    _check_own_map(made, name, features)
    _check_senders(made, name, features)
    _check_gradients(made, name, features)


def _draw_weights(fusion: Any) -> None:
    import torch

    source = torch.Generator().manual_seed(0)
    with torch.no_grad():
        for weights in fusion.parameters():
            weights.copy_(torch.randn(weights.shape, generator=source) * 0.3)
    fusion.eval()


def _case(features: int, senders: int = _SENDERS, size: tuple[int, int] = _SIZE) -> tuple[Any, ...]:
    """Return own map, own mask, others, mask and context, with random validity."""
    import torch

    from coopsim.nn.fusion import FusionContext

    source = torch.Generator().manual_seed(senders)

    def draw(*shape: int) -> Tensor:
        return torch.rand(shape, generator=source)

    own_mask = draw(*size) < 0.7
    own = (draw(features, *size) - 0.5).relu() * own_mask
    others, mask = (draw(senders, features, *size) - 0.5).relu(), draw(senders, *size) < 0.6
    kind = torch.arange(senders) % 3
    return own, own_mask, others, mask, FusionContext(draw(senders), kind, draw(senders, *size), draw(*size))


def _check_shapes(fusion: Any, name: str, features: int) -> None:
    for size in (_SIZE, *_OTHER_SIZES):
        for senders in (1, 2, 5):
            *maps, context = _case(features, senders, size)
            before = [each.clone() for each in maps]
            for given in (context, replace(context, confidence=None, own_confidence=None)):
                fused = fusion(*maps, given)
                about = f"{senders} senders on {size[0]} x {size[1]} cells"
                assert tuple(fused.shape) == (features, *size), (
                    f"{name} must return ({features}, {size[0]}, {size[1]}) for {about}, got {tuple(fused.shape)}"
                )
                assert fused.isfinite().all(), f"{name} must return finite numbers, for {about}"
            same = all(each.equal(was) for each, was in zip(maps, before, strict=True))
            assert same, f"{name} must leave maps and masks as they are"


def _check_own_map(fusion: Any, name: str, features: int) -> None:
    own, own_mask, others, mask, context = _case(features, 0)
    assert fusion(own, own_mask, others, mask, context).equal(own), f"{name} must return the own map where none is sent"
    own, own_mask, others, mask, context = _case(features)
    alone = ~mask.any(0)
    fused = fusion(own, own_mask, others, mask, context)
    kept = _close(fused[:, alone], own[:, alone])
    assert kept, f"{name} must keep the own map in cells that nobody else reports"
    nothing = fusion(own, own_mask, others, mask & False, context)
    assert _close(nothing, own), f"{name} must return the own map where all cells of the others are masked"


def _check_senders(fusion: Any, name: str, features: int) -> None:
    import torch

    own, own_mask, others, mask, context = _case(features)

    def fused(order: list[int], values: Tensor, valid: Tensor) -> Tensor:
        assert context.confidence is not None
        own_context = replace(
            context, delay_s=context.delay_s[order], kind=context.kind[order], confidence=context.confidence[order]
        )
        result: Tensor = fusion(own, own_mask, values[order], valid[order], own_context)
        return result

    everyone = list(range(_SENDERS))
    before = fused(everyone, others, mask)
    assert _close(before, fused(everyone[::-1], others, mask)), f"{name} must not depend on the order of the senders"
    loud = torch.where(mask[:, None], others, torch.tensor(1e3))
    assert _close(before, fused(everyone, loud, mask)), f"{name} must not let what masked cells hold through"
    silent = mask.clone()
    silent[-1] = False
    left_out = fused(everyone[:-1], others, mask)
    assert _close(left_out, fused(everyone, others, silent)), f"{name} must not notice a sender that reports no cell"


def _check_gradients(fusion: Any, name: str, features: int) -> None:
    import torch

    own, own_mask, others, mask, context = _case(features)
    others.requires_grad_()
    weights = torch.rand(own.shape, generator=torch.Generator().manual_seed(1))
    (fusion(own, own_mask, others, mask, context) * weights).sum().backward()
    gradient = others.grad
    reached = gradient is not None and bool((gradient.abs().flatten(1).sum(1) > 0).all())
    assert reached, f"{name} must let gradients reach every sender"
    assert gradient is not None and gradient.isfinite().all(), f"{name} must have finite gradients"
    through = gradient.masked_select(~mask[:, None])
    assert not through.any(), f"{name} must not let gradients through masked cells"


def _close(a: Tensor, b: Tensor) -> bool:
    import torch

    return bool(torch.allclose(a, b, atol=_EQUAL, rtol=_EQUAL))
