"""The training of an encoder of pictures whose features mean what an encoder of points means by them."""

from __future__ import annotations

import copy
from collections.abc import Sequence
from typing import Any

import numpy as np
import torch
from torch import Tensor

from coopsim.config.load import load
from coopsim.errors import InvalidValueError
from coopsim.learn.clips.clip import Clip
from coopsim.learn.losses.head_losses import alike_loss, depth_loss, head_loss, label_loss
from coopsim.learn.recipe import TrainingRecipe
from coopsim.learn.samples.cloud_samples import SampleSettings
from coopsim.learn.samples.picture_samples import PicturesOfBatch, collate_picture_samples, picture_samples
from coopsim.learn.tasks.detector_task import found_map
from coopsim.learn.tasks.training_task import (
    FoundMap,
    TrainingTask,
    copy_weights,
    require_config_of,
    weights_metadata,
)
from coopsim.learn.weights import load_detector, load_pictures, load_points_and_pictures, make_network, read_texts
from coopsim.nn.camera.lift_splat import LiftSplatConfig, LiftSplatEncoder, PictureDetectorNet
from coopsim.nn.camera.picture_net import PictureFeatures
from coopsim.nn.camera.points_and_pictures import PointsAndPicturesNet
from coopsim.nn.detector.detector_net import DetectorNet

AnyPictureNet = PictureDetectorNet | PointsAndPicturesNet


class PicturesTask(TrainingTask[AnyPictureNet]):
    """The training of a network with cameras beside a detector of points, whose head it has and does not change.

    All fusions that stand on that detector then take the maps of pictures, too, and maps of both kinds together.
    ("HEAL", Lu et al., ICLR 2024, section 3.2, trains encoders of further kinds of agents against a head that is kept.)
    The three scales begin as the detector's. For the kind "points_and_pictures", so does the part on points, and
    `start` may be weights of the kind "pictures", with which the part on pictures begins.
    """

    cuts_apart = True

    def __init__(self, recipe: TrainingRecipe, seed: int) -> None:
        super().__init__()
        self._settings, self._depths_first = load(SampleSettings, recipe.samples, "samples"), recipe.depths_first
        detector = copy.deepcopy(load_detector(recipe.detector))
        if detector.config.sweeps != 1:
            raise InvalidValueError(f"detector must look at one sweep; {recipe.detector!r} looks at two")
        self.net = make_network(recipe.kind, recipe.network, seed)
        encoder = self.net.encoder
        self._config = encoder.config if isinstance(encoder, LiftSplatEncoder) else encoder.config.pictures
        _require_same_maps(self._config, detector)
        if isinstance(encoder, LiftSplatEncoder):
            for part in ("scales", "sides", "join"):
                getattr(encoder, part).load_state_dict(getattr(detector.encoder, part).state_dict())
        else:
            encoder.points.load_state_dict(detector.encoder.state_dict())
        copy_weights(detector.head, self.net.head)
        if recipe.start is not None:
            self._start(recipe.start, detector)
        self.net.head.requires_grad_(False)
        self.detector = detector.requires_grad_(False)
        self.frozen = [self.detector, self.net.head]
        self.metadata = weights_metadata(recipe.kind, self.net.config, recipe, detector)

    def _start(self, start: str, detector: DetectorNet) -> None:
        """Begin with the weights of a training before this one."""
        before: AnyPictureNet
        if self._reads_points and read_texts(start).get("kind") != "pictures":
            before = load_points_and_pictures(start, detector)
        else:
            before = load_pictures(start, detector)
        same_kind = type(before) is type(self.net)
        if same_kind:
            require_config_of(before, self.net.config)
            self.net.load_state_dict(before.state_dict())
        else:
            require_config_of(before, self._config, "network.pictures")
            self.net.encoder.pictures.load_state_dict(before.encoder.pictures.state_dict())

    def cut(self, clip: Clip, rng: np.random.Generator) -> Sequence[Any]:
        return picture_samples(clip, rng, self._settings, self._config.cell_m, points=self._reads_points)

    def cut_held_out(self, clip: Clip, rng: np.random.Generator) -> Sequence[Any]:
        return picture_samples(clip, rng, self._settings, self._config.cell_m, points=self._reads_points, whole=True)

    def find(self, net: AnyPictureNet, batch: Any) -> list[FoundMap]:
        with torch.no_grad():
            return found_map(net.head, _features(net, batch, _seen(net, batch)), batch.targets)

    def collate(self, samples: Sequence[Any]) -> Any:
        return collate_picture_samples(samples)

    def losses(self, batch: PicturesOfBatch) -> dict[str, Tensor]:
        seen = _seen(self.net, batch)
        if self.progress < self._depths_first:
            return self._image_losses(batch, seen)
        features = _features(self.net, batch, seen)
        parts = head_loss(self.net.head, features, batch.targets) | self._image_losses(batch, seen)
        if not self._reads_points:
            with torch.no_grad():
                of_points = self.detector.encoder(batch.pillars)
            parts["alike"] = alike_loss(features, of_points, batch.targets.heat)
        return parts

    def _image_losses(self, batch: PicturesOfBatch, seen: list[PictureFeatures]) -> dict[str, Tensor]:
        """Return the losses of depths and classes, means over the groups of pictures."""
        groups = list(zip(seen, batch.depth_m, batch.label, strict=True))
        depths = [depth_loss(each.depth, depth_m, label, self._config.bins) for each, depth_m, label in groups]
        labels = [label_loss(each.label, label) for each, _, label in groups]
        share = 1 / max(1, len(seen))
        return {"depth": share * torch.stack(depths).sum(), "label": share * torch.stack(labels).sum()}

    @property
    def _reads_points(self) -> bool:
        return isinstance(self.net, PointsAndPicturesNet)


def _seen(net: AnyPictureNet, batch: PicturesOfBatch) -> list[PictureFeatures]:
    """Return what is seen in the pictures of a batch."""
    encoder = net.encoder
    if isinstance(encoder, LiftSplatEncoder):
        return encoder.pictures.read(batch.pictures)
    return encoder.read(batch.pictures)


def _features(net: AnyPictureNet, batch: PicturesOfBatch, seen: list[PictureFeatures]) -> Tensor:
    """Return the features of a batch, (A, C, h, w)."""
    encoder = net.encoder
    if isinstance(encoder, LiftSplatEncoder):
        return encoder.of_canvas(encoder.pictures.canvas(batch.pictures, seen))
    return encoder.of_canvas(batch.pillars, batch.pictures, seen)


def _require_same_maps(config: LiftSplatConfig, detector: DetectorNet) -> None:
    """Check that maps of pictures are of the sizes of a detector's."""
    for name in ("cell_m", "pillar_features", "channels", "layers", "features", "pillars"):
        mine, other = getattr(config.maps, name), getattr(detector.config, name)
        if mine != other:
            raise InvalidValueError(f"the network must have the detector's {name}, {other}, has {mine}")
