"""Losses of users: a recipe names their class and weight, and they teach maps of one agent and fused ones."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from synthetic_clips import SyntheticClips
from tiny_networks import TINY, weights_folder

from coopsim.errors import InvalidValueError, UnknownNameError
from coopsim.learn.losses.own_losses import own_losses
from coopsim.learn.recipe import TrainingRecipe, find_recipe
from coopsim.learn.train import make_task, train

torch.set_num_threads(1)
SMALL = {"reach_m": 19.2, "crop_cells": None}
CODE = """
from coopsim.learn.losses.own_losses import MapLoss

class Quiet(MapLoss):
    def __call__(self, head, features, targets):
        return head.heat(features)[1].sigmoid().mean()

class Whole(MapLoss):
    def __call__(self, head, features, targets):
        return features

class Needy(MapLoss):
    def __init__(self, size):
        pass

    def __call__(self, head, features, targets):
        return features.sum()

class Other:
    pass
"""


@pytest.fixture
def place(tmp_path: Path) -> str:
    (tmp_path / "own.py").write_text(CODE)
    return f"{tmp_path / 'own.py'}:Quiet"


def task_of(kind: str, loss: dict[str, float]) -> Any:
    network = TINY if kind == "detector" else {"message_channels": 3}
    detector = str(weights_folder() / "pillars.safetensors")
    return make_task(TrainingRecipe("own", kind, network=network, samples=SMALL, loss=loss, detector=detector), 0)


@pytest.mark.parametrize("kind", ["detector", "cooperative", "together"])
def test_it_is_a_part_of_the_loss_with_gradients(kind: str, place: str) -> None:
    task = task_of(kind, {place: 1.0}).train()
    batch = task.collate(task.cut(SyntheticClips().clip(0), np.random.default_rng(0))[:1])
    losses = task(batch)
    assert 0.0 < losses[place].item() < 1.0
    losses[place].backward()
    assert any(weight.grad is not None and weight.grad.any() for weight in task.net.parameters())
    assert place not in task_of(kind, {})(batch)


def test_a_training_weighs_it(place: str, tmp_path: Path) -> None:
    def heat(weight: float) -> tuple[float, float]:
        recipe = TrainingRecipe("own", steps=3, batch=1, network=TINY, samples=SMALL, loss={place: weight}, lr=0.01)
        steps: list[Any] = []
        train(recipe, tmp_path / str(weight), source=SyntheticClips(), show=steps.append, workers=0)
        return steps[0].losses[place], steps[-1].losses[place]

    (first, shown), (also_first, taught) = heat(0.0), heat(1000.0)
    assert first == also_first and taught < shown


def test_a_file_names_it_beside_itself_and_needs_trust(place: str, tmp_path: Path) -> None:
    path = tmp_path / "mine.yaml"
    path.write_text("kind: detector\nsteps: 5\nloss: {'own.py:Quiet': 0.5, heat: 2.0}\n")
    with pytest.raises(InvalidValueError, match=r"mine.yaml:3: a recipe's file names code to run, 'own.py:Quiet'"):
        find_recipe(path)
    assert find_recipe(path, trust=True).loss == {place: 0.5, "heat": 2.0}


def test_other_kinds_have_no_maps_to_teach() -> None:
    with pytest.raises(InvalidValueError, match=r"loss 'own.py:Quiet' must be left out with kind: covariance"):
        TrainingRecipe("x", "covariance", loss={"own.py:Quiet": 1.0})


@pytest.mark.parametrize(
    ("name", "problem"),
    [
        ("Quit", "Did you mean 'Quiet'"),
        ("Other", "must be a class derived from"),
        ("Needy", "cannot be made without arguments"),
    ],
)
def test_what_is_no_such_class_is_refused_before_the_first_step(place: str, name: str, problem: str) -> None:
    with pytest.raises((InvalidValueError, UnknownNameError), match=problem):
        own_losses([place.replace("Quiet", name)])


def test_a_loss_is_one_number(place: str) -> None:
    whole = place.replace("Quiet", "Whole")
    task = task_of("detector", {whole: 1.0})
    batch = task.collate(task.cut(SyntheticClips().clip(0), np.random.default_rng(0))[:1])
    with pytest.raises(InvalidValueError, match="must return a tensor of one number, got a tensor of shape"):
        task(batch)
