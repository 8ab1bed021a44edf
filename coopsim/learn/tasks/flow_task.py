"""Stage B with feature flow: a fusion of maps that are moved to now, and how messages change in time."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import torch
from torch import Tensor, nn

from coopsim.errors import InvalidValueError
from coopsim.learn.clips.clip import Clip
from coopsim.learn.losses.losses import sum_of
from coopsim.learn.recipe import TrainingRecipe
from coopsim.learn.samples.flow_samples import FlowSample, flow_samples
from coopsim.learn.tasks.cooperative_task import CooperativeTask, find_in
from coopsim.learn.tasks.flow_loss import flow_losses, late_changes, moved_to_now
from coopsim.learn.tasks.fused_loss import cooperative_loss, copy_loss, views_losses
from coopsim.learn.tasks.training_task import LOSS, FoundMap, mean_losses
from coopsim.nn.cooperative.cooperative_net import CooperativeNet

_MESSAGES_FIRST = 0.5
"""Share of the steps, at the beginning, in which messages are learned, and not yet how they change."""


class FlowTask(CooperativeTask):
    """The training of a `CooperativeNet` with flow, whose encoder and head are the detector's and stay so.

    In the first half messages and fusion are learned as those of any fusion. From then on messages stay as they are,
    because a flow that follows changing messages learns next to nothing. It learns without labels, from what late
    senders see now; the fusion goes on, on late maps that are moved by the flow of the moment. Gradients of neither
    reach the other.

    Args:
        recipe: of the kind "flow".
        seed: of the first weights.

    Raises:
        InvalidValueError: the network has no flow, its loss is weighed, or detector, teacher, network and the weights
            to start with do not fit together.
    """

    def __init__(self, recipe: TrainingRecipe, seed: int) -> None:
        super().__init__(recipe, seed)
        if self.net.flow is None:
            raise InvalidValueError("network flow must be its width, as {flow: 24}, with kind: flow, got 0")
        if unweighed := {"flow", "unmoved"} & recipe.loss.keys():
            raise InvalidValueError(
                f"loss must leave out {sorted(unweighed)}: what the flow learns, nothing else does, and not every step "
                "has late messages"
            )
        self.net.head.requires_grad_(False)

    def cut(self, clip: Clip, rng: np.random.Generator) -> Sequence[Any]:
        config, taught = self.detector.config, self.teacher is not None
        return flow_samples(clip, rng, self._settings, config.cell_m, config.sweeps, taught=taught)

    def cut_held_out(self, clip: Clip, rng: np.random.Generator) -> Sequence[Any]:
        settings = replace(self._settings, thinned=0.0, mirrored=0.0, dropout=0.0, receivers=None)
        return flow_samples(clip, rng, settings, self.detector.config.cell_m, self.detector.config.sweeps)

    def find(self, net: nn.Module, batch: Any) -> list[FoundMap]:
        assert isinstance(net, CooperativeNet) and net.flow is not None
        found: list[FoundMap] = []
        for sample in batch:
            with torch.no_grad():
                features = self.detector.encoder(sample.scene.pillars)
                values, sure = net.message(features)
                if sample.late.late:
                    values = moved_to_now(values, late_changes(net.flow, values, sample), sample)
                found += find_in(net, features, values, sure, sample.scene)
        return found

    def forward(self, batch: Sequence[FlowSample]) -> dict[str, Tensor]:
        return mean_losses([self._losses(sample) for sample in batch])

    def _losses(self, sample: FlowSample) -> dict[str, Tensor]:
        if self.progress < _MESSAGES_FIRST:
            return cooperative_loss(self.detector, self.net, sample.scene, teacher=self.teacher)
        return self._flow_step(sample)

    def _flow_step(self, sample: FlowSample) -> dict[str, Tensor]:
        net = self.net
        assert net.flow is not None
        with torch.no_grad():
            features = self.detector.encoder(sample.scene.pillars)
            values, sure = net.message(features)
        parts = {"copy": copy_loss(net, features, values)}
        if sample.late.late:
            changes = late_changes(net.flow, values, sample)
            parts |= flow_losses(net, features, values, changes, sample)
            values = moved_to_now(values, changes.detach(), sample)
        parts |= views_losses(net, features, values, sure, sample.scene, self.teacher)
        return {LOSS: sum_of(parts), **parts}
