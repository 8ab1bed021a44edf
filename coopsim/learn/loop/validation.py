"""Validation on held-out clips in the middle of a training: a task's own values, or average precision on samples.

The latter is quick and comparable only within one training: samples show parts of maps, and their truth is what their
agents see. `coopsim detect` measures networks as they are used.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import nn

from coopsim.geometry.boxes import Boxes3D
from coopsim.learn.clips.clip import ClipSource
from coopsim.learn.samples.targets import Targets
from coopsim.learn.tasks.training_task import AnyTask, FoundMap
from coopsim.metrics.average_precision import average_precision_of
from coopsim.nn.detector.decode import GROUPS, cell_centers
from coopsim.nn.detector.detector_net import decode_boxes
from coopsim.nn.inference.backend import to_device
from coopsim.support.rng import stream
from coopsim.types import BevGrid

VEHICLES, _, PEOPLE = ([int(cls) for cls in group] for group in GROUPS)


class HeldOut:
    """Held-out samples of some clips of a source, cut by the task once and then kept."""

    def __init__(self, task: AnyTask, source: ClipSource, clips: int, device: torch.device) -> None:
        self._task, self._source, self._clips, self._device = task, source, clips, device
        self._batches: list[Any] = []

    def __call__(self, net: nn.Module) -> Mapping[str, float]:
        """Return the task's values by name, or average precisions in BEV of vehicles and of people."""
        values = self._task.evaluate(net, self._on_device())
        if values is not None:
            return values
        maps = self.maps(net)
        return {
            "AP@0.5": precision_of(maps, VEHICLES, 0.5),
            "AP@0.7": precision_of(maps, VEHICLES, 0.7),
            "people AP@0.3": precision_of(maps, PEOPLE, 0.3),
        }

    def maps(self, net: nn.Module) -> list[FoundMap]:
        """Return what a network finds in the held-out maps."""
        return [each for batch in self._on_device() for each in self._task.find(net, batch)]

    def _on_device(self) -> list[Any]:
        if not self._batches:
            for index in range(self._clips):
                samples = self._task.cut_held_out(self._source.clip(index), stream(0, "training.held_out", str(index)))
                self._batches += [self._task.collate([sample]) for sample in samples]
        return [to_device(batch, self._device) for batch in self._batches]


def precision_of(maps: Sequence[FoundMap], labels: Sequence[int], iou: float) -> float:
    """Return the average precision in BEV of the detections in maps, of the classes with these labels."""
    found, truth = [], []
    for each in maps:
        kept = np.isin(each.detections.label, labels) & ~doubtful(each)
        found.append((Boxes3D.from_array(each.detections.boxes.array[kept]), each.detections.score[kept]))
        truth.append(true_boxes(each.targets.to("cpu"), each.grid, labels))
    return average_precision_of(found, truth, iou, view="BEV")


def doubtful(each: FoundMap) -> NDArray[np.bool_]:
    """Return flags (N,) of detections near objects that hardly show, which count neither way."""
    grid, ignored = each.grid, each.targets.ignored[0].cpu().numpy()
    xy = each.detections.boxes.array[:, :2]
    low, last = np.array([grid.x_m[0], grid.y_m[0]]), np.array(ignored.shape[::-1]) - 1
    column, row = np.clip(np.floor((xy - low) / grid.cell_m).astype(np.int64), 0, last).T
    flags: NDArray[np.bool_] = ignored[row, column]
    return flags


def true_boxes(targets: Targets, grid: BevGrid, labels: Sequence[int]) -> Boxes3D:
    """Return the boxes of the objects whose centres lie in a map."""
    cells = targets.cell % (grid.shape[0] * grid.shape[1])
    centres = (targets.weight == 1) & torch.isin(targets.label, torch.tensor(labels))
    boxes, _ = decode_boxes(
        targets.code[centres], targets.label[centres], cell_centers(cells[centres], grid), grid.cell_m
    )
    return Boxes3D.from_array(boxes.double().numpy())
