"""The training of integrated detection and tracking on a frozen cooperative network."""

from __future__ import annotations

import copy
from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np
import torch
from torch import Tensor

from coopsim.config.load import load
from coopsim.errors import InvalidValueError
from coopsim.geometry.se3 import SE3
from coopsim.learn.clips.clip import Clip
from coopsim.learn.losses.instance_losses import LabelledInstances, TaughtFrame, frame_losses, labelled, xiou_of_pairs
from coopsim.learn.recipe import TrainingRecipe
from coopsim.learn.samples.cloud_samples import SampleSettings
from coopsim.learn.samples.query_streams import (
    QueryStream,
    StreamCutter,
    TrueObjects,
    fused_view,
    true_objects,
)
from coopsim.learn.tasks.query_task import SURE, QueryEvaluation
from coopsim.learn.tasks.training_task import TrainingTask, mean_losses, weights_metadata
from coopsim.learn.weights import load_cooperative, load_detector, make_network, read_config
from coopsim.nn.detector.encoder import STRIDE
from coopsim.nn.integrated.integrated_net import IntegratedNet
from coopsim.nn.integrated.perceiver import updated_tracks
from coopsim.nn.queries.instances import UNNUMBERED, Instances
from coopsim.nn.queries.perceiver import peaks_of
from coopsim.nn.queries.query_net import QueryStep, SeenMap, kept_instances
from coopsim.types import BevGrid

_LONGEST_MISSED = 10
"""Frames after which a track that no agent sees ends in training."""


class IntegratedTask(TrainingTask[IntegratedNet]):
    """The training of an `IntegratedNet`, whose cooperative network is that of the recipe's `start` and stays so.

    Frames of a clip follow each other as they do in use. Tracks are paired with detections by which object they are.
    Gradients pass from frame to frame through features, not through boxes.
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
        self.net = make_network("integrated", {**recipe.network, "cooperative": read_config(recipe.start)}, seed)
        self.net.cooperative.load_state_dict(cooperative.state_dict())
        self.net.cooperative.requires_grad_(False)
        self.detector = copy.deepcopy(detector).eval().requires_grad_(False)
        self._streams = StreamCutter(self._settings, seed, recipe.block, self.detector, self._see)
        self.frozen = [self.detector, self.net.cooperative]
        self.metadata = weights_metadata("integrated", self.net.config, recipe, detector)

    def cut(self, clip: Clip, rng: np.random.Generator) -> Sequence[QueryStream]:
        return self._streams.cut(clip, rng)

    def cut_held_out(self, clip: Clip, rng: np.random.Generator) -> Sequence[QueryStream]:
        return self._streams.cut_held_out(clip, rng, self._settings)

    def _see(self, features: Tensor, grid: BevGrid) -> SeenMap:
        return SeenMap(features[0], grid, self.net.nothing())  # of the fused map alone peaks are asked for

    def evaluate(self, net: IntegratedNet, batches: Sequence[Sequence[QueryStream]]) -> dict[str, float]:
        found = IntegratedEvaluation()
        with torch.no_grad():
            for sample in (sample for batch in batches for sample in batch):
                for taught in taught_frames(net, sample, None):
                    found.add(taught)
        return found.values()

    def losses(self, batch: Sequence[QueryStream]) -> dict[str, Tensor]:
        pillars = self._settings.crop_cells
        cells = None if pillars is None else pillars // STRIDE
        return mean_losses(
            [mean_losses([frame_losses(each) for each in taught_frames(self.net, one, cells)]) for one in batch]
        )


def taught_frames(net: IntegratedNet, sample: QueryStream, crop_cells: int | None) -> Iterator[TaughtFrame]:
    """Yield the frames of all receivers that are taught, in order of time; crop_cells: see `fused_view`."""
    for agent in sample.receivers:
        tracks, before = net.nothing(), None
        for number, scene in enumerate(sample.clip.scenes):
            if number:
                way = SE3.from_xyz_yaw(sample.clip.scenes[number - 1].place_m[agent] - scene.place_m[agent], 0.0)
                tracks = tracks.moved(way)
                before = before.moved(way) if before is not None else None
            features, grid = fused_view(net.cooperative, sample, number, agent, crop_cells)
            peaks = peaks_of(net, net.cooperative.head, features[None], grid)
            step = net(features, grid, peaks, tracks, before, sample.clip.dt_s)
            truth = _within(true_objects(sample, number, agent, alone=False), grid)
            ids = torch.from_numpy(np.array(scene.object_id, np.int64)).to(features.device)
            yield TaughtFrame(step, truth, same_objects(tracks.number, ids))
            tracks, before = _carried(step.detected, step.predicted, truth, ids, sample.clip.dt_s), step.prior
            tracks = tracks.surest(net.config.places)


def same_objects(number: Tensor, ids: Tensor) -> LabelledInstances:
    """Return the pairs of tracks with numbers (K,) and objects with ids (N,) that are the same."""
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
    born = torch.ones(len(found), dtype=torch.bool, device=ids.device)
    born[pairs.objects] = False
    tracks = updated_tracks(predicted, found, (pairs.rows.cpu().numpy(), pairs.objects.cpu().numpy()), born, dt_s)
    known = (tracks.missed == 0) | ((tracks.number != UNNUMBERED) & (tracks.missed <= _LONGEST_MISSED))
    return tracks[known]


def _within(truth: TrueObjects, grid: BevGrid) -> TrueObjects:
    """Return the objects, with those outside a grid not to be found."""
    (x_low, x_high), (y_low, y_high) = grid.x_m, grid.y_m
    x, y = truth.box[:, 0], truth.box[:, 1]
    inside = (x_low <= x) & (x <= x_high) & (y_low <= y) & (y <= y_high)
    return replace(truth, shown=truth.shown & inside)


class IntegratedEvaluation:
    """Values of validation: detections of the detection branch, and errors of the prediction branch, over frames."""

    def __init__(self) -> None:
        self._detected = QueryEvaluation()
        self._xiou: list[float] = []
        self._seen: list[float] = []
        self._hidden: list[float] = []

    def add(self, taught: TaughtFrame) -> None:
        """Count a frame of one receiver."""
        step, truth, same = taught.step, taught.truth, taught.same
        self._detected.add(QueryStep(step.detected, step.detected_logits, []), truth)
        with torch.no_grad():
            xiou = xiou_of_pairs(step.predicted.box[same.rows], truth.box[same.objects])
        self._xiou += xiou.tolist()
        sure, shown = (step.predicted.score[same.rows] >= SURE).float(), truth.shown[same.objects]
        self._seen += sure[shown].tolist()
        self._hidden += sure[~shown].tolist()

    def values(self) -> dict[str, float]:
        """Return the values of detections, mean XIOU of predictions, and shares of sure ones, seen and hidden."""
        predicted = {"predicted XIOU": self._xiou, "sure if seen": self._seen, "sure if hidden": self._hidden}
        means = {name: round(float(np.mean(each)), 4) if each else 0.0 for name, each in predicted.items()}
        return self._detected.values() | means
