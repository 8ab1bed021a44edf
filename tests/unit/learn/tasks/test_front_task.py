"""The training of a second look: it alone changes, it is of vehicles alone, and it learns which end is the front."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

torch = pytest.importorskip("torch")
from moving_agents import clip_of_moving_agents  # noqa: E402
from tiny_networks import weights_folder  # noqa: E402

from coopsim.errors import InvalidValueError  # noqa: E402
from coopsim.learn.recipe import TrainingRecipe, find_recipe  # noqa: E402
from coopsim.learn.tasks.cooperative_task import CooperativeTask  # noqa: E402
from coopsim.learn.tasks.front_task import FoundVehicle, FrontTask  # noqa: E402
from coopsim.learn.weights import encoder_digest, load_cooperative, load_detector, save_weights  # noqa: E402

torch.set_num_threads(1)
CLIP = clip_of_moving_agents(2)
SAMPLES = {"crop_cells": None, "mirrored": 0.0, "dropout": 0.0, "thinned": 0.0, "merged": 0.0, "reach_m": 57.6}


@pytest.fixture(autouse=True)
def untrained_boxes_are_learned_from(monkeypatch: pytest.MonkeyPatch) -> None:
    """Take the tiny network's boxes, which lie on no vehicle, as if they did."""
    monkeypatch.setattr("coopsim.learn.losses.judge_losses._SAME_IOU", 0.0)
    for name in ("_LEAST_SCORE", "_SURE"):
        monkeypatch.setattr(f"coopsim.learn.tasks.front_task.{name}", 0.0)


def weights(name: str) -> str:
    return str(weights_folder() / f"{name}.safetensors")


def recipe(start: str | None = None, **changed: Any) -> TrainingRecipe:
    given = {"start": start or weights("pillars"), "detector": weights("pillars"), "samples": SAMPLES, **changed}
    return find_recipe("front").changed(**given)


def stored(task: FrontTask, folder: Path) -> str:
    """Return the path of the task's weights, in a file."""
    (file,) = task.files(task.net, "mine")
    save_weights(folder / "mine.safetensors", file.net, file.metadata)
    return str(folder / "mine.safetensors")


def take_steps(task: FrontTask, batch: FoundVehicle, steps: int = 60) -> list[float]:
    adam = torch.optim.AdamW([each for each in task.net.parameters() if each.requires_grad], lr=0.01)
    losses = []
    task.train()
    for _ in range(steps):
        loss = task(batch)["loss"]
        adam.zero_grad()
        loss.backward()
        adam.step()
        losses.append(float(loss.detach()))
    return losses


@pytest.mark.parametrize("name", ["pillars", "attfuse", "ff_tracking"])
def test_the_second_look_alone_is_learned_and_all_else_stays_to_the_bit(name: str, tmp_path: Path) -> None:
    task = FrontTask(recipe(weights(name)), 0)
    samples = task.cut(CLIP, np.random.default_rng(0))
    assert samples and {tuple(each.patches.shape) for each in samples} == {(72,)}
    shown = torch.rand(256, 72, generator=torch.Generator().manual_seed(0))
    first, last = shown[:, :8].sum(dim=1), shown[:, -8:].sum(dim=1)  # of two opposite places
    losses = take_steps(task, FoundVehicle(shown, (first > last).float()))
    assert losses[-1] < 0.5 * losses[0]
    path = stored(task, tmp_path)
    detector = load_detector(weights("pillars"))
    if name == "pillars":
        before, after = detector, load_detector(path)
        assert encoder_digest(after) == encoder_digest(before)  # fusions on the encoder still fit
    else:
        before, after = load_cooperative(weights(name), detector), load_cooperative(path, detector)
    assert after.config.head == "turned"
    added = {each for each in after.state_dict() if each not in before.state_dict()}
    assert added and all(each.startswith("head.judge.") for each in added)
    for key, value in before.state_dict().items():
        assert torch.equal(value, after.state_dict()[key]), key


def test_a_fusion_begins_with_its_detector_s_second_look(tmp_path: Path) -> None:
    task = FrontTask(recipe(), 0)
    take_steps(task, task.collate(task.cut(CLIP, np.random.default_rng(0))), 5)
    path = stored(task, tmp_path)
    fused = FrontTask(recipe(weights("attfuse"), detector=path), 1).net.head.judge
    for one, other in zip(fused.parameters(), load_detector(path).head.judge.parameters(), strict=True):
        assert torch.equal(one, other)


def test_validation_is_the_share_of_wrong_ways() -> None:
    task = FrontTask(recipe(), 0)
    batch = task.collate(task.cut_held_out(CLIP, np.random.default_rng(0)))
    with torch.no_grad():
        forward, _ = task.net.head.judge(batch.patches)
    right = FoundVehicle(batch.patches, (forward > 0).float())
    assert np.isnan(task.evaluate(task.net, [])["backwards"])
    assert task.evaluate(task.net, [right]) == {"backwards": 0.0}
    assert task.evaluate(task.net, [right, FoundVehicle(right.patches, 1 - right.ahead)]) == {"backwards": 0.5}


def test_what_has_no_second_look_to_train_is_refused() -> None:
    with pytest.raises(InvalidValueError, match="start must name the weights"):
        FrontTask(find_recipe("front").changed(start=None), 0)
    with pytest.raises(InvalidValueError, match="network must be left out"):
        FrontTask(recipe(network={"cell_m": 0.4}), 0)
    with pytest.raises(InvalidValueError, match="kind detector or cooperative, is 'queries'"):
        FrontTask(recipe(weights("cooptrack")), 0)


def test_a_fusion_takes_no_second_look_that_nobody_trains() -> None:
    untrained = recipe().changed(start=None, kind="cooperative", network={"fusion": "attfuse", "head": "turned"})
    with pytest.raises(InvalidValueError, match='network head must be "centre"'):
        CooperativeTask(untrained, 0)
