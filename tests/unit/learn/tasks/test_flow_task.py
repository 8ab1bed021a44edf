"""The training of feature flow: what teaches what, and that it learns."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

torch = pytest.importorskip("torch")
from moving_agents import clip_of_moving_agents  # noqa: E402
from tiny_networks import weights_folder  # noqa: E402

from coopsim.errors import InvalidValueError  # noqa: E402
from coopsim.learn.losses.fused_losses import flow_losses, late_changes  # noqa: E402
from coopsim.learn.recipe import TrainingRecipe  # noqa: E402
from coopsim.learn.samples.flow_samples import FlowSample, LateMaps  # noqa: E402
from coopsim.learn.tasks.cooperative_task import CooperativeTask, FlowTask  # noqa: E402
from coopsim.learn.weights import load_cooperative, load_detector, save_weights  # noqa: E402
from coopsim.nn.cooperative.cooperative_net import FeatureFlow  # noqa: E402
from coopsim.types import BevGrid  # noqa: E402

torch.set_num_threads(1)
NETWORK = {"fusion": "ff_tracking", "message_channels": 4, "flow": 8}
SAMPLES = {"dropout": 0.0, "late": 1.0, "thinned": 0.0, "reach_m": 57.6}
PILLARS = str(weights_folder() / "pillars.safetensors")
CLIP = clip_of_moving_agents(4, step_m=3.0)


def recipe(**changed: Any) -> TrainingRecipe:
    given = {"kind": "flow", "detector": PILLARS, "network": NETWORK, "samples": SAMPLES, "batch": 1, **changed}
    return TrainingRecipe("mine", **given)


def late_sample(task: FlowTask) -> Any:
    """Return the sample of the clip's last scene, with late messages of both agents."""
    return task.cut(CLIP, np.random.default_rng(0))[-1]


class Shown(torch.nn.Module):
    """Shows what was sent."""

    def forward(self, received: Any, delay_s: Any) -> Any:
        return received


def driving_blobs(seed: int, count: int = 12) -> tuple[Any, FlowSample]:
    """Return maps of blobs before, late and now, (3 L, 1, 16, 16), each blob on its own way, and what is late."""
    rng = np.random.default_rng(seed)
    start, turn = rng.uniform(4, 12, (count, 2)), rng.uniform(0, 2 * np.pi, count)
    way = 1.5 * np.column_stack([np.cos(turn), np.sin(turn)])
    cells = np.stack(np.meshgrid(np.arange(16), np.arange(16)), axis=-1)
    maps = [np.exp(-0.5 * ((cells - (start + k * way)[:, None, None]) ** 2).sum(-1) / 1.5**2) for k in (-1.0, 0.0, 1.5)]
    before, late, later = (list(range(first, first + count)) for first in (0, count, 2 * count))
    still = np.zeros((count, 3))
    known = LateMaps(late, before, later, still, still, [0.1] * count, [0.15] * count)
    scene = SimpleNamespace(grid=BevGrid((0.0, 16.0), (0.0, 16.0), 1.0))
    return torch.tensor(np.concatenate(maps)[:, None], dtype=torch.float32), FlowSample(scene, known)  # type: ignore[arg-type]


def test_flow_learns_without_labels_where_blobs_drive() -> None:
    torch.manual_seed(0)
    flow, net = FeatureFlow(1, 8), SimpleNamespace(expand=Shown())
    adam = torch.optim.Adam(flow.parameters(), 0.005)

    def losses(seed: int) -> dict[str, Any]:
        maps, sample = driving_blobs(seed)
        return flow_losses(net, maps, maps, late_changes(flow, maps, sample), sample)  # type: ignore[arg-type]

    first = losses(1000)
    torch.testing.assert_close(first["flow"].detach(), first["unmoved"])  # at first nothing moves
    for seed in range(80):
        adam.zero_grad()
        losses(seed)["flow"].backward()
        adam.step()
    last = losses(1000)  # blobs that it was not trained on
    assert torch.equal(last["unmoved"], first["unmoved"])
    assert last["flow"] < 0.6 * last["unmoved"]


