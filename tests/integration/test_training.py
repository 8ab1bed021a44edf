"""Trainings from the recipe to the files: they learn, repeat, go on after an interruption, and refuse what is wrong."""

from __future__ import annotations

import json
import os
import signal
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pictured_clips import PicturedClips
from synthetic_clips import SyntheticClips
from tiny_pictures import TINY_BOTH, TINY_PICTURES, tiny_points

from coopsim.errors import InvalidValueError, TrainingError, UnknownNameError
from coopsim.learn.clips.clip import Clip, ClipSource
from coopsim.learn.loop import train_loop
from coopsim.learn.loop.train_loop import TrainingProgress
from coopsim.learn.recipe import TrainingRecipe, find_recipe
from coopsim.learn.tasks import cooperative_task, detector_task
from coopsim.learn.train import train
from coopsim.learn.weights import digest, load_cooperative, load_detector, read_texts
from coopsim.support.files import locked

SMALL: dict[str, Any] = {
    "batch": 4,
    "block": 1,
    "average": 0.9,
    "lr": 0.01,
    "samples": {"reach_m": 19.2, "crop_cells": None, "merged": 0.0, "thinned": 0.0, "dropout": 0.0, "late": 0.0},
    "network": {"pillar_features": 16, "channels": [16, 16, 16], "layers": [1, 1, 0], "features": 16},
}
TINY = TrainingRecipe(
    "tiny",
    steps=10,
    **{**SMALL, "block": 2, "passes": 2, "network": {"channels": [8, 8, 8], "layers": [0, 0, 0], "features": 8}},
)
FILES = ("tiny.safetensors", "checkpoint.safetensors", "log.jsonl", "card.json", "curves.svg")


class FourFrames:
    """The same four frames of two agents, over and over."""

    def clip(self, index: int) -> Clip:
        return SyntheticClips(frames=4).clip(0)


def losses(folder: Path) -> list[dict[str, float]]:
    lines = [json.loads(line) for line in (folder / "log.jsonl").read_text().splitlines()]
    return [line for line in lines if line["kind"] == "losses"]


@pytest.fixture(scope="module")
def fixed_samples() -> Iterator[None]:
    """Samples of a clip are always the same: a network cannot learn by heart what is turned anew each time."""
    with pytest.MonkeyPatch.context() as patch:
        for module, name in ((detector_task, "detector_samples"), (cooperative_task, "scene_samples")):
            draw = getattr(module, name)
            patch.setattr(
                module,
                name,
                lambda clip, rng, *rest, draw=draw, **more: draw(clip, np.random.default_rng(0), *rest, **more),
            )
        yield


@pytest.fixture(scope="module")
def encoder(tmp_path_factory: pytest.TempPathFactory, fixed_samples: None) -> Path:
    return train(TrainingRecipe("tiny", steps=60, **SMALL), tmp_path_factory.mktemp("encoder"), source=FourFrames())


def test_a_tiny_encoder_learns_four_frames(encoder: Path) -> None:
    seen = [each["loss"] for each in losses(encoder.parent)]
    assert len(seen) == 60
    assert np.mean(seen[-5:]) < 0.1 * seen[0]


@pytest.mark.heavy("a network learns until it knows what it was shown")
@pytest.mark.usefixtures("fixed_samples")
def test_a_fusion_learns_four_frames(encoder: Path, tmp_path: Path) -> None:
    recipe = TrainingRecipe(
        "tiny_fusion",
        steps=100,
        detector=str(encoder),
        **{
            **SMALL, "kind": "cooperative", "batch": 1, "lr": 0.04,
            "network": {"fusion": "attfuse", "message_channels": 16},
        },
    )  # fmt: skip
    weights = train(recipe, tmp_path, source=FourFrames())
    # How sure a sender is comes from a single layer on the frozen features, which cannot learn by heart.
    seen = [each["loss"] - each["sure"] for each in losses(tmp_path)]
    assert np.mean(seen[-5:]) < 0.1 * seen[0]
    detector = load_detector(encoder)
    assert load_cooperative(weights, detector) is load_cooperative(weights)


