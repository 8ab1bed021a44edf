"""The training of a fusion that goes on from stored weights: the network is theirs, its head included."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

torch = pytest.importorskip("torch")
from tiny_networks import weights_folder  # noqa: E402

from coopsim.errors import InvalidValueError  # noqa: E402
from coopsim.learn.recipe import TrainingRecipe, find_recipe  # noqa: E402
from coopsim.learn.tasks.cooperative_task import CooperativeTask  # noqa: E402
from coopsim.learn.tasks.front_task import FrontTask  # noqa: E402
from coopsim.learn.weights import load_cooperative, save_weights  # noqa: E402

DETECTOR, FUSION = (str(weights_folder() / f"{name}.safetensors") for name in ("pillars", "attfuse"))


def recipe(start: str, **network: Any) -> TrainingRecipe:
    size = load_cooperative(FUSION).message_channels
    given = {"fusion": "attfuse", "message_channels": size, **network}
    return find_recipe("attfuse").changed(start=start, detector=DETECTOR, network=given, samples={})


def test_a_training_goes_on_with_the_head_of_its_start(tmp_path: Path) -> None:
    front = FrontTask(find_recipe("front").changed(start=FUSION, detector=DETECTOR, samples={}), 0)
    save_weights(tmp_path / "turned.safetensors", front.net, front.metadata)
    for start, head in ((FUSION, "centre"), (str(tmp_path / "turned.safetensors"), "turned")):
        task = CooperativeTask(recipe(start), 1)
        assert task.net.config.head == head
        known = load_cooperative(start).state_dict()
        assert all(torch.equal(value, known[name]) for name, value in task.net.state_dict().items())


def test_another_network_than_that_of_the_start_is_refused() -> None:
    with pytest.raises(InvalidValueError, match=r"network must be that of start, \{'fusion': 'attfuse'"):
        CooperativeTask(recipe(FUSION, fusion="fcooper"), 0)
    with pytest.raises(InvalidValueError, match="network must be that of start"):
        CooperativeTask(recipe(FUSION, message_channels=7), 0)
