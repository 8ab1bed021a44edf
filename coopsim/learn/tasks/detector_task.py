"""Stage A: an encoder with its head, on the views of single agents, or on clouds of several for early fusion."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import torch
from torch import Tensor

from coopsim.config.load import load
from coopsim.errors import InvalidValueError
from coopsim.learn.clips.clip import Clip
from coopsim.learn.clips.world_recipe import WorldRecipe
from coopsim.learn.losses.head_losses import head_loss
from coopsim.learn.losses.own_losses import own_losses
from coopsim.learn.losses.street_losses import motion_loss
from coopsim.learn.recipe import TrainingRecipe
from coopsim.learn.samples.cloud_samples import DetectorBatch, SampleSettings, collate_detector, detector_samples
from coopsim.learn.samples.targets import Targets
from coopsim.learn.tasks.training_task import FoundMap, TrainingTask, first_net, weights_metadata
from coopsim.localization.odometry import LONGEST_S
from coopsim.nn.detector.decode import decode
from coopsim.nn.detector.detector_net import DetectorNet
from coopsim.types import BevGrid


class DetectorTask(TrainingTask[DetectorNet]):
    """The training of a `DetectorNet`."""

    cuts_apart = True

    def __init__(self, recipe: TrainingRecipe, seed: int) -> None:
        super().__init__()
        self._settings = load(SampleSettings, recipe.samples, "samples")
        self._own = own_losses(recipe.loss)
        self.net = first_net(recipe.changed(kind="detector"), seed)
        if recipe.kind == "detector" and recipe.start is None and self.net.config.head == "turned":
            raise InvalidValueError('network head must not be "turned" without start: kind: front makes one')
        self.metadata = weights_metadata("detector", self.net.config)
        times_s = tuple(recipe.world.get("sweep_s", ())) + tuple(recipe.world.get("dt_s", WorldRecipe().dt_s))
        if self.net.config.sweeps > 1 and min(times_s) > LONGEST_S:
            warnings.warn(
                f"a network on two sweeps sees one: no two frames are within {LONGEST_S:g} s; give world.sweep_s, as "
                "[0.1, 0.2]",
                stacklevel=2,
            )

    def cut(self, clip: Clip, rng: np.random.Generator) -> Sequence[Any]:
        return self._samples(clip, rng, self._settings)

    def cut_held_out(self, clip: Clip, rng: np.random.Generator) -> Sequence[Any]:
        merged = round(self._settings.merged)
        settings = replace(
            self._settings, merged=merged, thinned=0.0, single=0.0, mirrored=0.0, dropout=0.0, crop_cells=None
        )
        return self._samples(clip, rng, settings)

    def _samples(self, clip: Clip, rng: np.random.Generator, settings: SampleSettings) -> Sequence[Any]:
        return detector_samples(clip, rng, settings, self.net.config)

    def find(self, net: DetectorNet, batch: Any) -> list[FoundMap]:
        with torch.no_grad():
            return found_map(net.head, net.encoder(batch.pillars), batch.targets)

    def collate(self, samples: Sequence[Any]) -> Any:
        return collate_detector(samples)

    def losses(self, batch: DetectorBatch) -> dict[str, Tensor]:
        parts = head_loss(self.net.head, self.net.encoder(batch.pillars), batch.targets, self._own)
        if self.net.motion is not None and batch.moved is not None:  # in place of the code's velocities
            parts["velocity"] = motion_loss(self.net.motion(batch.moved.sweeps), batch.moved.motion)
        return parts


def found_map(head: Any, features: Tensor, targets: Targets) -> list[FoundMap]:
    """Return what a head finds in one map (1, C, h, w), whose place in its agent's frame does not matter."""
    rows, columns = targets.heat.shape[2:]
    grid = BevGrid((0.0, columns * targets.cell_m), (0.0, rows * targets.cell_m), targets.cell_m)
    return [FoundMap(decode(head, features, grid)[0], targets, grid)]
