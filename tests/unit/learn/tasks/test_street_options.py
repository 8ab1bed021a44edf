"""Options of networks for streets: with each, a step of a training reaches every weight."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import torch
from synthetic_clips import SyntheticClips

from coopsim.errors import InvalidValueError
from coopsim.learn.recipe import TrainingRecipe, find_recipe
from coopsim.learn.tasks.cooperative_task import CooperativeTask
from coopsim.learn.tasks.detector_task import DetectorTask
from coopsim.learn.tasks.front_task import FrontTask
from coopsim.learn.train import make_task
from coopsim.learn.weights import encoder_digest, load_detector, read_texts, save_weights
from coopsim.nn.detector.detector_net import RARE, DetectorNet
from coopsim.nn.detector.encoder import EncoderConfig

torch.set_num_threads(1)
TINY: dict[str, Any] = {"pillar_features": 8, "channels": [8, 8, 8], "layers": [1, 1, 0], "features": 8}
SMALL = {"reach_m": 19.2, "crop_cells": None, "merged": 0.0, "thinned": 0.0, "single": 0.0, "dropout": 0.0}
WORLD = {"sweep_s": [0.1]}
OPTIONS: dict[str, dict[str, Any]] = {
    "bands": {"bands_m": [0.5, 1.2]},
    "local ground": {"ground": "local"},
    "sweeps apart": {"sweeps": 2, "apart": True},
    "street head": {"head": "street"},
    "all, dense": {"bands_m": [0.5, 1.2], "ground": "local", "sweeps": 2, "apart": True, "head": "street"},
    "all, sparse": {"bands_m": [0.5], "ground": "local", "sweeps": 2, "apart": True, "head": "street",
                    "layout": "sparse"},
}  # fmt: skip


def task_of(network: dict[str, Any], **more: Any) -> Any:
    return make_task(TrainingRecipe("tiny", network={**TINY, **network}, samples=SMALL, world=WORLD, **more), 0)


@pytest.mark.parametrize("name", OPTIONS)
def test_a_step_reaches_all_weights(name: str) -> None:
    task = task_of(OPTIONS[name]).train()
    rng = np.random.default_rng(0)
    batch = task.collate(task.cut(SyntheticClips().clip(0), rng)[1:3])  # of one sweep and of two
    with torch.no_grad():  # boxes must be found, for the second look to have any
        task.net.head.heat_of.bias += 3 - RARE / 2
    losses = task(batch)
    losses["loss"].backward()
    assert all(torch.isfinite(each) for each in losses.values())
    still = [key for key, weight in task.net.named_parameters() if weight.grad is None or not weight.grad.any()]
    assert not still


def test_encoders_without_these_options_are_the_same_as_before() -> None:
    config = EncoderConfig(features=8)
    with torch.random.fork_rng():
        torch.manual_seed(0)
        plain = DetectorNet(config)
    assert not any("mix" in name for name in plain.state_dict())
    assert encoder_digest(load_detector("pillars")) == read_texts("gsaf")["encoder_digest"]
    other = DetectorNet(EncoderConfig(features=8, ground="local"))
    other.load_state_dict(plain.state_dict())
    assert encoder_digest(other) != encoder_digest(plain)


def test_a_fusion_stands_on_such_an_encoder(tmp_path: Any) -> None:
    detector = task_of(OPTIONS["all, sparse"])
    path = tmp_path / "street.safetensors"
    save_weights(path, detector.net, detector.metadata)
    fusion = CooperativeTask(
        TrainingRecipe(
            "fused",
            "cooperative",
            batch=1,
            detector=str(path),
            samples=SMALL,
            network={"fusion": "attfuse", "message_channels": 4},
        ),
        0,
    )
    samples = fusion.cut(SyntheticClips().clip(0), np.random.default_rng(0))
    losses = fusion.train()(samples[:1])
    assert torch.isfinite(losses["loss"]) and "front" in losses
    with pytest.raises(InvalidValueError, match="second look that is trained with"):
        FrontTask(find_recipe("front").changed(start=str(path)), 0)


def test_the_shipped_recipe_has_all_options() -> None:
    task = make_task(find_recipe("pillars2"), 0)
    assert isinstance(task, DetectorTask)
    config = task.net.config
    assert (config.head, config.ground, config.sweeps, config.apart) == ("street", "local", 2, True)
    assert config.pillars.parts == 2 * (len(config.bands_m) + 1) > 2
