"""Trainings on another device: everything is there, and the weights are those that the processor trains."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

torch = pytest.importorskip("torch")

from fake_gpu import FakeGpu  # noqa: E402
from pictured_clips import PicturedClips  # noqa: E402
from representatives import all_of  # noqa: E402
from safetensors.torch import load_file  # noqa: E402
from synthetic_clips import SyntheticClips  # noqa: E402

from coopsim.learn.recipe import RECIPES, find_recipe  # noqa: E402
from coopsim.learn.train import train  # noqa: E402

OF_EACH_KIND = ("cooptrack", "disconet", "lift_splat")
"""Recipes on queries, with a detector and a teacher, and on pictures."""


def recipes() -> Iterator[str]:
    """Yield the first shipped recipe of each kind that trains on drawn clips and detects on the training's device.

    That of queries is `cooptrack`, whose agents exchange them.
    """
    met = {"covariance", "seen_covariance"}
    for name in RECIPES:
        kind = find_recipe(name).kind
        if kind not in met:
            met.add(kind)
            yield name
    yield "disconet"  # has a teacher


def trained(name: str, folder: Path, device: str) -> dict[str, Any]:
    """Return the weights after two steps."""
    recipe = find_recipe(name)
    size = {"reach_m": 38.4} | ({"crop_cells": 64} if "crop_cells" in recipe.samples else {})
    small = recipe.changed(
        steps=2,
        batch=min(recipe.batch, 2),
        block=1,
        passes=1,
        validate_every=2,
        held_out=1,
        samples={**recipe.samples, **(size if "identity" not in recipe.kind else {})},
    )
    source = PicturedClips(frames=2) if "picture" in recipe.kind else SyntheticClips(frames=2)
    return load_file(train(small, folder, 1, source=source, device=device, workers=0))


@pytest.mark.heavy("two trainings")
@pytest.mark.usefixtures("without_curves")
@pytest.mark.parametrize("name", all_of(sorted(recipes()), *OF_EACH_KIND))
def test_a_training_on_a_gpu_has_everything_there_and_ends_the_same(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("COOPSIM_PRECISION", "float32")
    here = trained(name, tmp_path / "here", "cpu")
    with FakeGpu(monkeypatch) as gpu:
        there = trained(name, tmp_path / "there", "cuda")
    assert gpu.layers and not gpu.elsewhere
    assert here.keys() == there.keys()
    for each, weight in here.items():
        torch.testing.assert_close(there[each], weight, rtol=0.01, atol=1e-3, msg=each)
