"""Stage B: a fusion on the features of a frozen encoder. Stage C: the fusion and the encoder."""

from __future__ import annotations

import copy
from collections.abc import Iterable, Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any, Self

import numpy as np
import torch
from torch import Tensor, nn

from coopsim.config.load import load
from coopsim.errors import InvalidValueError
from coopsim.learn.clips.clip import Clip
from coopsim.learn.losses.teacher_loss import require_fitting
from coopsim.learn.recipe import TrainingRecipe
from coopsim.learn.samples.cloud_samples import SampleSettings
from coopsim.learn.samples.fused_samples import CooperativeSample, scene_samples
from coopsim.learn.tasks.fused_loss import cooperative_loss, fused_features
from coopsim.learn.tasks.training_task import FoundMap, TrainingTask, WeightsFile, mean_losses
from coopsim.learn.weights import encoder_digest, load_cooperative, load_detector, make_cooperative
from coopsim.nn.cooperative.cooperative_net import CooperativeNet
from coopsim.nn.detector.decode import decode
from coopsim.nn.detector.detector_net import DetectorNet


class CooperativeTask(TrainingTask):
    """The training of a `CooperativeNet`, whose head begins as the detector's.

    Args:
        recipe: of the kind "cooperative".
        seed: of the first weights.

    Raises:
        InvalidValueError: detector, teacher, network and the weights to start with do not fit together.
    """

    net: CooperativeNet

    def __init__(self, recipe: TrainingRecipe, seed: int) -> None:
        super().__init__()
        self._settings = load(SampleSettings, recipe.samples, "samples")
        detector = load_detector(recipe.detector)
        if detector.config.head != "centre":
            raise InvalidValueError(
                f"detector must have the head 'centre', with which a fusion's begins; {recipe.detector!r} has "
                f"{detector.config.head!r}"
            )
        self.net, config = make_cooperative({"features": detector.config.features, **recipe.network}, seed)
        if config.features != detector.config.features:
            raise InvalidValueError(f"network features must be the detector's {detector.config.features}")
        if config.flow and recipe.kind != "flow":
            raise InvalidValueError(
                f"network flow must be 0 with kind: {recipe.kind}, got {config.flow}: see kind: flow"
            )
        if recipe.start is None:
            self.net.head.load_state_dict(detector.head.state_dict())
        else:
            self._start(load_cooperative(recipe.start, detector))
        self.detector = copy.deepcopy(detector).eval().requires_grad_(False)
        self.teacher = None if recipe.teacher is None else copy.deepcopy(load_detector(recipe.teacher))
        if self.teacher is not None:
            require_fitting(self.teacher, detector)
        self._metadata = {
            "kind": "cooperative",
            "config": asdict(config),
            "detector": Path(recipe.detector).stem,
            "encoder_digest": encoder_digest(detector),
        }

    def _start(self, start: nn.Module) -> None:
        try:
            self.net.load_state_dict(start.state_dict())
        except RuntimeError as error:
            raise InvalidValueError(f"network must be that of start: {error}") from error

    def train(self, mode: bool = True) -> Self:
        super().train(mode)
        self.detector.eval()
        if self.teacher is not None:
            self.teacher.eval()
        # Statistics of normalisation stay the detector's: one scene is too few to measure them.
        for module in self.net.modules():
            if isinstance(module, nn.modules.batchnorm._BatchNorm):
                module.eval()
        return self

    def cut(self, clip: Clip, rng: np.random.Generator) -> Sequence[Any]:
        config, taught = self.detector.config, self.teacher is not None
        return scene_samples(clip, rng, self._settings, config.cell_m, config.sweeps, taught=taught)

    def cut_held_out(self, clip: Clip, rng: np.random.Generator) -> Sequence[Any]:
        settings = replace(self._settings, thinned=0.0, mirrored=0.0, dropout=0.0, receivers=None)
        return scene_samples(clip, rng, settings, self.detector.config.cell_m, self.detector.config.sweeps)

    def find(self, net: nn.Module, batch: Any) -> list[FoundMap]:
        assert isinstance(net, CooperativeNet)
        return find_fused(self.detector, net, batch)

    def files(self, net: nn.Module, name: str) -> list[WeightsFile]:
        return [WeightsFile(name, net, self._metadata)]

    def forward(self, batch: Any) -> dict[str, Tensor]:
        return mean_losses(
            [cooperative_loss(self.detector, self.net, sample, teacher=self.teacher) for sample in batch]
        )


def find_fused(detector: DetectorNet, net: CooperativeNet, batch: Iterable[CooperativeSample]) -> list[FoundMap]:
    """Return what a cooperative network finds in the view of every receiver."""
    found: list[FoundMap] = []
    for sample in batch:
        with torch.no_grad():
            features = detector.encoder(sample.pillars)
            found += find_in(net, features, *net.message(features), sample)
    return found


def find_in(
    net: CooperativeNet, features: Tensor, values: Tensor, sure: Tensor, sample: CooperativeSample
) -> list[FoundMap]:
    """Return what is found in the views of a sample's receivers; arguments as of `fused_features`."""
    found = []
    for view in sample.views:
        fused, _ = fused_features(net, features, values, sure, sample.grid, view)
        found.append(FoundMap(decode(net.head, fused, view.grid)[0], view.targets, view.grid))
    return found