def test_a_teacher_is_followed_and_not_trained(encoder: Path, tmp_path: Path) -> None:
    network = {"fusion": "disconet", "message_channels": 4}
    recipe = TrainingRecipe(
        "taught", "cooperative", 6, 1, lr=0.02, detector=str(encoder), teacher=str(encoder), network=network,
        samples=SMALL["samples"],
    )  # fmt: skip
    before = digest(encoder)
    train(recipe, tmp_path, source=SyntheticClips())
    seen = [each["teacher"] for each in losses(tmp_path)]
    assert len(seen) == 6 and all(each > 0 for each in seen)
    assert digest(encoder) == before
    said = json.loads((tmp_path / "card.json").read_text())
    assert said["recipe"]["teacher"] == encoder.stem
    texts = read_texts(tmp_path / "taught.safetensors")
    assert "teacher" not in texts  # a policy needs none


def test_a_teacher_of_another_kind_is_refused(encoder: Path, tmp_path: Path) -> None:
    other = train(replace(TINY, steps=1), tmp_path / "other", source=SyntheticClips())
    recipe = TrainingRecipe("taught", "cooperative", detector=str(encoder), teacher=str(other))
    with pytest.raises(InvalidValueError, match="teacher must have the detector's features, 16, has 8"):
        train(recipe, tmp_path / "taught", source=SyntheticClips())
    with pytest.raises(InvalidValueError, match="teacher must be none with kind: detector"):
        replace(TINY, teacher="early")


def test_same_seed_gives_same_bytes_and_another_gives_others(tmp_path: Path) -> None:
    first, second, third = (
        train(TINY, tmp_path / name, seed, source=SyntheticClips()) for name, seed in (("a", 0), ("b", 0), ("c", 1))
    )
    assert all((tmp_path / "a" / name).read_bytes() == (tmp_path / "b" / name).read_bytes() for name in FILES)
    assert digest(first) == digest(second) != digest(third)


def recipe_of(kind: str, folder: Path) -> tuple[TrainingRecipe, ClipSource]:
    """Return the tiny training of a kind of stage A, and clips for it."""
    if kind == "detector":
        return TINY, SyntheticClips()
    network = TINY_PICTURES if kind == "pictures" else TINY_BOTH
    detector = tiny_points(folder / "points.safetensors")
    return replace(TINY, kind=kind, network=network, detector=str(detector)), PicturedClips()


