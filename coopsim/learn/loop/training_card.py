"""The card of a training's weights: how they were made, so that they can be made anew."""

from __future__ import annotations

import json
import platform
import shlex
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import torch

import coopsim
from coopsim.learn.loop.ranks import Ranks
from coopsim.learn.loop.training_log import mean_values
from coopsim.learn.recipe import RECIPES, TrainingRecipe, find_recipe
from coopsim.nn.inference.devices import numbers_on

CARD = "card.json"
"""Name of the file in a training's folder."""

_LAST = 100
"""Steps at the end whose mean losses are in the card."""

_NETWORKS = ("start", "detector", "teacher")
"""Options of a recipe that may be paths; a card has only the file's name."""


def make_card(
    recipe: TrainingRecipe, seed: int, ranks: Ranks, parameters: int, log: Sequence[Mapping[str, Any]]
) -> dict[str, Any]:
    """Return all of a card but what is measured of the files.

    Args:
        recipe: of the training.
        seed: of the training.
        ranks: processes that trained together.
        parameters: number of parameters that were trained.
        log: lines of the training's log.
    """
    losses = [line for line in log if line["kind"] == "losses"][-_LAST:]
    looks = [line for line in log if line["kind"] == "validation"]
    return {
        "name": recipe.name,
        "command": command_of(recipe, seed),
        "seed": seed,
        "steps": recipe.steps,
        "parameters": parameters,
        "losses": {name: round(value, 4) for name, value in sorted(mean_values(losses).items()) if name != "step"},
        "held_out": {name: value for name, value in looks[-1].items() if name not in ("step", "kind")} if looks else {},
        "precision": str(numbers_on(ranks.device, recipe.precision)).removeprefix("torch."),
        "teacher": "none" if recipe.teacher is None else Path(recipe.teacher).stem,
        "threads": recipe.threads,
        "processes": ranks.ranks,
        "device": str(ranks.device),
        "processor": _processor(),
        "versions": {"coopsim": coopsim.__version__, "torch": torch.__version__, "numpy": np.__version__},
        "recipe": _without_folders(recipe.as_data()),
    }


def command_of(recipe: TrainingRecipe, seed: int) -> str:
    """Return a command that repeats a training: the shipped recipe, or a file of its name, and what differs from it."""
    known = recipe.name in RECIPES
    words = ["coopsim", "train", recipe.name if known else f"{recipe.name}.yaml", "--out", recipe.name]
    words += ["--seed", str(seed)]
    if known:
        shipped = _without_folders(find_recipe(recipe.name).as_data())
        changed = {k: v for k, v in _without_folders(recipe.as_data()).items() if v != shipped[k]}
        if "steps" in changed:
            words += ["--steps", str(changed.pop("steps"))]
        for name, value in changed.items():
            words += ["--option", f"{name}={value if isinstance(value, str) else json.dumps(value)}"]
    return shlex.join(words)


def _without_folders(recipe: Mapping[str, Any]) -> dict[str, Any]:
    names = {name: Path(recipe[name]).stem for name in _NETWORKS if recipe[name] is not None}
    return {**recipe, **names}


def _processor() -> str:
    """Return the processor's name, as far as the system says it."""
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        lines = []
    named = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return named[0] if named else platform.processor() or platform.machine()
