"""Training of integrated tracking: that it learns, goes on after an interruption, and what is refused."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

torch = pytest.importorskip("torch")
from synthetic_clips import SyntheticClips  # noqa: E402
from tiny_networks import weights_folder  # noqa: E402

from coopsim.errors import CoopsimError  # noqa: E402
from coopsim.learn.losses.instance_losses import frame_losses  # noqa: E402
from coopsim.learn.recipe import TrainingRecipe  # noqa: E402
from coopsim.learn.samples.query_streams import fused_view  # noqa: E402
from coopsim.learn.tasks.integrated_task import IntegratedTask, same_objects, taught_frames  # noqa: E402
from coopsim.learn.train import train  # noqa: E402
from coopsim.learn.weights import load_cooperative, load_detector, load_integrated  # noqa: E402

torch.set_num_threads(1)
CLIPS = SyntheticClips(agents=2, objects=4, frames=4)


def recipe_of(start: str | None = "ff_tracking", **changes: object) -> TrainingRecipe:
    given: dict[str, object] = {
        "kind": "integrated", "steps": 4, "batch": 1, "block": 2, "passes": 2, "lr": 0.003, "average": 0.5,
        "precision": "float32", "detector": str(weights_folder() / "pillars.safetensors"),
        "start": None if start is None else str(weights_folder() / f"{start}.safetensors"),
        "network": {"width": 16, "heads": 2, "points": 2, "decoder_layers": 1},
        "samples": {"reach_m": 38.4, "crop_cells": None, "dropout": 0.0, "late": 0.5, "thinned": 0.0, "receivers": 1},
    }  # fmt: skip
    return TrainingRecipe("tiny", **(given | changes))  # type: ignore[arg-type]


def test_it_learns_and_looks() -> None:
    task = IntegratedTask(recipe_of(), 0)
    (sample,) = task.cut(CLIPS.clip(0), np.random.default_rng(0))
    adam, losses = torch.optim.Adam([each for each in task.net.parameters() if each.requires_grad], 0.02), []
    for _ in range(7):
        parts = task([sample])
        losses.append(float(parts["loss"].detach()))
        adam.zero_grad()
        parts["loss"].backward()
        adam.step()
    assert losses[-1] < 0.85 * losses[0], losses
    assert set(parts) == {"loss", "detection class", "prediction class", "xiou", "giou", "speed", "turn"}
    values = task.evaluate(task.net, [[sample]])
    assert 0 < values["predicted XIOU"] <= 1 and 0 < values["recall"] <= 1


def test_tracks_are_told_which_objects_they_are_and_who_is_hidden() -> None:
    clip = CLIPS.clip(0)
    hidden = [scene.returns.copy() for scene in clip.scenes]
    hidden[2][0] = 0  # nobody sees the first object in the third scene
    scenes = tuple(replace(scene, returns=each) for scene, each in zip(clip.scenes, hidden, strict=True))
    task = IntegratedTask(recipe_of(samples={**recipe_of().samples, "late": 0.0}), 0)
    (sample,) = task.cut(replace(clip, key="hidden", scenes=scenes), np.random.default_rng(0))
    with torch.no_grad():
        frames = list(taught_frames(task.net, sample, None))
    assert len(frames[0].same.rows) == 0 and len(frames[1].same.rows) > 0
    for taught in frames[1:]:
        assert len(set(taught.same.objects.tolist())) == len(taught.same.objects)
        away = (taught.step.predicted.box[taught.same.rows] - taught.truth.box[taught.same.objects])[:, :2].norm(dim=1)
        assert float(away.max()) < 5.0
    assert not bool(frames[2].truth.shown[0]) and bool(frames[3].truth.shown[0])
    assert all(torch.isfinite(each) for each in frame_losses(frames[2]).values())


def test_boxes_are_to_be_turned_around_where_they_face_the_other_way() -> None:
    task = IntegratedTask(recipe_of(), 0)
    (sample,) = task.cut(CLIPS.clip(0), np.random.default_rng(0))
    with torch.no_grad():
        *_, taught = taught_frames(task.net, sample, None)
    around = replace(taught.truth, box=taught.truth.box + torch.pi * (torch.arange(7) == 6))
    losses = [float(frame_losses(replace(taught, truth=each))["turn"]) for each in (taught.truth, around)]
    seldom = torch.tensor(3.0)  # minus the logit of a fresh branch: what is right in one of both is wrong in the other
    each = float(torch.nn.functional.softplus(seldom) + torch.nn.functional.softplus(-seldom))
    assert sum(losses) == pytest.approx(2 * each, rel=1e-4)


def test_numbers_that_are_none_are_no_object() -> None:
    same = same_objects(torch.tensor([-1, 7, 3, 9]), torch.tensor([3, -1, 7]))
    assert same.rows.tolist() == [1, 2] and same.objects.tolist() == [2, 0]


def test_a_receiver_is_shown_the_middle_of_its_map_with_what_others_sent() -> None:
    task = IntegratedTask(recipe_of(), 0)
    (sample,) = task.cut(CLIPS.clip(0), np.random.default_rng(0))
    net = load_cooperative(recipe_of().start or "", load_detector(recipe_of().detector))
    (whole, _), (part, grid) = (fused_view(net, sample, 3, 0, cells) for cells in (None, 8))
    assert part.shape[1:] == grid.shape == (8, 8)
    assert torch.allclose(part, whole[:, 4:12, 4:12], atol=1e-4)
    alone, _ = fused_view(net, replace(sample, members=(0,)), 3, 0, None)
    assert torch.equal(alone, sample.clip.scenes[3].seen[0].features.float())
    assert not torch.allclose(alone, whole, atol=1e-3)


def test_it_goes_on_after_an_interruption_and_keeps_the_cooperative_network(tmp_path: Path) -> None:
    recipe = recipe_of()
    whole = train(recipe, tmp_path / "one", source=CLIPS, workers=0)

    def stop(progress: object) -> None:
        if progress.step == 3:  # type: ignore[attr-defined]
            raise InterruptedError

    with pytest.raises(InterruptedError):
        train(recipe, tmp_path / "two", source=CLIPS, workers=0, show=stop)
    train(recipe, tmp_path / "two", source=CLIPS, workers=0)
    assert whole.read_bytes() == (tmp_path / "two" / whole.name).read_bytes()
    detector = load_detector(recipe.detector)
    net, start = load_integrated(whole, detector), load_cooperative(recipe.start or "", detector)
    for name, value in start.state_dict().items():
        assert torch.equal(net.cooperative.state_dict()[name], value), name
    card = json.loads((tmp_path / "one" / "card.json").read_text())
    assert "xiou" in card["losses"]


def test_boxes_may_be_taught_by_giou(tmp_path: Path) -> None:
    given = recipe_of(steps=2)
    xiou = train(given, tmp_path / "xiou", source=CLIPS, workers=0)
    giou = train(given.changed(**{"loss.xiou": 0, "loss.giou": 2}), tmp_path / "giou", source=CLIPS, workers=0)
    assert xiou.read_bytes() != giou.read_bytes()


@pytest.mark.parametrize(
    ("changes", "match"),
    [
        ({"start": None}, "start must be weights of a cooperative network"),
        ({"start": "pillars"}, "must be weights of the kind 'cooperative', is 'detector'"),
        ({"network": {"cooperative": {}}}, "network must leave out cooperative"),
        ({"network": {"widht": 8}}, "widht"),
    ],
)
def test_what_does_not_fit_is_refused(changes: dict[str, object], match: str) -> None:
    with pytest.raises(CoopsimError, match=match):
        IntegratedTask(recipe_of(**changes), 0)  # type: ignore[arg-type]
