"""The training of identity: what is told apart, what is held out, and what teachers add."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest
import torch
from synthetic_clips import SyntheticClips
from torch import Tensor, nn

from coopsim.errors import UnknownNameError
from coopsim.geometry.se3 import Floats
from coopsim.learn.clips.clip import Clip
from coopsim.learn.recipe import TrainingRecipe
from coopsim.learn.samples.sightings import Sightings
from coopsim.learn.tasks.identity_task import ContrastedNet, Crop, IdentityTask
from coopsim.types import Ints

CLIPS = SyntheticClips(agents=2, objects=6, frames=4)


@dataclass
class NumberConfig:
    dim: int = 4


class NumberEncoder(nn.Module):
    """Looks up a vector for a number."""

    def __init__(self) -> None:
        super().__init__()
        self.config, self.dim = NumberConfig(), 4
        self.table = nn.Embedding(100, 4)

    def forward(self, inputs: Tensor) -> Tensor:
        return nn.functional.normalize(self.table(inputs), dim=1)


class NumberTask(IdentityTask):
    """Sees of an object its number; of number 0 nothing."""

    def inputs(self, clip: Clip, seen: Sightings, rng: np.random.Generator, *, whole: bool) -> list[int | None]:
        return [each or None for each in seen.identity.tolist()]

    def joined(self, inputs: Sequence[Any]) -> Tensor:
        return torch.tensor(inputs, dtype=torch.int64)


class ConstantTeachers:
    """Have one vector for each class, and want crops."""

    dim = 3

    def vectors(self, label: Ints, boxes: Floats, crops: Sequence[Crop | None]) -> Mapping[str, tuple[Tensor, Tensor]]:
        assert len(crops) == len(label) == len(boxes)
        return {"text": (torch.arange(len(label)), torch.eye(3)[torch.from_numpy(boxes[:, 3] > 4.5).long()])}


def _task(teachers: ConstantTeachers | None = None, **samples: Any) -> NumberTask:
    torch.manual_seed(0)
    return NumberTask(TrainingRecipe("x", "point_identity", samples=samples), NumberEncoder(), teachers)


def test_a_batch_joins_clips_without_mixing_their_objects() -> None:
    task = _task(group=2)
    samples = [each for k in (0, 1) for each in task.cut(CLIPS.clip(k), np.random.default_rng(k))]
    assert len(samples) == 6
    batch = task.collate(samples)
    assert len(set(batch.identity.tolist())) == 10  # five of each clip: nothing is seen of number 0
    assert batch.inputs.tolist() == [each for sample in samples for each in sample.seen.identity.tolist()]
    first, second = batch.pairs.unbind(1)
    assert (batch.identity[first] == batch.identity[second]).all() and (first < second).all()
    across = batch.seen.agent[first] != batch.seen.agent[second]
    assert across.sum() >= 10 and (~across).sum() >= 10


def test_what_is_learned_is_seen_in_losses_and_looks() -> None:
    task = _task()
    held_out = [
        task.collate([each]) for k in (5, 6) for each in task.cut_held_out(CLIPS.clip(k), np.random.default_rng(k))
    ]
    batch = task.collate([each for k in range(3) for each in task.cut(CLIPS.clip(k), np.random.default_rng(k))])
    assert isinstance(task.net.encoder, NumberEncoder)
    with torch.no_grad():
        task.net.encoder.table.weight[:] = 1.0
    alike = {name: float(value.detach()) for name, value in task(batch).items()}
    assert alike["triplet"] == pytest.approx(0.3) and set(alike) == {"loss", "positive", "triplet"}
    assert task.evaluate(task.net, held_out) == {"AUC within": 0.5, "AUC across": 0.5}
    with torch.no_grad():
        task.net.encoder.table.weight.normal_()
    apart = {name: float(value.detach()) for name, value in task(batch).items()}
    assert apart["positive"] < alike["positive"]
    assert task.evaluate(task.net, held_out) == {"AUC within": 1.0, "AUC across": 1.0}


def test_teachers_add_their_part_through_a_layer_of_their_own() -> None:
    task = _task(ConstantTeachers())
    assert isinstance(task.net, ContrastedNet) and task.net.to_teachers is not None
    losses = task(task.collate(task.cut(CLIPS.clip(0), np.random.default_rng(0))))
    losses["text"].backward()
    assert set(losses) == {"loss", "positive", "triplet", "text"} and task.net.to_teachers.weight.grad is not None
    (stored,) = task.files(task.net, "x")
    assert stored.net is task.net.encoder and stored.metadata == {
        "kind": "point_identity",
        "config": {"dim": 4},
        "teachers": "CLIP",
    }


def test_nothing_seen_is_no_sample() -> None:
    task = _task(least_returns=1000)
    assert task.cut(CLIPS.clip(0), np.random.default_rng(0)) == []
    assert task.cut_held_out(CLIPS.clip(0), np.random.default_rng(0)) == []
    assert task.evaluate(task.net, []) == {}


def test_unknown_settings_are_refused() -> None:
    with pytest.raises(UnknownNameError, match="frame"):
        _task(frame=3)
