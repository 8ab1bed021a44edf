"""The training of integrated detection and tracking on a frozen cooperative network."""

from __future__ import annotations

import copy
from collections.abc import Iterator, Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any, Self

import numpy as np
import torch
from torch import Tensor, nn

from coopsim.config.load import load
from coopsim.errors import InvalidValueError
from coopsim.geometry.se3 import SE3
from coopsim.learn.clips.clip import Clip
from coopsim.learn.losses.integrated_losses import TaughtFrame, frame_losses
from coopsim.learn.losses.losses import sum_of
from coopsim.learn.losses.query_losses import LabelledInstances, TrueObjects, labelled
from coopsim.learn.recipe import TrainingRecipe
from coopsim.learn.samples.cloud_samples import SampleSettings
from coopsim.learn.samples.fused_views import FusedView, fused_view
from coopsim.learn.samples.query_streams import QueryStream, StreamCutter, true_objects
from coopsim.learn.tasks.integrated_look import IntegratedLook
from coopsim.learn.tasks.training_task import LOSS, FoundMap, TrainingTask, WeightsFile, mean_losses
from coopsim.learn.weights import encoder_digest, load_cooperative, load_detector, make_integrated, read_config
from coopsim.nn.detector.encoder import STRIDE
from coopsim.nn.inference.query_perceiver import peaks_of
from coopsim.nn.integrated.integrated_net import IntegratedNet
from coopsim.nn.integrated.track_update import updated_tracks
from coopsim.nn.queries.instances import UNNUMBERED, Instances
from coopsim.nn.queries.query_net import SeenMap, kept_instances
from coopsim.types import BevGrid

_LONGEST_MISSED = 10
"""Frames after which what nobody sees is forgotten in training."""


class IntegratedTask(TrainingTask):
    """The training of an `IntegratedNet`, whose cooperative network is that of the recipe's `start` and stays so.

    Frames of a clip follow each other as they do in use. Tracks are paired with detections by which object they are.
    Gradients pass from frame to frame through features, not through boxes.

    Args:
        recipe: of the kind "integrated".
        seed: of the first weights.

    Raises:
        InvalidValueError: the recipe has no `start`, or detector, cooperative network and sizes do not fit together.
    """

    net: IntegratedNet

    def __init__(self, recipe: TrainingRecipe, seed: int) -> None:
        super().__init__()
        self._settings: SampleSettings = load(SampleSettings, recipe.samples, "samples")
        detector = load_detector(recipe.detector)
        if recipe.start is None:
            raise InvalidValueError("start must be weights of a cooperative network with kind: integrated, got none")
        if "cooperative" in recipe.network:
            raise InvalidValueError("network must leave out cooperative: that network is the one of start")
        cooperative = load_cooperative(recipe.start, detector)
        self.net = make_integrated({**recipe.network, "cooperative": read_config(recipe.start)}, seed)
        self.net.cooperative.load_state_dict(cooperative.state_dict())
        self.net.cooperative.requires_grad_(False)
        self.detector = copy.deepcopy(detector).eval().requires_grad_(False)
        self._streams = StreamCutter(self._settings, seed, recipe.block, self.detector, self._see)
        self._metadata = {
            "kind": "integrated",
            "config": asdict(self.net.config),
            "detector": Path(recipe.detector).stem,
            "encoder_digest": encoder_digest(detector),
        }

    def train(self, mode: bool = True) -> Self:
        super().train(mode)
        for frozen in (self.detector, self.net.cooperative):
            frozen.eval()  # their statistics of normalisation are not to change
        return self

    def cut(self, clip: Clip, rng: np.random.Generator) -> Sequence[QueryStream]:
        return self._streams.cut(clip, rng)

    def cut_held_out(self, clip: Clip, rng: np.random.Generator) -> Sequence[QueryStream]:
        return self._streams.cut_held_out(clip, rng, self._settings)

    def _see(self, features: Tensor, grid: BevGrid) -> SeenMap:
        return SeenMap(features[0], grid, self.net.nothing())  # of the fused map alone peaks are asked for

    def find(self, net: nn.Module, batch: Any) -> list[FoundMap]:
        return []

    def look(self, net: nn.Module, batches: Sequence[Sequence[QueryStream]]) -> dict[str, float]:
        assert isinstance(net, IntegratedNet)
        found = IntegratedLook()
        with torch.no_grad():
            for sample in (sample for batch in batches for sample in batch):
                for taught in taught_frames(net, sample, None):
                    found.add(taught)
        return found.values()

    def files(self, net: nn.Module, name: str) -> list[WeightsFile]:
        return [WeightsFile(name, net, self._metadata)]

    def forward(self, batch: Sequence[QueryStream]) -> dict[str, Tensor]:
        pillars = self._settings.crop_cells
        cells = None if pillars is None else pillars // STRIDE
        parts = mean_losses(
            [mean_losses([frame_losses(each) for each in taught_frames(self.net, one, cells)]) for one in batch]
        )
        return {LOSS: sum_of(parts), **parts}


