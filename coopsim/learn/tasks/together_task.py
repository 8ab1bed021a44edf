"""Stage C: an encoder and a fusion together, from where stages A and B ended."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from typing import Any, Self

import numpy as np
from torch import Tensor, nn

from coopsim.learn.clips.clip import Clip
from coopsim.learn.recipe import TrainingRecipe
from coopsim.learn.tasks.cooperative_task import CooperativeTask, find_fused
from coopsim.learn.tasks.fused_loss import cooperative_loss
from coopsim.learn.tasks.training_task import FoundMap, TrainingTask, WeightsFile, mean_losses
from coopsim.learn.weights import encoder_digest
from coopsim.nn.cooperative.cooperative_net import CooperativeNet
from coopsim.nn.detector.detector_net import DetectorNet


class Both(nn.Module):
    """An encoder's detector and the cooperative network on it.

    Args:
        detector: of single agents; its head is not trained, as no message or fused map goes through it.
        fused: the cooperative network.
    """

    def __init__(self, detector: DetectorNet, fused: CooperativeNet) -> None:
        super().__init__()
        self.detector, self.fused = detector, fused
        self.detector.encoder.requires_grad_(True)


class TogetherTask(TrainingTask):
    """The training of both.

    Args:
        recipe: of the kind "together".
        seed: of first weights, where the recipe has no `start`.

    Raises:
        InvalidValueError: detector, network and the weights to start with do not fit together.
    """

    net: Both

    def __init__(self, recipe: TrainingRecipe, seed: int) -> None:
        super().__init__()
        self._fusion = CooperativeTask(recipe, seed)  # its parts are those of `net`
        self.net = Both(self._fusion.detector, self._fusion.net)

    def train(self, mode: bool = True) -> Self:
        super().train(mode)
        self._fusion.train(mode)  # statistics of normalisation stay the detector's here, too
        return self

    def cut(self, clip: Clip, rng: np.random.Generator) -> Sequence[Any]:
        return self._fusion.cut(clip, rng)

    def cut_held_out(self, clip: Clip, rng: np.random.Generator) -> Sequence[Any]:
        return self._fusion.cut_held_out(clip, rng)

    def find(self, net: nn.Module, batch: Any) -> list[FoundMap]:
        assert isinstance(net, Both)
        return find_fused(net.detector, net.fused, batch)

    def forward(self, batch: Any) -> dict[str, Tensor]:
        return mean_losses(
            [
                cooperative_loss(self.net.detector, self.net.fused, sample, frozen=False, teacher=self._fusion.teacher)
                for sample in batch
            ]
        )

    def files(self, net: nn.Module, name: str) -> list[WeightsFile]:
        assert isinstance(net, Both)
        fused = self._fusion.files(net.fused, name)[0]
        said = {**fused.metadata, "detector": f"{name}_detector", "encoder_digest": encoder_digest(net.detector)}
        encoder = {"kind": "detector", "config": asdict(net.detector.config)}
        return [WeightsFile(name, net.fused, said), WeightsFile(f"{name}_detector", net.detector, encoder)]