def test_labels_do_not_teach_flow_and_flow_teaches_nothing_else() -> None:
    task = FlowTask(recipe(), 0)
    task.train()
    torch.nn.init.normal_(task.net.flow.last.weight)  # type: ignore[union-attr]
    parts = task([late_sample(task)])
    assert set(parts) >= {"loss", "copy", "flow", "unmoved", "heat"} and "sure" not in parts
    of_flow = {f"flow.{name}" for name, _ in task.net.flow.named_parameters()}  # type: ignore[union-attr]
    for name, taught in (("flow", of_flow), ("heat", None), ("copy", None)):
        task.zero_grad()
        parts[name].backward(retain_graph=True)
        reached = {key for key, each in task.net.named_parameters() if each.grad is not None and each.grad.any()}
        assert reached and (reached == taught if taught else not reached & of_flow)
        assert not any(key.startswith(("head", "compress", "sure")) for key in reached)
    assert not parts["unmoved"].requires_grad
    assert all(each.grad is None for each in task.detector.parameters())


def test_messages_are_learned_before_the_flow_that_changes_them() -> None:
    task = FlowTask(recipe(), 0)
    task.train()
    task.progress = 0.49
    parts = task([late_sample(task)])
    assert set(parts) >= {"loss", "copy", "sure", "heat"} and "flow" not in parts
    parts["loss"].backward()
    reached = {key for key, each in task.net.named_parameters() if each.grad is not None and each.grad.any()}
    assert any(key.startswith("compress") for key in reached)
    assert not any(key.startswith(("head", "flow")) for key in reached)


def test_a_few_steps_lower_the_loss_and_leave_the_head_as_it_was() -> None:
    task = FlowTask(recipe(), 0)
    task.train()
    sample, head = late_sample(task), {name: each.clone() for name, each in task.net.head.state_dict().items()}
    adam = torch.optim.AdamW([each for each in task.net.parameters() if each.requires_grad], 0.003)
    losses = []
    for _ in range(25):
        losses.append(task([sample])["loss"])
        adam.zero_grad()
        losses[-1].backward()
        adam.step()
    assert losses[-1] < 0.9 * losses[0]
    assert all(torch.equal(each, head[name]) for name, each in task.net.head.state_dict().items())
    found = task.find(task.net, [sample])
    assert len(found) == 2 and all(each.targets.objects for each in found)


def test_scenes_without_late_messages_are_trained_on_too() -> None:
    task = FlowTask(recipe(samples={**SAMPLES, "late": 0.0}), 0)
    sample = late_sample(task)
    parts = task([sample])
    assert parts["loss"].isfinite() and "flow" not in parts
    assert len(task.find(task.net, [sample])) == 2


def test_weights_are_stored_with_their_flow(tmp_path: Path) -> None:
    task = FlowTask(recipe(), 0)
    torch.nn.init.normal_(task.net.flow.last.weight)  # type: ignore[union-attr]
    (file,) = task.files(task.net, "mine")
    save_weights(tmp_path / "mine.safetensors", file.net, file.metadata)
    loaded = load_cooperative(tmp_path / "mine.safetensors", load_detector(PILLARS))
    assert loaded.flow is not None
    torch.testing.assert_close(
        loaded.flow.last.weight,
        task.net.flow.last.weight.detach(),
        atol=1e-3,
        rtol=1e-3,  # type: ignore[union-attr]
    )
    begun = FlowTask(recipe(start=str(tmp_path / "mine.safetensors")), 1)
    torch.testing.assert_close(begun.net.flow.last.weight.detach(), loaded.flow.last.weight)  # type: ignore[union-attr]


def test_what_is_wrong_is_refused() -> None:
    with pytest.raises(InvalidValueError, match=r"network flow must be its width, as \{flow: 24\}"):
        FlowTask(recipe(network={**NETWORK, "flow": 0}), 0)
    with pytest.raises(InvalidValueError, match="network flow must be 0 with kind: cooperative, got 8"):
        CooperativeTask(recipe(kind="cooperative"), 0)
    with pytest.raises(InvalidValueError, match=r"loss must leave out \['flow'\]"):
        FlowTask(recipe(loss={"flow": 2.0}), 0)
    with pytest.raises(InvalidValueError, match="flow must be an integer"):
        FlowTask(recipe(network={**NETWORK, "flow": -1}), 0)
