"""Losses of a cooperative network: its fused map is to show all that any of the agents has seen.

Two losses stand beside it. An early teacher (a network that sees the points of all agents, now and without errors)
distils its knowledge, as in Li et al., "Learning Distilled Collaboration Graph for Multi-Agent Perception", NeurIPS
2021, section 3.3; a recipe of any fusion asks for it by `teacher: early`. Feature flow needs no labels: a late map,
moved to now, is to be the map that its sender makes now.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from types import MappingProxyType
from typing import NamedTuple

import torch
from torch import Tensor
from torch.func import functional_call
from torch.nn import functional

from coopsim.errors import InvalidValueError
from coopsim.learn.losses.head_losses import head_loss, heat_loss, sum_of
from coopsim.learn.losses.own_losses import OwnLosses
from coopsim.learn.samples.flow_samples import FlowSample
from coopsim.learn.samples.fused_samples import CooperativeSample, ReceiverView
from coopsim.nn.cooperative.cooperative_net import CooperativeNet, FeatureFlow, moved_on
from coopsim.nn.cooperative.warp import placing, warp
from coopsim.nn.detector.detector_net import DetectorNet
from coopsim.nn.detector.pillars import PillarBatch
from coopsim.nn.fusion import Foreground, FusionContext, as_batch
from coopsim.types import BevGrid


class SentMaps(NamedTuple):
    """Maps that the agents of a sample know and send.

    Attributes:
        features: (A, features, H, W) maps of all clouds.
        values: (A, C, H, W) messages of them.
        sure: (A, H, W) confidences of the senders.
        grid: cells of these maps.
    """

    features: Tensor
    values: Tensor
    sure: Tensor
    grid: BevGrid


class Teaching(NamedTuple):
    """Teachers of a fused map besides the labels: a detector of merged clouds, if any, and losses of users."""

    teacher: DetectorNet | None = None
    own: OwnLosses = MappingProxyType({})


def cooperative_loss(
    detector: DetectorNet, net: CooperativeNet, sample: CooperativeSample, teaching: Teaching, *, frozen: bool = True
) -> dict[str, Tensor]:
    """Return the loss of a sample, the mean of its receivers: "loss", the weighted sum, and its parts.

    Args:
        detector: the agents' own network, whose encoder makes the maps.
        net: the cooperative network.
        sample: the sample; its views have merged clouds where there is a teacher.
        teaching: teachers besides the labels.
        frozen: no gradients reach the encoder.
    """
    with torch.set_grad_enabled(not frozen and torch.is_grad_enabled()):
        features = detector.encoder(sample.pillars)
    maps = SentMaps(features, *net.message(features), sample.grid)
    parts = message_losses(net, maps, sample) | views_losses(net, maps, sample, teaching)
    return {"loss": sum_of(parts), **parts}


def message_losses(net: CooperativeNet, maps: SentMaps, sample: CooperativeSample) -> dict[str, Tensor]:
    """Return the losses of messages by themselves, by name."""
    seen, doubtful = (each.to(maps.features.device) for each in (sample.seen, sample.doubtful))
    return {
        "sure": heat_loss(net.sure(maps.features).float(), seen, sample.objects, doubtful),
        "copy": copy_loss(net, maps.features.detach(), maps.values),
    }


def views_losses(
    net: CooperativeNet, maps: SentMaps, sample: CooperativeSample, teaching: Teaching
) -> dict[str, Tensor]:
    """Return the losses of fused maps by name, means of all views."""
    parts: dict[str, Tensor] = {}
    for view in sample.views:
        for name, part in _view_losses(net, maps, view, teaching).items():
            parts[name] = parts.get(name, torch.zeros_like(part)) + part / len(sample.views)
    return parts


def copy_loss(net: CooperativeNet, features: Tensor, values: Tensor) -> Tensor:
    """Return the share of the energy of features (A, features, h, w) that their message (A, C, h, w) loses."""
    copied = net.expand(values, values.new_zeros(len(values)))
    lost: Tensor = ((copied.float() - features.float()) ** 2).sum()
    return lost / (features.float() ** 2).sum().clamp_min(1e-6)


def surest(sure: Tensor, most_cells: int) -> Tensor:
    """Return the mask (S, h, w) of the `most_cells` surest cells of each map (S, h, w)."""
    flat = sure.flatten(1)
    least = flat.topk(min(most_cells, flat.shape[1]), dim=1).values[:, -1:]
    return (flat >= least).view_as(sure)


def fused_features(net: CooperativeNet, maps: SentMaps, view: ReceiverView) -> tuple[Tensor, list[Foreground]]:
    """Return the fused features (1, features, h, w) of a receiver in its view's grid, and the fusion's foreground."""
    features, values, sure, grid = maps
    others = list(view.others)
    sent = surest(sure[others].detach(), view.most_cells) if view.most_cells is not None else None
    own, own_mask = warp(features[view.own : view.own + 1], grid, view.grid, [[0.0, 0.0, 0.0]])
    whole = torch.cat([values[others], sure[others].detach()[:, None]], dim=1)
    received, mask = warp(whole, grid, view.grid, view.source_SE2_target, sent)
    own_sure, _ = warp(sure[view.own][None, None].detach(), grid, view.grid, [[0.0, 0.0, 0.0]])
    context = FusionContext(
        view.delay_s.to(own), view.kind.to(own.device), received[:, -1], own_sure[0, 0], view.own_kind
    )
    if net.tells_errors:
        error_m, range_m = placing(view.grid, view.source_SE2_target, [view.error] * len(others))
        context = replace(context, error_m=error_m.to(own.device), range_m=range_m.to(own.device))
    fused, beliefs = net.with_beliefs(own[0], own_mask[0], received[:, :-1], mask, context)
    return as_batch(fused), beliefs


def _view_losses(net: CooperativeNet, maps: SentMaps, view: ReceiverView, teaching: Teaching) -> dict[str, Tensor]:
    fused, levels = fused_features(net, maps, view)
    targets = view.targets.to(fused.device)
    parts = head_loss(net.head, fused, targets, teaching.own)
    if levels:
        parts["foreground"] = foreground_loss(levels, targets.heat.amax(1, keepdim=True), targets.objects)
    if teaching.teacher is not None and view.merged is not None:
        parts["teacher"] = teacher_loss(teaching.teacher, view.merged, fused)
    return parts


def foreground_loss(levels: Sequence[Foreground], heat: Tensor, objects: int) -> Tensor:
    """Return the mean loss of a fusion's foreground over scales: of all agents the surest one should be right.

    The heat (1, 1, H, W) is that of `objects` objects of any class.
    """
    losses = []
    for level in levels:
        logits = level.logits.float().masked_fill(~level.valid, -20.0).amax(0)
        shape = [logits.shape[0] * level.stride, logits.shape[1] * level.stride]
        padded = functional.pad(heat, (0, shape[1] - heat.shape[3], 0, shape[0] - heat.shape[2]))
        losses.append(heat_loss(logits[None, None], functional.max_pool2d(padded, level.stride), objects))
    return torch.stack(losses).mean()


def require_fitting(teacher: DetectorNet, detector: DetectorNet) -> None:
    """Check that a teacher's features can be compared with those of a fusion on a detector."""
    for name in ("features", "cell_m", "sweeps", "pillars"):
        one, other = getattr(teacher.config, name), getattr(detector.config, name)
        if one != other:
            raise InvalidValueError(f"teacher must have the detector's {name}, {other}, has {one}")


