"""Records of a training: log (`log.jsonl`, a line for every step and every validation), curves, and card."""

from __future__ import annotations

import json
import shlex
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import torch

from coopsim.errors import InvalidValueError
from coopsim.learn.recipe import RECIPES, TrainingRecipe, find_recipe
from coopsim.nn.inference.backend import numbers_on
from coopsim.support.files import write_durably, write_whole
from coopsim.support.processes import processor_name
from coopsim.version import __version__
from coopsim.viz.charts import to_svg

LOG = "log.jsonl"
"""Name of the file in a training's folder."""


class TrainingLog:
    """Losses of all steps, and values of held-out clips.

    Args:
        folder: folder of the training.
        step: steps taken; lines of later steps, from before an interruption, are dropped: they come again.
    """

    def __init__(self, folder: Path, step: int) -> None:
        self._path = folder / LOG
        self._lines = [line for line in read_log(folder) if line["step"] <= step] if step else []

    def add(self, step: int, values: Mapping[str, float], kind: str = "losses") -> None:
        """Add values after a step, from 1; of the kind "losses" or "validation"."""
        self._lines.append({"step": step, "kind": kind, **{name: round(value, 6) for name, value in values.items()}})

    def write(self) -> None:
        """Write the file; it is as durable as the checkpoint beside it."""
        write_durably(self._path, "".join(f"{json.dumps(line)}\n" for line in self._lines).encode())


def read_log(folder: Path) -> list[dict[str, Any]]:
    """Read the log of a training; empty if there is none.

    Raises:
        InvalidValueError: the file is broken; names the line.
    """
    path = folder / LOG
    lines = path.read_text(encoding="utf-8").splitlines() if path.exists() else []
    found: list[dict[str, Any]] = []
    for number, line in enumerate(lines, 1):
        try:
            found.append({**json.loads(line)})
            found[-1]["step"] = int(found[-1]["step"])
        except (ValueError, TypeError, KeyError) as error:
            raise InvalidValueError("this is no line of a training's log").at(f"{path}:{number}") from error
    return found


def mean_values(lines: Sequence[Mapping[str, Any]]) -> dict[str, float]:
    """Return the mean of each value by name, over those lines that have it: not every step has every loss."""
    found: dict[str, list[float]] = {}
    for line in lines:
        for name, value in line.items():
            if name != "kind":
                found.setdefault(name, []).append(value)
    return {name: sum(values) / len(values) for name, values in found.items()}


CURVES = "curves.svg"
"""Name of the file in a training's folder."""

_POINTS = 200
_LOSSES = "losses"


def write_curves(folder: Path) -> Path:
    """Draw losses and values of held-out places over the steps of a training's log. Return the file's path."""
    panels = _panels(read_log(folder))

    def draw(figure: Any) -> None:
        for place, (title, curves) in enumerate(panels.items()):
            _draw(figure.add_subplot(1, len(panels), place + 1), title, curves)

    return write_whole(folder / CURVES, to_svg(draw, 4.6 * max(1, len(panels)), 3.2))


def _panels(lines: Sequence[Mapping[str, Any]]) -> dict[str, dict[str, list[tuple[float, float]]]]:
    """Return (step, value) by panel and name; losses that fall below zero have a panel without logarithms."""
    losses, held_out = (_curves(_thinned(lines, kind)) for kind in ("losses", "validation"))
    positive = {name: points for name, points in losses.items() if min(value for _, value in points) > 0}
    negative = {name: points for name, points in losses.items() if name not in positive}
    panels = {_LOSSES: positive, "losses that may be negative": negative, "held-out places": held_out}
    return {title: curves for title, curves in panels.items() if curves}


def _curves(lines: Sequence[Mapping[str, float]]) -> dict[str, list[tuple[float, float]]]:
    names = dict.fromkeys(name for line in lines for name in line if name != "step")
    return {name: [(line["step"], line[name]) for line in lines if name in line] for name in names}


def _thinned(lines: Sequence[Mapping[str, Any]], kind: str) -> list[dict[str, float]]:
    """Return the lines of a kind, of many the means of as many neighbours as make at most `_POINTS`."""
    found = [line for line in lines if line["kind"] == kind]
    each = max(1, -(-len(found) // _POINTS))
    return [mean_values(found[k : k + each]) for k in range(0, len(found), each)]


def _draw(panel: Any, title: str, curves: Mapping[str, Sequence[tuple[float, float]]]) -> None:
    for name, points in curves.items():
        label = name.rpartition("/")[2]  # a user's loss is called by the place of its file
        panel.plot(*zip(*points, strict=True), label=label, linewidth=1, marker="." if len(points) < 30 else None)
    panel.set(xlabel="steps", title=title)
    if title == _LOSSES:
        panel.set_yscale("log")
        panel.yaxis.set_major_formatter("{x:g}")  # numbers as text: formulas would show their source
        panel.yaxis.set_minor_formatter("")
    panel.legend(loc="upper left", bbox_to_anchor=(1, 1))


CARD = "card.json"
"""Name of the file in a training's folder."""

_LAST = 100
"""Steps at the end whose mean losses are in the card."""

_NETWORKS = ("start", "detector", "teacher")
"""Options of a recipe that may be paths; a card has only the file's name."""


def make_card(
    recipe: TrainingRecipe, seed: int, device: torch.device, parameters: int, log: Sequence[Mapping[str, Any]]
) -> dict[str, Any]:
    """Return the card of a training, but for the digests and sizes of its files.

    Args:
        recipe: recipe of the training.
        seed: seed of the training.
        device: device of the training.
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
        "precision": str(numbers_on(device, recipe.precision)).removeprefix("torch."),
        "teacher": "none" if recipe.teacher is None else Path(recipe.teacher).stem,
        "threads": recipe.threads,
        "device": str(device),
        "processor": processor_name(),
        "versions": {"coopsim": __version__, "torch": torch.__version__, "numpy": np.__version__},
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
