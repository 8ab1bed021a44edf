"""Training of covariances: it learns which agent measures worse, and its result is a file of weights with a card."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from synthetic_recordings import BLURRED_M, write_recordings

from coopsim.errors import CoopsimError
from coopsim.learn.loop.train_loop import TrainingProgress
from coopsim.learn.recipe import TrainingRecipe
from coopsim.learn.train import make_task, train
from coopsim.learn.weights import load_covariance
from coopsim.nn.covariance.covariance_net import CovarianceNet


@pytest.fixture(scope="module")
def recipe(tmp_path_factory: pytest.TempPathFactory) -> TrainingRecipe:
    path = write_recordings(tmp_path_factory.mktemp("recordings"))
    return TrainingRecipe(
        "tiny",
        "covariance",
        steps=40,
        batch=2,
        block=2,
        lr=0.05,
        clip=1.0,
        average=0.5,
        precision="float32",
        validate_every=40,
        network={"codes": 4, "widths": [16]},
        world={"path": str(path), "held_out": ["0002"]},
    )


def test_it_learns_who_measures_worse(recipe: TrainingRecipe, tmp_path: Path) -> None:
    net = load_covariance(train(recipe, tmp_path))
    numbers = make_task(recipe, 0).source(0).clip(0).numbers  # type: ignore[union-attr]
    own = ~numbers[:, 8:13].any(axis=1)
    sigma_m = np.sqrt(net.variances(numbers)[:, :2])
    assert own.sum() == (~own).sum()
    sharp_m, blurred_m = np.median(sigma_m[own]), np.median(sigma_m[~own])
    assert sharp_m < 0.8 * blurred_m
    assert BLURRED_M / 3 < blurred_m < BLURRED_M * 3
    card = json.loads((tmp_path / "card.json").read_text())
    assert 0 < card["held_out"]["mahalanobis"] < 12  # too short a training to come near 7
    assert set(card["losses"]) == {"loss", "updated", "innovation"}


def test_an_interrupted_training_ends_in_the_same_bytes(recipe: TrainingRecipe, tmp_path: Path) -> None:
    short = replace(recipe, steps=4, validate_every=0)

    def interrupt(progress: TrainingProgress) -> None:
        if progress.step == 2:
            raise KeyboardInterrupt

    whole = train(short, tmp_path / "whole").read_bytes()
    with pytest.raises(KeyboardInterrupt):
        train(short, tmp_path / "parts", show=interrupt)
    assert train(short, tmp_path / "parts").read_bytes() == whole


@pytest.mark.parametrize(
    ("changes", "match"),
    [
        ({"samples": {"merged": 1.0}}, "samples must be empty with kind: covariance"),
        ({"world": {"rain_share": 1.0}}, "rain_share"),
        ({"network": {"fusion": "gsaf"}}, "fusion"),
        ({"start": "pillars"}, "must be weights of the kind 'covariance'"),
        ({"loss": {"heat": 1.0}}, "heat"),
    ],
)
def test_what_does_not_fit_is_refused(
    recipe: TrainingRecipe, tmp_path: Path, changes: dict[str, object], match: str
) -> None:
    with pytest.raises(CoopsimError, match=match):
        train(replace(recipe, **changes), tmp_path)  # type: ignore[arg-type]


def test_training_goes_on_from_other_weights(recipe: TrainingRecipe, tmp_path: Path) -> None:
    first = train(replace(recipe, steps=2, validate_every=0), tmp_path)
    task = make_task(replace(recipe, start=str(first), network={}), seed=5)
    numbers = np.ones((3, 19))
    assert isinstance(task.net, CovarianceNet)
    np.testing.assert_array_equal(task.net.variances(numbers), load_covariance(first).variances(numbers))