def teacher_loss(teacher: DetectorNet, merged: PillarBatch, fused: Tensor) -> Tensor:
    """Return the distance of a fused map (1, features, h, w) from the teacher's: divergence of channels, mean of cells.

        sum_c t_c log(t_c / s_c),    t = softmax_c(teacher's features), s = softmax_c(fused features)

    Cells in which the fused map is zero, because no agent reports them, are left out.
    """
    with torch.no_grad():
        known = teacher.encoder(merged).float().log_softmax(1)
    reported = (fused.detach() != 0).any(1)
    found = fused.float().log_softmax(1)
    distance = (known.exp() * (known - found)).sum(1)
    mean: Tensor = (distance * reported).sum() / reported.sum().clamp_min(1)
    return mean


def late_changes(flow: FeatureFlow, values: Tensor, sample: FlowSample) -> Tensor:
    """Return the change of a sample's L >= 1 late maps, (L, C, h, w) per second, from all messages (A, C, h, w).

    No gradients reach the messages.
    """
    late, grid = sample.late, sample.scene.grid
    before, known = warp(values[late.before].detach(), grid, grid, late.before_SE2_late)
    changes: Tensor = flow(values[late.late].detach(), before, known, values.new_tensor(late.interval_s))
    return changes


def moved_to_now(values: Tensor, changes: Tensor, sample: FlowSample) -> Tensor:
    """Return all maps (A, C, h, w), the L late ones moved to now by their changes (L, C, h, w)."""
    late = torch.tensor(sample.late.late, device=values.device)
    moved = moved_on(values[late], changes, values.new_tensor(sample.late.delay_s))
    return values.index_copy(0, late, moved)


def flow_losses(
    net: CooperativeNet, features: Tensor, values: Tensor, changes: Tensor, sample: FlowSample
) -> dict[str, Tensor]:
    """Return the share of the energy of the senders' maps of now that late maps miss, by name.

    "flow" is that of maps moved to now, "unmoved" of the same maps as they were sent, for comparison. Gradients reach
    `changes` alone.

    Args:
        net: the network, whose expansion is taken as it is.
        features: (A, features, h, w) maps of the encoder.
        values: (A, C, h, w) messages of them.
        changes: (L, C, h, w) changes of the late ones, L >= 1.
        sample: times and places of the maps.
    """
    late, grid = sample.late, sample.scene.grid
    still = values[late.late].detach()
    real, valid = warp(features[late.later].detach(), grid, grid, late.later_SE2_late)
    moved = moved_on(still, changes, values.new_tensor(late.delay_s))
    with torch.no_grad():
        unmoved = _missed(net, still, real, valid)
    return {"flow": _missed(net, moved, real, valid), "unmoved": unmoved}


def _missed(net: CooperativeNet, sent: Tensor, real: Tensor, valid: Tensor) -> Tensor:
    fixed = {name: each.detach() for name, each in net.expand.named_parameters()}
    laid = sent.contiguous(memory_format=torch.channels_last)
    shown = functional_call(net.expand, fixed, (laid, sent.new_zeros(len(sent))))
    missed = ((shown.float() - real.float()) ** 2 * valid[:, None]).sum()
    energy = (real.float() ** 2 * valid[:, None]).sum()
    share: Tensor = missed / energy.clamp_min(1e-6)
    return share