def taught_frames(net: IntegratedNet, sample: QueryStream, crop_cells: int | None) -> Iterator[TaughtFrame]:
    """Yield the frames of all receivers that are taught, in order of time.

    Args:
        net: the network.
        sample: the clip.
        crop_cells: edge of what a receiver is shown, in cells of the features; None: as far as its own map reaches.
    """
    for agent in sample.receivers:
        tracks, before = net.nothing(), None
        for number, scene in enumerate(sample.clip.scenes):
            if number:
                way = SE3.from_xyz_yaw(sample.clip.scenes[number - 1].place_m[agent] - scene.place_m[agent], 0.0)
                tracks = tracks.moved(way)
                before = before.moved(way) if before is not None else None
            view = fused_view(net.cooperative, sample, number, agent, crop_cells)
            peaks = peaks_of(net, net.cooperative.head, view.features[None], view.grid)
            step = net(view.features, view.grid, peaks, tracks, before, sample.clip.dt_s)
            truth = _within(true_objects(sample, number, agent, alone=False), view)
            ids = torch.from_numpy(np.array(scene.object_id, np.int64))
            yield TaughtFrame(step, truth, same_objects(tracks.number, ids))
            tracks, before = _carried(step.detected, step.predicted, truth, ids, sample.clip.dt_s), step.prior
            tracks = tracks.surest(net.config.places)


def same_objects(number: Tensor, ids: Tensor) -> LabelledInstances:
    """Return which of the objects with these ids (N,) tracks with these numbers (K,) are."""
    same = (number[:, None] == ids) & (number != UNNUMBERED)[:, None]
    rows, objects = torch.nonzero(same, as_tuple=True)
    return LabelledInstances(rows, objects)


def _carried(detected: Instances, predicted: Instances, truth: TrueObjects, ids: Tensor, dt_s: float) -> Instances:
    """Return the tracks for the next frame, numbered by the ids of their objects; all detections begin tracks."""
    detected, predicted = (
        replace(each, box=each.box.detach(), velocity=each.velocity.detach(), score=each.score.detach())
        for each in (detected, predicted)
    )
    object_of = labelled(detected, truth).by_row(len(detected))
    number = torch.where(object_of >= 0, ids[object_of], UNNUMBERED) if len(ids) else object_of
    found = kept_instances(replace(detected, number=number))
    pairs = same_objects(predicted.number, found.number)
    born = torch.ones(len(found), dtype=torch.bool)
    born[pairs.objects] = False
    tracks = updated_tracks(predicted, found, (pairs.rows.numpy(), pairs.objects.numpy()), born, dt_s)
    known = (tracks.missed == 0) | ((tracks.number != UNNUMBERED) & (tracks.missed <= _LONGEST_MISSED))
    return tracks[known]


def _within(truth: TrueObjects, view: FusedView) -> TrueObjects:
    """Return the objects, of which those outside a view are not to be found."""
    (x_low, x_high), (y_low, y_high) = view.grid.x_m, view.grid.y_m
    x, y = truth.box[:, 0], truth.box[:, 1]
    inside = (x_low <= x) & (x <= x_high) & (y_low <= y) & (y <= y_high)
    return replace(truth, shown=truth.shown & inside)
