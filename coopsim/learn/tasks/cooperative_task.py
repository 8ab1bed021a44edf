"""Stage B: a fusion on the features of a frozen encoder. Stage C: the fusion and the encoder."""

from __future__ import annotations

import copy
from collections.abc import Iterable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import torch
from torch import Tensor, nn

from coopsim.config.load import load
from coopsim.errors import InvalidValueError
from coopsim.learn.clips.clip import Clip
from coopsim.learn.losses.fused_losses import (
    SentMaps,
    Teaching,
    cooperative_loss,
    copy_loss,
    flow_losses,
    fused_features,
    late_changes,
    moved_to_now,
    require_fitting,
    views_losses,
)
from coopsim.learn.losses.head_losses import sum_of
from coopsim.learn.losses.own_losses import own_losses
from coopsim.learn.recipe import TrainingRecipe
from coopsim.learn.samples.cloud_samples import SampleSettings
from coopsim.learn.samples.flow_samples import FlowDraft, FlowSample
from coopsim.learn.samples.fused_samples import CooperativeSample, SceneDraft, scene_samples
from coopsim.learn.tasks.training_task import (
    LOSS,
    FoundMap,
    TrainingTask,
    WeightsFile,
    copy_weights,
    mean_losses,
    require_config_of,
    weights_metadata,
)
from coopsim.learn.weights import encoder_digest, load_cooperative, load_detector, make_network
from coopsim.nn.cooperative.cooperative_net import CooperativeNet
from coopsim.nn.detector.decode import decode
from coopsim.nn.detector.detector_net import DetectorNet
from coopsim.support.user_code import names_code


class CooperativeTask(TrainingTask[CooperativeNet]):
    """Stage B: the training of a `CooperativeNet` on a frozen encoder; its head begins as the detector's."""

    cuts_apart = True
    draft: type[SceneDraft] = SceneDraft

    def __init__(self, recipe: TrainingRecipe, seed: int) -> None:
        super().__init__()
        self._settings = load(SampleSettings, recipe.samples, "samples")
        detector = load_detector(recipe.detector)
        named = str(recipe.network.get("fusion", ""))
        fusion = named if names_code(named) else None
        start = None if recipe.start is None else load_cooperative(recipe.start, detector, fusion)
        head = (start or detector).config.head
        self.net = make_network(
            "cooperative", {"features": detector.config.features, "head": head, **recipe.network}, seed
        )
        config = self.net.config
        if config.features != detector.config.features:
            raise InvalidValueError(f"network features must be the detector's {detector.config.features}")
        if config.flow and recipe.kind not in ("flow", "front"):
            raise InvalidValueError(
                f"network flow must be 0 with kind: {recipe.kind}, got {config.flow}: see kind: flow"
            )
        if start is None:
            if recipe.kind != "front" and config.head == "turned" and detector.head.judge is None:
                raise InvalidValueError(
                    'network head must be "centre", as the detector\'s: kind: front makes a "turned" one of it'
                )
            copy_weights(detector.head, self.net.head)
        else:
            require_config_of(start, config)
            self.net.load_state_dict(start.state_dict())
        self.detector = copy.deepcopy(detector).eval().requires_grad_(False)
        self.teacher = None if recipe.teacher is None else copy.deepcopy(load_detector(recipe.teacher))
        if self.teacher is not None:
            require_fitting(self.teacher, detector)
        self.teaching = Teaching(self.teacher, own_losses(recipe.loss))
        # Statistics of normalisation stay the detector's: one scene is too few to measure them.
        normalisations = (each for each in self.net.modules() if isinstance(each, nn.modules.batchnorm._BatchNorm))
        self.frozen = [self.detector, *normalisations, *([self.teacher] if self.teacher else [])]
        self.metadata = weights_metadata("cooperative", config, recipe, detector)

    def cut(self, clip: Clip, rng: np.random.Generator) -> Sequence[Any]:
        return self._samples(clip, rng, self._settings, taught=self.teacher is not None)

    def cut_held_out(self, clip: Clip, rng: np.random.Generator) -> Sequence[Any]:
        settings = replace(self._settings, thinned=0.0, mirrored=0.0, dropout=0.0, receivers=None, clean=1.0)
        return self._samples(clip, rng, settings, taught=False)

    def _samples(
        self, clip: Clip, rng: np.random.Generator, settings: SampleSettings, *, taught: bool
    ) -> Sequence[Any]:
        return scene_samples(clip, rng, settings, self.detector.config, taught=taught, draft=self.draft)

    def find(self, net: CooperativeNet, batch: Any) -> list[FoundMap]:
        return find_fused(self.detector, net, batch)

    def losses(self, batch: Any) -> dict[str, Tensor]:
        return mean_losses([cooperative_loss(self.detector, self.net, sample, self.teaching) for sample in batch])