@pytest.mark.parametrize(
    ("kind", "end"),
    [
        ("detector", signal.SIGINT),
        ("detector", signal.SIGTERM),
        ("detector", None),
        ("pictures", signal.SIGINT),
        ("points_and_pictures", None),
    ],
)
def test_an_interrupted_training_ends_in_the_same_bytes(
    kind: str, end: signal.Signals | None, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    recipe, clips = recipe_of(kind, tmp_path)
    train(recipe, tmp_path / "whole", source=clips)

    def interrupt(progress: TrainingProgress) -> None:
        if progress.step == 5 and end is not None:
            os.kill(os.getpid(), end)
        elif progress.step == 3:
            monkeypatch.setattr(train_loop, "SAVE_EVERY_S", 1e9)
        elif progress.step == 7:
            raise MemoryError  # two steps after the last checkpoint, as a kill would come

    monkeypatch.setattr(train_loop, "SAVE_EVERY_S", -1.0)
    with pytest.raises(MemoryError if end is None else KeyboardInterrupt):
        train(recipe, tmp_path / "cut", source=clips, show=interrupt)
    steps = list[int]()
    train(recipe, tmp_path / "cut", source=clips, show=lambda progress: steps.append(progress.step))
    assert steps[0] == (3 if end is None else 6)
    assert all((tmp_path / "whole" / name).read_bytes() == (tmp_path / "cut" / name).read_bytes() for name in FILES)
    assert signal.getsignal(signal.SIGTERM) is signal.SIG_DFL


def test_parts_of_the_loss_weigh_what_the_recipe_says(tmp_path: Path) -> None:
    recipe = replace(TINY, steps=1)
    train(recipe, tmp_path / "usual", source=FourFrames())
    train(replace(recipe, loss={"size": 0.0, "heat": 2.0}), tmp_path / "other", source=FourFrames())
    (usual,), (other,) = losses(tmp_path / "usual"), losses(tmp_path / "other")
    assert other["loss"] == pytest.approx(usual["loss"] - usual["size"] + usual["heat"], abs=1e-4)
    with pytest.raises(UnknownNameError, match=r"unknown part of the loss 'sise'.*'size'"):
        train(replace(recipe, loss={"sise": 0.0}), tmp_path / "typo", source=FourFrames())
    with pytest.raises(InvalidValueError, match="loss size must be a finite number >= 0"):
        replace(recipe, loss={"size": -1.0})


def test_a_folder_of_another_training_is_refused(tmp_path: Path) -> None:
    train(replace(TINY, steps=1), tmp_path, source=SyntheticClips())
    with pytest.raises(InvalidValueError, match=r"another training \(recipe.lr: 0.01 there, 0.02 here\)"):
        train(replace(TINY, steps=1, lr=0.02), tmp_path, source=SyntheticClips())


def test_a_second_training_in_the_folder_waits_for_the_first(tmp_path: Path) -> None:
    """They would overwrite each other's checkpoint and log in turns."""
    with locked(tmp_path), pytest.raises(InvalidValueError, match=f"in use by process {os.getpid()}"):
        train(TINY, tmp_path, source=SyntheticClips())
    assert not list(tmp_path.iterdir())


def test_a_loss_that_is_no_number_stops_and_keeps_the_last_weights(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    loss, calls = detector_task.head_loss, list[int]()

    def broken(*arguments: Any) -> dict[str, Any]:
        calls.append(1)
        values = loss(*arguments)
        return values if len(calls) < 4 else {**values, "heat": values["heat"] * np.nan}

    monkeypatch.setattr(train_loop, "SAVE_EVERY_S", -1.0)
    monkeypatch.setattr(detector_task, "head_loss", broken)
    with pytest.raises(TrainingError, match=r"step 4: loss is nan, heat is nan.*weights of step 3 are kept in"):
        train(TINY, tmp_path, source=SyntheticClips())
    monkeypatch.setattr(detector_task, "head_loss", loss)
    steps = list[int]()
    train(TINY, tmp_path, source=SyntheticClips(), show=lambda progress: steps.append(progress.step))
    assert steps == [4, 5, 6, 7, 8, 9, 10]


def test_scenes_without_objects_are_trained_on(tmp_path: Path) -> None:
    weights = train(replace(TINY, steps=2), tmp_path, source=SyntheticClips(objects=0))
    assert all(np.isfinite(value) for each in losses(tmp_path) for value in (each["loss"], each["place"]))
    load_detector(weights)


def test_a_world_in_which_nobody_sees_anything_is_an_error(tmp_path: Path) -> None:
    with pytest.raises(TrainingError, match="have no sample"):
        train(TINY, tmp_path, source=SyntheticClips(agents=0))


def test_pictures_need_a_world_with_cameras(tmp_path: Path) -> None:
    with pytest.raises(InvalidValueError, match=r"world\.cameras must name rigs with kind: pictures"):
        train(find_recipe("lift_splat").changed(world={}), tmp_path / "none")


def test_clips_without_pictures_are_no_clips_for_pictures(tmp_path: Path) -> None:
    recipe, _ = recipe_of("pictures", tmp_path)
    with pytest.raises(TrainingError, match="have no sample"):
        train(recipe, tmp_path / "out", source=SyntheticClips())


@pytest.mark.parametrize("kind", ["detector", "pictures", "points_and_pictures"])
def test_held_out_places_are_looked_at(kind: str, tmp_path: Path) -> None:
    recipe, clips = recipe_of(kind, tmp_path)
    train(replace(recipe, steps=4, validate_every=2, held_out=1), tmp_path, source=clips)
    lines = [json.loads(line) for line in (tmp_path / "log.jsonl").read_text().splitlines()]
    looks = [line for line in lines if line["kind"] == "validation"]
    assert [look["step"] for look in looks] == [2, 4]
    assert all(0 <= look["AP@0.5"] <= 1 for look in looks)
    assert "held-out places" in (tmp_path / "curves.svg").read_text()


def test_encoder_and_fusion_are_trained_together(encoder: Path, tmp_path: Path) -> None:
    network = {"fusion": "fcooper", "message_channels": 4}
    recipe = TrainingRecipe(
        "both", "together", 2, 1, validate_every=2, held_out=1, detector=str(encoder), network=network,
        slower={"detector": 0.1}, samples=SMALL["samples"],
    )  # fmt: skip
    weights = train(recipe, tmp_path, source=SyntheticClips())
    with pytest.raises(InvalidValueError, match=r"on another encoder .* take that one, 'both_detector'"):
        load_cooperative(weights, load_detector(encoder))
    load_cooperative(weights, load_detector(tmp_path / "both_detector.safetensors"))
    card = json.loads((tmp_path / "card.json").read_text())
    assert {name: each["digest"] for name, each in card["weights"].items()} == {
        name: digest(tmp_path / f"{name}.safetensors") for name in ("both", "both_detector")
    }
    assert str(tmp_path) not in json.dumps(card) and str(encoder.parent) not in json.dumps(card)
