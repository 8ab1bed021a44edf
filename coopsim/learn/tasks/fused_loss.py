"""The loss of a cooperative network: what it fuses is to show all that any of the agents has seen."""

from __future__ import annotations

from collections.abc import Sequence

import torch
from torch import Tensor
from torch.nn import functional

from coopsim.learn.losses.losses import head_loss, heat_loss, sum_of
from coopsim.learn.losses.teacher_loss import teacher_loss
from coopsim.learn.samples.fused_samples import CooperativeSample, ReceiverView
from coopsim.nn.cooperative.cooperative_net import CooperativeNet
from coopsim.nn.cooperative.warp import warp
from coopsim.nn.detector.detector_net import DetectorNet
from coopsim.nn.fusion import Foreground, FusionContext, as_batch
from coopsim.types import BevGrid


def cooperative_loss(
    detector: DetectorNet,
    net: CooperativeNet,
    sample: CooperativeSample,
    *,
    frozen: bool = True,
    teacher: DetectorNet | None = None,
) -> dict[str, Tensor]:
    """Return the loss of a sample, the mean of its receivers: "loss", the weighted sum, and its parts.

    Args:
        detector: the agents' own network, whose encoder makes the maps.
        net: the cooperative network.
        sample: one moment.
        frozen: no gradients reach the encoder.
        teacher: of merged clouds, which the views then have; None: nobody teaches.
    """
    with torch.set_grad_enabled(not frozen and torch.is_grad_enabled()):
        features = detector.encoder(sample.pillars)
    values, sure = net.message(features)
    parts = message_losses(net, features, values, sample) | views_losses(net, features, values, sure, sample, teacher)
    return {"loss": sum_of(parts), **parts}


def message_losses(
    net: CooperativeNet, features: Tensor, values: Tensor, sample: CooperativeSample
) -> dict[str, Tensor]:
    """Return the losses of messages by themselves, by name; arguments as of `fused_features`."""
    return {
        "sure": heat_loss(net.sure(features).float(), sample.seen.to(features.device), sample.objects),
        "copy": copy_loss(net, features.detach(), values),
    }


def views_losses(
    net: CooperativeNet,
    features: Tensor,
    values: Tensor,
    sure: Tensor,
    sample: CooperativeSample,
    teacher: DetectorNet | None = None,
) -> dict[str, Tensor]:
    """Return the losses of what receivers fuse, by name, the means of all views; arguments as of `fused_features`."""
    parts: dict[str, Tensor] = {}
    for view in sample.views:
        for name, part in _view_losses(net, features, values, sure, sample.grid, view, teacher).items():
            parts[name] = parts.get(name, torch.zeros_like(part)) + part / len(sample.views)
    return parts


def copy_loss(net: CooperativeNet, features: Tensor, values: Tensor) -> Tensor:
    """Return the share of features' energy that a message without delay loses: expanded, it should be what was sent.

    Args:
        net: the cooperative network.
        features: (A, features, h, w).
        values: (A, C, h, w) its message of them.
    """
    copied = net.expand(values.contiguous(memory_format=torch.channels_last), values.new_zeros(len(values)))
    lost: Tensor = ((copied.float() - features.float()) ** 2).sum()
    return lost / (features.float() ** 2).sum().clamp_min(1e-6)


def surest(sure: Tensor, most_cells: int) -> Tensor:
    """Return the mask (S, h, w) of the `most_cells` surest cells of each map (S, h, w)."""
    flat = sure.flatten(1)
    least = flat.topk(min(most_cells, flat.shape[1]), dim=1).values[:, -1:]
    return (flat >= least).view_as(sure)


def fused_features(
    net: CooperativeNet, features: Tensor, values: Tensor, sure: Tensor, grid: BevGrid, view: ReceiverView
) -> tuple[Tensor, list[Foreground]]:
    """Return the fused features (1, features, h, w) of a receiver in its view's grid, and the fusion's beliefs.

    Args:
        net: the cooperative network.
        features: (A, features, H, W) of all clouds.
        values: (A, C, H, W) what is sent of them.
        sure: (A, H, W) how sure the senders are.
        grid: the cells of these maps.
        view: of the receiver.
    """
    others = list(view.others)
    sent = surest(sure[others].detach(), view.most_cells) if view.most_cells is not None else None
    own, own_mask = warp(features[view.own : view.own + 1], grid, view.grid, [[0.0, 0.0, 0.0]])
    whole = torch.cat([values[others], sure[others].detach()[:, None]], dim=1)
    received, mask = warp(whole, grid, view.grid, view.source_SE2_target, sent)
    own_sure, _ = warp(sure[view.own][None, None].detach(), grid, view.grid, [[0.0, 0.0, 0.0]])
    context = FusionContext(
        view.delay_s.to(own), view.kind.to(own.device), received[:, -1], own_sure[0, 0], view.own_kind
    )
    fused, beliefs = net.with_beliefs(own[0], own_mask[0], received[:, :-1], mask, context)
    return as_batch(fused), beliefs


def _view_losses(
    net: CooperativeNet,
    features: Tensor,
    values: Tensor,
    sure: Tensor,
    grid: BevGrid,
    view: ReceiverView,
    teacher: DetectorNet | None,
) -> dict[str, Tensor]:
    fused, levels = fused_features(net, features, values, sure, grid, view)
    targets = view.targets.to(fused.device)
    parts = head_loss(net.head, fused, targets)
    parts.pop("loss")
    if levels:
        parts["foreground"] = foreground_loss(levels, targets.heat.amax(1, keepdim=True), targets.objects)
    if teacher is not None and view.merged is not None:
        parts["teacher"] = teacher_loss(teacher, view.merged, fused)
    return parts


def foreground_loss(levels: Sequence[Foreground], heat: Tensor, objects: int) -> Tensor:
    """Return the mean loss of a fusion's beliefs where objects are: of all agents the surest one should be right.

    Args:
        levels: the beliefs, one a scale.
        heat: (1, 1, H, W) of objects of any class.
        objects: their number.
    """
    losses = []
    for level in levels:
        logits = level.logits.float().masked_fill(~level.valid, -20.0).amax(0)
        shape = [logits.shape[0] * level.stride, logits.shape[1] * level.stride]
        padded = functional.pad(heat, (0, shape[1] - heat.shape[3], 0, shape[0] - heat.shape[2]))
        losses.append(heat_loss(logits[None, None], functional.max_pool2d(padded, level.stride), objects))
    return torch.stack(losses).mean()