def find_fused(detector: DetectorNet, net: CooperativeNet, batch: Iterable[CooperativeSample]) -> list[FoundMap]:
    """Return what a cooperative network finds in the view of every receiver."""
    found: list[FoundMap] = []
    for sample in batch:
        with torch.no_grad():
            found += find_in(net, sent_maps(detector, net, sample), sample)
    return found


def sent_maps(detector: DetectorNet, net: CooperativeNet, sample: CooperativeSample) -> SentMaps:
    """Return the maps of a sample's clouds, and what their agents send of them."""
    features = detector.encoder(sample.pillars)
    return SentMaps(features, *net.message(features), sample.grid)


def find_in(net: CooperativeNet, maps: SentMaps, sample: CooperativeSample) -> list[FoundMap]:
    """Return what is found in the views of a sample's receivers."""
    return [
        FoundMap(decode(net.head, fused_features(net, maps, view)[0], view.grid)[0], view.targets, view.grid)
        for view in sample.views
    ]


_MESSAGES_FIRST = 0.5
"""Share of the steps, at the beginning, in which messages are learned, and not yet how they change."""


class FlowTask(CooperativeTask):
    """The training of a `CooperativeNet` with flow, whose encoder and head are the detector's and stay so.

    In the first half messages and fusion are learned as those of any fusion. From then on messages stay as they are,
    because a flow that follows changing messages learns next to nothing. It learns without labels, from what late
    senders see now; the fusion goes on, on late maps that are moved by the flow of the moment. Gradients of neither
    reach the other.
    """

    draft = FlowDraft

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

    def find(self, net: CooperativeNet, batch: Any) -> list[FoundMap]:
        assert net.flow is not None
        found: list[FoundMap] = []
        for sample in batch:
            with torch.no_grad():
                maps = sent_maps(self.detector, net, sample.scene)
                if sample.late.late:
                    values = moved_to_now(maps.values, late_changes(net.flow, maps.values, sample), sample)
                    maps = maps._replace(values=values)
                found += find_in(net, maps, sample.scene)
        return found

    def losses(self, batch: Sequence[FlowSample]) -> dict[str, Tensor]:
        return mean_losses([self._losses(sample) for sample in batch])

    def _losses(self, sample: FlowSample) -> dict[str, Tensor]:
        if self.progress < _MESSAGES_FIRST:
            return cooperative_loss(self.detector, self.net, sample.scene, self.teaching)
        return self._flow_step(sample)

    def _flow_step(self, sample: FlowSample) -> dict[str, Tensor]:
        net = self.net
        assert net.flow is not None
        with torch.no_grad():
            maps = sent_maps(self.detector, net, sample.scene)
        parts = {"copy": copy_loss(net, maps.features, maps.values)}
        if sample.late.late:
            changes = late_changes(net.flow, maps.values, sample)
            parts |= flow_losses(net, maps.features, maps.values, changes, sample)
            maps = maps._replace(values=moved_to_now(maps.values, changes.detach(), sample))
        parts |= views_losses(net, maps, sample.scene, self.teaching)
        return {LOSS: sum_of(parts), **parts}


class DetectorAndFusion(nn.Module):
    """An encoder's detector, whose head is not trained, and the cooperative network on it."""

    def __init__(self, detector: DetectorNet, fused: CooperativeNet) -> None:
        super().__init__()
        self.detector, self.fused = detector, fused
        self.detector.encoder.requires_grad_(True)


class TogetherTask(TrainingTask[DetectorAndFusion]):
    """Stage C: the training of an encoder and a fusion together, from the ends of stages A and B."""

    cuts_apart = True

    def __init__(self, recipe: TrainingRecipe, seed: int) -> None:
        super().__init__()
        self._fusion = CooperativeTask(recipe, seed)  # its parts are those of `net`
        self.net = DetectorAndFusion(self._fusion.detector, self._fusion.net)
        self.frozen = self._fusion.frozen

    def cut(self, clip: Clip, rng: np.random.Generator) -> Sequence[Any]:
        return self._fusion.cut(clip, rng)

    def cut_held_out(self, clip: Clip, rng: np.random.Generator) -> Sequence[Any]:
        return self._fusion.cut_held_out(clip, rng)

    def find(self, net: DetectorAndFusion, batch: Any) -> list[FoundMap]:
        return find_fused(net.detector, net.fused, batch)

    def losses(self, batch: Any) -> dict[str, Tensor]:
        both, teaching = self.net, self._fusion.teaching
        return mean_losses(
            [cooperative_loss(both.detector, both.fused, sample, teaching, frozen=False) for sample in batch]
        )

    def files(self, net: DetectorAndFusion, name: str) -> list[WeightsFile]:
        trained = {"detector": f"{name}_detector", "encoder_digest": encoder_digest(net.detector)}
        return [
            WeightsFile(name, net.fused, {**self._fusion.metadata, **trained}),
            WeightsFile(f"{name}_detector", net.detector, weights_metadata("detector", net.detector.config)),
        ]
