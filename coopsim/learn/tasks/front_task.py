"""The training of a head's second look for which end of a vehicle is its front, while all else stays as it is."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
import torch
from torch import Tensor
from torch.nn import functional

from coopsim.errors import InvalidValueError
from coopsim.learn.clips.clip import Clip
from coopsim.learn.losses.fused_losses import fused_features
from coopsim.learn.losses.judge_losses import found_boxes
from coopsim.learn.recipe import TrainingRecipe
from coopsim.learn.samples.targets import Targets
from coopsim.learn.tasks.cooperative_task import CooperativeTask, sent_maps
from coopsim.learn.tasks.detector_task import DetectorTask
from coopsim.learn.tasks.training_task import LOSS, TrainingTask, copy_weights
from coopsim.learn.weights import find_weights, load_network, read_texts
from coopsim.nn.cooperative.cooperative_net import CooperativeNet
from coopsim.nn.detector.detector_net import VEHICLES, DetectorNet
from coopsim.nn.inference.backend import numbers_on, to_device

_KINDS = ("detector", "cooperative")
"""Kinds of weights whose head finds boxes in maps of points."""

_LEAST_SCORE, _SURE, _MOST = 0.1, 0.3, 200
"""Smallest score of a vehicle that is learned from, and judged in validation, and most boxes of a map."""


@dataclass(frozen=True, slots=True, eq=False)
class FoundVehicle:
    """Features (9 C,) in and around a found vehicle, and 1 or 0 for the right or wrong way round; or a stack."""

    patches: Tensor
    ahead: Tensor


class FrontTask(TrainingTask[DetectorNet | CooperativeNet]):
    """The training of a second look on the vehicles that a network finds, of a detector or of a fusion.

    The recipe's `start` names the network. A head without a second look gets one: that of the fusion's detector if it
    has one, else one with random weights. Maps are those of the network's own kind of training; a sample is a vehicle
    in one of them.
    """

    def __init__(self, recipe: TrainingRecipe, seed: int) -> None:
        super().__init__()
        if recipe.start is None or recipe.network:
            raise InvalidValueError(
                "with kind: front, start must name the weights whose head gets a second look, and network must be left "
                "out"
            )
        kind = read_texts(find_weights(recipe.start)).get("kind")
        if kind not in _KINDS:
            raise InvalidValueError(f"start must be weights of the kind {' or '.join(_KINDS)}, is {kind!r}")
        given = load_network(kind, recipe.start)
        if given.config.head in ("judged", "street"):
            raise InvalidValueError(f"start {recipe.start!r} has a second look that is trained with kind: {kind}")
        inner = recipe.changed(start=None, network={**asdict(given.config), "head": "turned"})
        self._maps: DetectorTask | CooperativeTask = (
            DetectorTask(inner, seed) if kind == "detector" else CooperativeTask(inner, seed)
        )
        self.net = self._maps.net
        copy_weights(given, self.net)
        self.net.requires_grad_(False)
        assert self.net.head.judge is not None
        self.net.head.judge.requires_grad_(True)
        self.frozen = [self._maps.eval()]
        self.metadata = self._maps.metadata
        self._precision = recipe.precision

    def cut(self, clip: Clip, rng: np.random.Generator) -> Sequence[FoundVehicle]:
        return self._vehicles(self._maps.cut(clip, rng), _LEAST_SCORE)

    def cut_held_out(self, clip: Clip, rng: np.random.Generator) -> Sequence[FoundVehicle]:
        return self._vehicles(self._maps.cut_held_out(clip, rng), _SURE)

    def collate(self, samples: Sequence[FoundVehicle]) -> FoundVehicle:
        return FoundVehicle(
            torch.stack([each.patches for each in samples]), torch.stack([each.ahead for each in samples])
        )

    def evaluate(self, net: DetectorNet | CooperativeNet, batches: Sequence[FoundVehicle]) -> dict[str, float]:
        """Return the share of surely found vehicles that point backwards after the second look; NaN without any."""
        if not batches:
            return {"backwards": float("nan")}
        whole = FoundVehicle(torch.cat([each.patches for each in batches]), torch.cat([each.ahead for each in batches]))
        with torch.no_grad():
            wrong = (self._forward_of(net, whole) > 0) != (whole.ahead > 0)
        return {"backwards": float(wrong.float().mean())}

    def losses(self, batch: FoundVehicle) -> dict[str, Tensor]:
        front = functional.binary_cross_entropy_with_logits(self._forward_of(self.net, batch), batch.ahead)
        return {LOSS: front, "front": front}

    def _forward_of(self, net: DetectorNet | CooperativeNet, batch: FoundVehicle) -> Tensor:
        assert net.head.judge is not None
        forward: Tensor = net.head.judge(batch.patches)[0]
        return forward

    def _vehicles(self, samples: Sequence[Any], least_score: float) -> list[FoundVehicle]:
        place = next(self.net.parameters()).device
        short, head = numbers_on(place, self._precision) is torch.bfloat16, self.net.head
        made: list[FoundVehicle] = []
        with torch.no_grad(), torch.autocast(place.type, torch.bfloat16, enabled=short):
            for sample in samples:
                for features, targets in self._features(to_device(self._maps.collate([sample]), place)):
                    shared, logits = head.heat(features)
                    seen = found_boxes(head, features, shared, logits, targets, least_score, _MOST)
                    kept = (seen.ahead != 0) & (seen.group == VEHICLES)
                    ahead = (seen.ahead[kept] > 0).float().cpu()
                    made += map(FoundVehicle, seen.patches[kept].float().cpu().unbind(), ahead.unbind())
        return made

    def _features(self, batch: Any) -> Iterator[tuple[Tensor, Targets]]:
        """Yield maps (B, C, h, w) of features as heads read them, and their targets."""
        if isinstance(self._maps, DetectorTask):
            assert isinstance(self.net, DetectorNet)
            yield self.net.encoder(batch.pillars), batch.targets
            return
        assert isinstance(self.net, CooperativeNet)
        for sample in batch:
            maps = sent_maps(self._maps.detector, self.net, sample)
            for view in sample.views:
                yield fused_features(self.net, maps, view)[0], view.targets.to(maps.features.device)
