"""Training of networks with cameras: it begins as a detector, learns, and refuses what does not fit together."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from pictured_clips import PicturedClips
from tiny_pictures import TINY_BOTH, TINY_PICTURES, tiny_points, tiny_view

from coopsim.errors import InvalidValueError
from coopsim.learn.losses.head_losses import label_loss
from coopsim.learn.recipe import TrainingRecipe
from coopsim.learn.tasks.pictures_task import PicturesTask
from coopsim.learn.train import make_task
from coopsim.learn.weights import (
    load_detector,
    load_pictures,
    load_points_and_pictures,
    make_network,
    save_weights,
)
from coopsim.nn.camera.picture_batch import collate_pictures

torch.set_num_threads(1)
KINDS = {"pictures": TINY_PICTURES, "points_and_pictures": TINY_BOTH}
SAMPLES: dict[str, Any] = {"reach_m": 19.2, "crop_cells": None, "thinned": 0.0, "merged": 0.0}
each_kind = pytest.mark.parametrize("kind", KINDS)


@pytest.fixture(scope="module")
def points(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tiny_points(tmp_path_factory.mktemp("points") / "points.safetensors")


def task_of(kind: str, points: Path, seed: int = 0, **options: Any) -> PicturesTask:
    given = {"detector": str(points), "network": KINDS[kind], "samples": SAMPLES} | options
    task = make_task(TrainingRecipe("tiny", kind, **given), seed)
    assert isinstance(task, PicturesTask)
    return task


def stored(task: PicturesTask, folder: Path) -> Path:
    (file,) = task.files(task.net, "tiny")
    path = folder / "tiny.safetensors"
    save_weights(path, file.net, file.metadata)
    return path


def batch_for(task: PicturesTask) -> Any:
    return task.collate(task.cut(PicturedClips(frames=1).clip(0), np.random.default_rng(0)))


def test_losses_of_pictures_are_means_over_the_groups_of_one_size(points: Path) -> None:
    task = task_of("pictures", points).eval()
    batch = batch_for(task)
    (seen,), (label,) = task.net.encoder.pictures.read(batch.pictures), batch.label
    assert task(batch)["label"].item() == pytest.approx(label_loss(seen.label, label).item())


@each_kind
def test_a_tiny_network_learns_a_sample_by_heart(kind: str, points: Path) -> None:
    task = task_of(kind, points).train()
    batch, seen = batch_for(task), list[dict[str, float]]()
    adam = torch.optim.AdamW((each for each in task.net.parameters() if each.requires_grad), 0.02)
    for _ in range(30):
        losses = task(batch)
        adam.zero_grad()
        losses["loss"].backward()
        adam.step()
        seen.append({name: value.item() for name, value in losses.items()})
    assert ("alike" in seen[0]) == (kind == "pictures")
    for name in ("loss", "depth"):
        assert seen[-1][name] < 0.7 * seen[0][name], name
    assert seen[-1]["heat"] < 0.9 * seen[0]["heat"]
    assert all(np.isfinite(list(each.values())).all() for each in seen)


@each_kind
def test_depths_and_classes_may_be_learned_first_alone(kind: str, points: Path) -> None:
    task = task_of(kind, points, depths_first=0.5).train()
    batch = batch_for(task)
    for progress, alone in ((0.0, True), (0.49, True), (0.5, False)):
        task.progress = progress
        losses = task(batch)
        assert (set(losses) == {"loss", "depth", "label"}) == alone
        assert ("heat" in losses) != alone
    task.progress = 0.0
    losses = task(batch)
    torch.testing.assert_close(losses["loss"], losses["depth"] + losses["label"])
    losses["loss"].backward()
    taught = {name.split(".")[1] for name, each in task.net.named_parameters() if each.grad is not None}
    assert taught <= {"pictures", "trust"}


@each_kind
def test_head_and_detector_are_never_changed(kind: str, points: Path) -> None:
    task, detector = task_of(kind, points).train(), load_detector(points)
    optimizer = torch.optim.SGD((each for each in task.net.parameters() if each.requires_grad), 0.01)
    for _ in range(2):
        task(batch_for(task))["loss"].backward()
        optimizer.step()
    for net in (task.net, task.detector):
        for name, value in detector.head.state_dict().items():
            assert torch.equal(net.head.state_dict()[name], value), name
    for name, value in detector.state_dict().items():
        assert torch.equal(task.detector.state_dict()[name], value), name


def test_networks_begin_as_the_detector(points: Path) -> None:
    detector = load_detector(points)
    pictures, both = (task_of(kind, points).net for kind in KINDS)
    for part in ("scales", "sides", "join"):
        for name, value in getattr(detector.encoder, part).state_dict().items():
            assert torch.equal(getattr(pictures.encoder, part).state_dict()[name], value)
    for name, value in detector.encoder.state_dict().items():
        assert torch.equal(both.encoder.points.state_dict()[name], value)


@each_kind
def test_first_weights_depend_on_the_seed(kind: str, points: Path) -> None:
    states = [task_of(kind, points, seed).net.state_dict() for seed in (0, 0, 1)]
    name = "encoder.pictures.net.hidden.0.weight"
    assert torch.equal(states[0][name], states[1][name]) and not torch.equal(states[0][name], states[2][name])


@each_kind
def test_held_out_samples_are_whole_and_what_is_found_is_in_their_grid(kind: str, points: Path) -> None:
    task = task_of(kind, points, samples=SAMPLES | {"crop_cells": 8}).eval()
    clip = PicturedClips(frames=1).clip(0)
    held_out = task.cut_held_out(clip, np.random.default_rng(0))
    assert [sample.view.grid.shape for sample in held_out] == [(16, 16)] * 2
    assert [sample.view.grid.shape for sample in task.cut(clip, np.random.default_rng(0))] == [(8, 8)] * 2
    (found,) = task.find(task.net, task.collate(held_out[:1]))
    assert found.grid.shape == (8, 8) and found.targets is not None
    middles = found.detections.boxes.center[:, :2]
    assert (middles > -5).all() and (middles < 44).all()


@pytest.mark.parametrize(
    ("kind", "load"), [("pictures", load_pictures), ("points_and_pictures", load_points_and_pictures)]
)
def test_weights_are_read_as_they_were_written(kind: str, load: Any, points: Path, tmp_path: Path) -> None:
    task = task_of(kind, points)
    path = stored(task, tmp_path)
    net = load(path, load_detector(points))
    assert net.config == task.net.config and not net.training
    for name, value in task.net.state_dict().items():
        assert torch.equal(net.state_dict()[name], value.half().to(value.dtype)), name
    assert load(path) is net
    with pytest.raises(InvalidValueError, match=r"trained on another encoder .* take that one, 'points'"):
        load(path, make_network("detector", asdict(load_detector(points).config), seed=9))
    other = load_points_and_pictures if kind == "pictures" else load_pictures
    with pytest.raises(InvalidValueError, match=rf"must be weights of the kind '\w+', is '{kind}'"):
        other(path)


@each_kind
def test_a_training_goes_on_from_weights_of_its_kind(kind: str, points: Path, tmp_path: Path) -> None:
    before = task_of(kind, points, seed=3)
    after = task_of(kind, points, start=str(stored(before, tmp_path)))
    for name, value in before.net.state_dict().items():
        assert torch.equal(after.net.state_dict()[name], value.half().to(value.dtype)), name


def test_both_begin_with_what_pictures_learnt(points: Path, tmp_path: Path) -> None:
    before = task_of("pictures", points, seed=3)
    after = task_of("points_and_pictures", points, start=str(stored(before, tmp_path)))
    for name, value in before.net.encoder.pictures.state_dict().items():
        assert torch.equal(after.net.encoder.pictures.state_dict()[name], value.half().to(value.dtype)), name


def test_a_start_of_another_network_is_refused(points: Path, tmp_path: Path) -> None:
    start = str(stored(task_of("pictures", points), tmp_path))
    wider = TINY_PICTURES | {"width": 5}
    with pytest.raises(InvalidValueError, match=r"network must be that of start, \{.*'width': 4"):
        task_of("pictures", points, start=start, network=wider)
    with pytest.raises(InvalidValueError, match=r"network.pictures must be that of start, \{.*'width': 4"):
        task_of("points_and_pictures", points, start=start, network={"pictures": wider})
    for kind in KINDS:
        with pytest.raises(InvalidValueError, match=f"must be weights of the kind '{kind}', is 'detector'"):
            task_of(kind, points, start=str(points))
    beside = tiny_points(tmp_path / "other.safetensors", seed=8)
    with pytest.raises(InvalidValueError, match="trained on another encoder"):
        task_of("pictures", beside, start=start)


def test_a_start_of_both_is_no_start_of_pictures(points: Path, tmp_path: Path) -> None:
    start = str(stored(task_of("points_and_pictures", points), tmp_path))
    with pytest.raises(InvalidValueError, match="must be weights of the kind 'pictures', is 'points_and_pictures'"):
        task_of("pictures", points, start=start)
    with pytest.raises(InvalidValueError, match=r"network must be that of start, .*'experts': 2"):
        task_of("points_and_pictures", points, start=start, network=TINY_BOTH | {"experts": 3})


@each_kind
@pytest.mark.parametrize(
    ("size", "match"),
    [
        ({"features": 16}, "the network must have the detector's features, 8, has 16"),
        ({"picture_features": 5}, "the network must have the detector's pillar_features, 6, has 7"),
        ({"cell_m": 1.2}, "the network must have the detector's cell_m, 2.4, has 1.2"),
    ],
)
def test_sizes_that_are_not_the_detectors_are_refused(
    kind: str, size: dict[str, Any], match: str, points: Path
) -> None:
    pictures = TINY_PICTURES | size
    with pytest.raises(InvalidValueError, match=match):
        task_of(kind, points, network=pictures if kind == "pictures" else {"pictures": pictures})


def test_detectors_of_two_sweeps_are_refused(tmp_path: Path) -> None:
    with pytest.raises(InvalidValueError, match="detector must look at one sweep"):
        task_of("pictures", tiny_points(tmp_path / "other.safetensors", sweeps=2))


def test_made_networks_are_ready_to_look() -> None:
    net = make_network("pictures", TINY_PICTURES, seed=1).eval()
    assert net.head.heat(net.encoder(collate_pictures([tiny_view()])))[1].shape == (1, 9, 8, 8)
