"""The loss of feature flow, without labels: a late map moved to now is to be what its sender really sees now."""

from __future__ import annotations

import torch
from torch import Tensor
from torch.func import functional_call

from coopsim.learn.samples.flow_samples import FlowSample
from coopsim.nn.cooperative.cooperative_net import CooperativeNet
from coopsim.nn.cooperative.feature_flow import FeatureFlow, moved_on
from coopsim.nn.cooperative.warp import warp


def late_changes(flow: FeatureFlow, values: Tensor, sample: FlowSample) -> Tensor:
    """Return how the L late maps of a sample change, (L, C, h, w) per second; L >= 1.

    Args:
        flow: the network.
        values: (A, C, h, w) what is sent of all maps; no gradients reach it.
        sample: says which maps are late, and which came before.
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
    """Return the share of the energy of what senders really see now that late maps miss, by name.

    "flow" is that of maps moved to now, "unmoved" of the same maps as they were sent, for comparison. Gradients reach
    `changes` alone.

    Args:
        net: the network, whose expansion is taken as it is.
        features: (A, features, h, w) of all maps, by the encoder.
        values: (A, C, h, w) what is sent of them.
        changes: (L, C, h, w) of the late ones, L >= 1.
        sample: says when and where maps were made.
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
