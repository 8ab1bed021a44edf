"""Training of instance queries: what is taught, that it learns, goes on after an interruption, and what is refused."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

torch = pytest.importorskip("torch")
from representatives import all_of  # noqa: E402
from synthetic_clips import SyntheticClips  # noqa: E402
from tiny_networks import weights_folder  # noqa: E402

from coopsim.errors import CoopsimError  # noqa: E402
from coopsim.learn.losses.instance_losses import (  # noqa: E402
    association_loss,
    focal_loss,
    instance_losses,
    labelled,
)
from coopsim.learn.recipe import TrainingRecipe  # noqa: E402
from coopsim.learn.samples.query_streams import TrueObjects  # noqa: E402
from coopsim.learn.tasks.query_task import (  # noqa: E402
    QueryEvaluation,
    QueryTask,
    taught_steps,
)
from coopsim.learn.train import train  # noqa: E402
from coopsim.learn.weights import encoder_digest, load_detector, load_queries  # noqa: E402
from coopsim.nn.queries.cooptrack_fusion import ComparedInstances  # noqa: E402
from coopsim.nn.queries.instances import Instances  # noqa: E402
from coopsim.nn.queries.query_net import QueryStep  # noqa: E402

torch.set_num_threads(1)
CLIPS = SyntheticClips(agents=3, objects=4, frames=4)


def recipe_of(fusion: str = "none", **changes: object) -> TrainingRecipe:
    given: dict[str, object] = {
        "kind": "queries", "steps": 4, "batch": 1, "block": 2, "passes": 2, "lr": 0.003, "average": 0.5,
        "precision": "float32", "detector": str(weights_folder() / "pillars.safetensors"),
        "network": {"fusion": fusion, "width": 16, "heads": 2, "layers": 1},
        "samples": {"reach_m": 38.4, "dropout": 0.0, "late": 0.0, "thinned": 0.0},
    }  # fmt: skip
    return TrainingRecipe("tiny", **(given | changes))  # type: ignore[arg-type]


def objects(places: list[list[float]], shown: list[bool] | None = None, label: int = 0) -> TrueObjects:
    count = len(places)
    box = torch.cat([torch.tensor(places), torch.tensor([0.8, 4.5, 1.9, 1.6, 0.0]).expand(count, 5)], dim=1)
    seen = torch.ones(count, dtype=torch.bool) if shown is None else torch.tensor(shown)
    return TrueObjects(box, torch.zeros(count, 2), torch.full((count,), label), seen)


def found(places: list[list[float]]) -> Instances:
    truth = objects(places)
    return Instances.seen(truth.box, torch.full((len(places),), 0.5), truth.label, 16, 4)


@pytest.mark.parametrize(("score", "precision"), [(0.3, 1 / 2), (np.nextafter(np.float32(0.3), np.float32(0)), 1.0)])
def test_instances_count_as_found_from_a_score_of_three_tenths(score: float, precision: float) -> None:
    look, known = QueryEvaluation(), found([[0.0, 0.0], [30.0, 0.0]])
    known = replace(known, score=torch.tensor([0.9, float(score)]))
    look.add(QueryStep(known, torch.zeros(2, 9), []), objects([[0.0, 0.0]]))
    assert look.values()["precision"] == precision and look.values()["recall"] == 1.0


def test_instances_are_of_the_nearest_object_of_their_kind() -> None:
    known, truth = found([[0.0, 0.0], [10.0, 0.0], [20.0, 0.0]]), objects([[10.5, 0.0], [0.2, 0.0], [26.0, 0.0]])
    assert labelled(known, truth).by_row(3).tolist() == [1, 0, -1]
    assert labelled(known, objects([[0.0, 0.0]], label=7)).by_row(3).tolist() == [-1, -1, -1]


def test_what_nobody_sees_teaches_nothing() -> None:
    known = found([[0.0, 0.0], [10.0, 0.0]])
    logits = torch.zeros(2, 9, requires_grad=True)
    truth = objects([[0.0, 0.0], [10.0, 0.0]], [True, False])
    losses = instance_losses(known, logits, truth, labelled(known, truth))
    assert float(losses["instance box"]) == pytest.approx(0.0, abs=1e-6)
    losses["instance class"].backward()
    assert logits.grad is not None and float(logits.grad[1].abs().sum()) == 0.0
    assert float(logits.grad[0, 0]) < 0 < float(logits.grad[0, 1])


def test_focal_loss_is_its_equation() -> None:
    logits, target = torch.tensor([0.3, -1.2]), torch.tensor([1.0, 0.0])
    p = torch.sigmoid(logits)
    expected = [-0.25 * (1 - p[0]) ** 2 * torch.log(p[0]), -0.75 * p[1] ** 2 * torch.log(1 - p[1])]
    assert torch.allclose(focal_loss(logits, target, 0.25, 2.0), torch.stack(expected))


def test_pairs_of_one_object_are_to_be_found() -> None:
    truth = objects([[0.0, 0.0], [5.0, 0.0]])
    own, others = found([[0.1, 0.0], [5.0, 0.0]]), found([[5.2, 0.0], [0.0, 0.0]])
    right = torch.tensor([[-4.0, 4.0], [4.0, -4.0]])
    labels = labelled(own, truth), labelled(others, truth)
    good, bad = (float(association_loss(ComparedInstances(own, others, each), *labels)) for each in (right, -right))
    assert good < 0.01 < 1.0 < bad


@pytest.mark.parametrize("fusion", all_of(["none", "cooptrack", "univ2x"], "cooptrack"))
def test_it_learns(fusion: str) -> None:
    task = QueryTask(recipe_of(fusion), 0)
    (sample,) = task.cut(CLIPS.clip(0), np.random.default_rng(0))
    assert sample.clip is task.cut(CLIPS.clip(0), np.random.default_rng(1))[0].clip  # seen once for all passes
    adam, losses = torch.optim.Adam(task.net.parameters(), 0.003), []
    for _ in range(8):
        parts = task([sample])
        losses.append(float(parts["loss"].detach()))
        adam.zero_grad()
        parts["loss"].backward()
        adam.step()
    assert losses[-1] < 0.9 * losses[0]
    assert ("association" in parts) == (fusion == "cooptrack")
    values = task.evaluate(task.net, [[sample]])
    assert 0 <= values["recall"] <= 1 and ("pairs recall" in values) == (fusion == "cooptrack")


def test_receivers_are_to_find_what_any_member_shows() -> None:
    clip, task = CLIPS.clip(0), QueryTask(recipe_of("cooptrack"), 0)
    hidden = clip.scenes[0].returns.copy()
    hidden[0, 1:], hidden[1, :] = 0, 0
    scenes = tuple(replace(scene, returns=hidden) for scene in clip.scenes)
    (sample,) = task.cut(replace(clip, key="hidden", scenes=scenes), np.random.default_rng(0))
    with torch.no_grad():
        for each in taught_steps(task.net, sample):
            assert each.truth.shown.tolist() == [True, False, True, True]
    alone = QueryTask(recipe_of("none"), 0)
    with torch.no_grad():
        shown = [each.truth.shown.tolist() for each in taught_steps(alone.net, sample)]
    assert shown[:3] == [[True, False, True, True], *[[False, False, True, True]] * 2]


def test_errors_of_poses_and_delays_move_what_is_heard() -> None:
    task = QueryTask(recipe_of("cooptrack", samples={"reach_m": 38.4, "dropout": 0.0, "late": 1.0, "noise_m": 2.0}), 0)
    (sample,) = task.cut(CLIPS.clip(0), np.random.default_rng(3))
    exact = replace(sample, error=np.zeros_like(sample.error))
    places = [each.receiver_SE3_sender(1, 0, 1, 1).translation for each in (sample, exact)]
    assert np.abs(places[0] - places[1]).max() > 0.1 and sample.late.max() > 0
    now, then = sample.clip.scenes[1].place_m[0], sample.clip.scenes[0].place_m[1]
    np.testing.assert_allclose(exact.receiver_SE3_sender(1, 0, 1, 0).translation, then - now, atol=1e-9)


@pytest.mark.heavy("two trainings")
def test_stage_two_begins_where_stage_one_ended(tmp_path: Path) -> None:
    before = encoder_digest(load_detector(recipe_of().detector))
    first = train(recipe_of(), tmp_path / "one", source=CLIPS, workers=0)
    assert encoder_digest(load_detector(recipe_of().detector)) == before  # frozen, statistics and all
    recipe = recipe_of("cooptrack", start=str(first))
    started, alone = QueryTask(recipe, 0).net, load_queries(first, load_detector(recipe.detector))
    for name, value in alone.agent.state_dict().items():
        assert torch.equal(started.agent.state_dict()[name], value), name
    whole = train(recipe, tmp_path / "two", source=CLIPS, workers=0)
    card = json.loads((tmp_path / "two" / "card.json").read_text())
    assert set(card["losses"]) == {"loss", "instance class", "instance box", "association"}
    assert load_queries(whole, load_detector(recipe.detector), "cooptrack").config.fusion == "cooptrack"
    with pytest.raises(CoopsimError, match="must be weights of the fusion 'univ2x', is 'cooptrack'"):
        load_queries(whole, load_detector(recipe.detector), "univ2x")


@pytest.mark.long  # two trainings, and the same goes for every kind; the others' tests show it
def test_it_goes_on_after_an_interruption(tmp_path: Path) -> None:
    recipe = recipe_of("cooptrack")
    whole = train(recipe, tmp_path / "whole", source=CLIPS, workers=0)

    def stop(progress: object) -> None:
        if progress.step == 3:  # type: ignore[attr-defined]
            raise InterruptedError

    with pytest.raises(InterruptedError):
        train(recipe, tmp_path / "parts", source=CLIPS, workers=0, show=stop)
    train(recipe, tmp_path / "parts", source=CLIPS, workers=0)
    assert whole.read_bytes() == (tmp_path / "parts" / whole.name).read_bytes()


@pytest.mark.parametrize(
    ("changes", "match"),
    [
        ({"network": {"fusion": "gsaf"}}, "unknown network fusion 'gsaf'"),
        ({"network": {"features": 9}}, "network features must be the detector's 8"),
        ({"samples": {"mrged": 1.0}}, "mrged"),
        ({"start": "pillars"}, "must be weights of the kind 'queries', is 'detector'"),
    ],
)
def test_what_does_not_fit_is_refused(changes: dict[str, object], match: str) -> None:
    with pytest.raises(CoopsimError, match=match):
        QueryTask(recipe_of(**changes), 0)  # type: ignore[arg-type]
