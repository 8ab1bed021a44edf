"""Stage A: an encoder with its head, on the views of single agents, or on clouds of several for early fusion."""

from __future__ import annotations

import copy
from collections.abc import Sequence
from dataclasses import asdict
from typing import Any

import numpy as np
from torch import Tensor

from coopsim.config.load import load
from coopsim.errors import InvalidValueError
from coopsim.learn.recipe import TrainingRecipe
from coopsim.learn.samples import SampleSettings, collate_detector, detector_loss, detector_samples
from coopsim.learn.scene import Clip
from coopsim.learn.training_task import TrainingTask
from coopsim.learn.weights import load_detector, make_detector
from coopsim.nn.detector_net import DetectorNet


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
        self.net = make_detector(recipe.network, seed)
        if recipe.start is not None:
            start = load_detector(recipe.start)
            if recipe.network and start.config != self.net.config:
                raise InvalidValueError(f"network must be that of start, {asdict(start.config)}, or left out")
            self.net = copy.deepcopy(start).requires_grad_(True)
        self.metadata = {"kind": "detector", "config": asdict(self.net.config)}

    def cut(self, clip: Clip, rng: np.random.Generator) -> Sequence[Any]:
        return detector_samples(clip, rng, self._settings, self.net.config.cell_m)

    def collate(self, samples: Sequence[Any]) -> Any:
        return collate_detector(samples)

    def forward(self, batch: Any) -> dict[str, Tensor]:
        return detector_loss(self.net, batch)
