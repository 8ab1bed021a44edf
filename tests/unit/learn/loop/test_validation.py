"""The look at held-out places: perfect detections score 1, none 0, and samples are cut once."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest
import torch
from synthetic_clips import SyntheticClips
from torch import nn

from coopsim.geometry.boxes import Boxes3D
from coopsim.learn.clips.clip import Clip
from coopsim.learn.loop.validation import HeldOut
from coopsim.learn.samples.targets import Targets, make_targets
from coopsim.learn.tasks.training_task import FoundMap
from coopsim.types import BevGrid, Detections

GRID = BevGrid((-19.2, 19.2), (-19.2, 19.2), 1.2)


@dataclass
class PerfectTask:
    """Finds what is there, moved by an error."""

    error_m: float = 0.0
    cuts: int = 0

    def cut_held_out(self, clip: Clip, rng: np.random.Generator) -> Sequence[Any]:
        self.cuts += 1
        return [(scene.boxes, scene.velocity, scene.label) for scene in clip.scenes]

    def collate(self, samples: Sequence[Any]) -> Any:
        return samples[0]

    def evaluate(self, net: nn.Module, batches: Sequence[Any]) -> None:
        return None

    def find(self, net: nn.Module, batch: Any) -> list[FoundMap]:
        boxes, velocity, label = batch
        targets: Targets = make_targets(boxes, velocity, label, GRID)
        found = Detections(Boxes3D.from_array(boxes + self.error_m * np.eye(7)[0]), np.ones(len(boxes)), label)
        return [FoundMap(found, targets, GRID)]


@pytest.mark.parametrize(("error_m", "expected"), [(0.0, 1.0), (5.0, 0.0)])
def test_what_is_found_is_compared_with_what_is_there(error_m: float, expected: float) -> None:
    task = PerfectTask(error_m)
    look = HeldOut(task, SyntheticClips(), 2, torch.device("cpu"))  # type: ignore[arg-type]
    for _ in range(2):
        values = look(nn.Identity())
        assert values["AP@0.5"] == pytest.approx(expected) and values["people AP@0.3"] == 0.0
    assert task.cuts == 2
