"""The training of an encoder of pictures whose features mean what an encoder of points means by them."""

from __future__ import annotations

import copy
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any, Self

import numpy as np
import torch
from torch import Tensor, nn

from coopsim.config.load import load
from coopsim.errors import InvalidValueError
from coopsim.learn.clips.clip import Clip
from coopsim.learn.losses.losses import head_loss, sum_of
from coopsim.learn.losses.picture_losses import alike_loss, depth_loss, label_loss
from coopsim.learn.recipe import TrainingRecipe
from coopsim.learn.samples.cloud_samples import SampleSettings
from coopsim.learn.samples.picture_samples import PicturesOfBatch, collate_picture_samples, picture_samples
from coopsim.learn.tasks.training_task import FoundMap, TrainingTask, WeightsFile
from coopsim.learn.weights import encoder_digest, load_detector, load_pictures, make_pictures
from coopsim.nn.camera.picture_detector import PictureDetectorNet
from coopsim.nn.detector.decode import decode
from coopsim.types import BevGrid


class PicturesTask(TrainingTask):
    """The training of a `PictureDetectorNet` beside a detector of points, whose head it has and does not change.

    All fusions that stand on that detector then take the maps of pictures, too, and maps of both kinds together.
    ("HEAL", Lu et al., ICLR 2024, section 3.2, trains encoders of further kinds of agents against a head that is kept.)
    The three scales begin as the detector's.

    Args:
        recipe: of the kind "pictures"; `detector` is that detector.
        seed: of the first weights.

    Raises:
        InvalidValueError: network, detector and the weights to start with do not fit together.
    """

    net: PictureDetectorNet

    def __init__(self, recipe: TrainingRecipe, seed: int) -> None:
        super().__init__()
        self._settings = load(SampleSettings, recipe.samples, "samples")
        detector = copy.deepcopy(load_detector(recipe.detector))
        self.net = make_pictures(recipe.network, seed)
        if detector.config.head != "centre" or detector.config.sweeps != 1:
            raise InvalidValueError(
                f"detector must have the head 'centre' and look at one sweep; {recipe.detector!r} does not"
            )
        mine, other = self.net.config.maps, detector.config
        for name in ("cell_m", "pillar_features", "channels", "layers", "features"):
            if getattr(mine, name) != getattr(other, name):
                raise InvalidValueError(
                    f"the network must have the detector's {name}, {getattr(other, name)}, has {getattr(mine, name)}"
                )
        for part in ("scales", "sides", "join"):
            getattr(self.net.encoder, part).load_state_dict(getattr(detector.encoder, part).state_dict())
        self.net.head.load_state_dict(detector.head.state_dict())
        if recipe.start is not None:
            self.net.load_state_dict(load_pictures(recipe.start, detector).state_dict())
        self.net.head.requires_grad_(False)
        self.detector = detector.requires_grad_(False)
        self._metadata = {
            "kind": "pictures",
            "config": asdict(self.net.config),
            "detector": Path(recipe.detector).stem,
            "encoder_digest": encoder_digest(detector),
        }

    def train(self, mode: bool = True) -> Self:
        super().train(mode)
        self.detector.eval()
        self.net.head.eval()
        return self

    def cut(self, clip: Clip, rng: np.random.Generator) -> Sequence[Any]:
        return picture_samples(clip, rng, self._settings, self.net.config.cell_m)

    def cut_held_out(self, clip: Clip, rng: np.random.Generator) -> Sequence[Any]:
        return picture_samples(clip, rng, self._settings, self.net.config.cell_m, whole=True)

    def find(self, net: nn.Module, batch: Any) -> list[FoundMap]:
        assert isinstance(net, PictureDetectorNet)
        targets = batch.targets
        rows, columns = targets.heat.shape[2:]
        grid = BevGrid((0.0, columns * targets.cell_m), (0.0, rows * targets.cell_m), targets.cell_m)
        with torch.no_grad():
            found = decode(net.head, net.encoder(batch.pictures), grid)
        return [FoundMap(found[0], targets, grid)]

    def collate(self, samples: Sequence[Any]) -> Any:
        return collate_picture_samples(samples)

    def files(self, net: nn.Module, name: str) -> list[WeightsFile]:
        return [WeightsFile(name, net, self._metadata)]

    def forward(self, batch: PicturesOfBatch) -> dict[str, Tensor]:
        encoder = self.net.encoder
        seen = encoder.pictures.look(batch.pictures)
        features = encoder.of_canvas(encoder.pictures.canvas(batch.pictures, seen))
        with torch.no_grad():
            of_points = self.detector.encoder(batch.pillars)
        parts = head_loss(self.net.head, features, batch.targets)
        parts.pop("loss")
        share = 1 / len(seen)
        groups = list(zip(seen, batch.depth_m, batch.label, strict=True))
        bins = self.net.config.bins
        parts["depth"] = share * sum(depth_loss(each.depth, depth_m, label, bins) for each, depth_m, label in groups)
        parts["label"] = share * sum(label_loss(each.label, label) for each, _, label in groups)
        parts["alike"] = alike_loss(features, of_points, batch.targets.heat)
        return {"loss": sum_of(parts), **parts}
