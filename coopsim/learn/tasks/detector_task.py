"""Stage A: an encoder with its head, on the views of single agents, or on clouds of several for early fusion."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, replace
from typing import Any

import numpy as np
import torch
from torch import Tensor, nn

from coopsim.config.load import load
from coopsim.learn.clips.clip import Clip
from coopsim.learn.losses.targets import Targets
from coopsim.learn.recipe import TrainingRecipe
from coopsim.learn.samples.cloud_samples import SampleSettings, collate_detector, detector_loss, detector_samples
from coopsim.learn.tasks.training_task import FoundMap, TrainingTask, WeightsFile, first_net
from coopsim.learn.weights import load_detector, make_detector
from coopsim.nn.detector.decode import decode
from coopsim.nn.detector.detector_net import DetectorNet
from coopsim.types import BevGrid


class DetectorTask(TrainingTask):
    """The training of a `DetectorNet`.

    Args:
        recipe: of the kind "detector".
        seed: of the first weights.

    Raises:
        InvalidValueError: the weights to start with are of another network.
    """

    net: DetectorNet

    def __init__(self, recipe: TrainingRecipe, seed: int) -> None:
        super().__init__()
        self._settings = load(SampleSettings, recipe.samples, "samples")
        self.net = first_net(recipe, make_detector(recipe.network, seed), load_detector)

    def cut(self, clip: Clip, rng: np.random.Generator) -> Sequence[Any]:
        return detector_samples(clip, rng, self._settings, self.net.config.cell_m, self.net.config.sweeps)

    def cut_held_out(self, clip: Clip, rng: np.random.Generator) -> Sequence[Any]:
        merged = round(self._settings.merged)
        settings = replace(self._settings, merged=merged, thinned=0.0, mirrored=0.0, dropout=0.0, crop_cells=None)
        return detector_samples(clip, rng, settings, self.net.config.cell_m, self.net.config.sweeps)

    def find(self, net: nn.Module, batch: Any) -> list[FoundMap]:
        assert isinstance(net, DetectorNet)
        targets: Targets = batch.targets
        rows, columns = targets.heat.shape[2:]
        # Where the map lies in its agent's frame is of no matter here.
        grid = BevGrid((0.0, columns * targets.cell_m), (0.0, rows * targets.cell_m), targets.cell_m)
        with torch.no_grad():
            found = decode(net.head, net.encoder(batch.pillars), grid)
        return [FoundMap(found[0], targets, grid)]

    def collate(self, samples: Sequence[Any]) -> Any:
        return collate_detector(samples)

    def files(self, net: nn.Module, name: str) -> list[WeightsFile]:
        return [WeightsFile(name, net, {"kind": "detector", "config": asdict(self.net.config)})]

    def forward(self, batch: Any) -> dict[str, Tensor]:
        return detector_loss(self.net, batch)
