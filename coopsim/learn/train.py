"""Training from a recipe: makes the parts, runs the loop, and writes weights, card and curves."""

from __future__ import annotations

import importlib
import json
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import torch

from coopsim.errors import InvalidValueError
from coopsim.learn.clips.ahead import ClipsAhead
from coopsim.learn.clips.clip import ClipSource
from coopsim.learn.clips.sources import LaterClips, clips_of_recipe, held_out_clips
from coopsim.learn.loop.calibration import calibrate, judged_head
from coopsim.learn.loop.train_loop import TrainingProgress, TrainLoop, Validate
from coopsim.learn.loop.training_log import CARD, make_card, read_log, write_curves
from coopsim.learn.loop.validation import HeldOut
from coopsim.learn.recipe import KINDS, TrainingRecipe, find_recipe
from coopsim.learn.samples.batches_ahead import BatchesAhead
from coopsim.learn.samples.sample_order import SampleOrder
from coopsim.learn.tasks.training_task import AnyTask
from coopsim.learn.weights import SUFFIX, digest, save_weights
from coopsim.nn.inference.backend import find_device
from coopsim.support.files import locked, make_folder, write_whole
from coopsim.support.memory import keep_freed_memory
from coopsim.support.rng import require_seed


def train(
    recipe: TrainingRecipe | str | Path,
    out: str | Path,
    seed: int = 0,
    *,
    source: ClipSource | None = None,
    device: str = "auto",
    cache: Path | None = None,
    workers: int = 1,
    validate: Validate | None = None,
    show: Callable[[TrainingProgress], object] | None = None,
    trust: bool = False,
) -> Path:
    """Train a network. Return the path of its weights, in `out`.

    If `out` holds an interrupted training of the same recipe and seed, it goes on, and ends in the same bytes as
    without the interruption (on the same machine, with the same number of threads).

    Args:
        recipe: a recipe, the name of a shipped one, or the path of a YAML file.
        out: folder for checkpoint, weights, card, log and curves.
        seed: seed of first weights, clips and samples.
        source: clips to train on; None: the simulator, in the recipe's world, or the recordings that it names.
        device: "cpu", "cuda", "cuda:1", ...; "auto": a GPU if there is one.
        cache: folder of clips: those in it are read, others are made and stored.
        workers: processes that make batches ahead; 0: made in between.
        validate: returns values of held-out places by name, every `validate_every` steps of the recipe.
        show: called after each step.
        trust: run code that a recipe's file names, such as "mine.py:MyFusion".

    Raises:
        InvalidValueError, UnknownNameError: the recipe is not accepted, or `out` holds another training, or is in use
            by another process.
        TrainingError: the losses are no numbers, or diverge; the last checkpoint is kept.
    """
    recipe, folder = find_recipe(recipe, trust=trust), Path(out)
    require_seed(seed)
    make_folder(folder)
    threads = torch.get_num_threads()
    torch.set_num_threads(recipe.threads)
    keep_freed_memory()
    try:
        with locked(folder):
            place = find_device(device)
            task = make_task(recipe, seed).to(place)
            with _batches(task, recipe, seed, source, cache, workers) as order:
                run = {"recipe": recipe.as_data(), "seed": seed}
                held_out = _held_out(task, recipe, source, cache, place)
                usual = (task.validation() or held_out) if recipe.validate_every else None
                loop = TrainLoop(task, recipe, order, place, folder, run, validate or usual, show)
                loop.train()
            _conclude(loop, seed, held_out)
    finally:
        torch.set_num_threads(threads)
    return folder / f"{recipe.name}{SUFFIX}"


def make_task(recipe: TrainingRecipe, seed: int) -> AnyTask:
    """Return the task of a recipe, with its network's first weights."""
    module, _, name = KINDS[recipe.kind].task.partition(".")
    task: AnyTask = getattr(importlib.import_module(f"coopsim.learn.tasks.{module}"), name)(recipe, seed)
    return task


@contextmanager
def _batches(
    task: AnyTask, recipe: TrainingRecipe, seed: int, source: ClipSource | None, cache: Path | None, workers: int
) -> Iterator[SampleOrder | BatchesAhead]:
    """Return the batches of a training, made by other processes as far as they can do it."""
    if source is None and "picture" in recipe.kind and not recipe.world.get("cameras"):
        raise InvalidValueError(
            f"world.cameras must name rigs with kind: {recipe.kind}, as {{surround: 1}}: without cameras there are no "
            "pictures"
        )
    own = source or task.source(seed)
    clips = own or clips_of_recipe(recipe, seed, cache)
    if own or not workers:
        yield _order(task, recipe, seed, clips)
    elif task.cuts_apart:
        with BatchesAhead(RecipeOrder(recipe, seed, clips), recipe.block, workers) as batches:
            yield batches
    else:
        with ClipsAhead(clips, workers, recipe.block) as ahead:
            yield _order(task, recipe, seed, ahead)


@dataclass(frozen=True)
class RecipeOrder:
    """A maker of the order of a recipe's samples, in another process."""

    recipe: TrainingRecipe
    seed: int
    clips: ClipSource

    def order(self) -> SampleOrder:
        """Return the order."""
        return _order(make_task(self.recipe, self.seed), self.recipe, self.seed, self.clips)


def _order(task: AnyTask, recipe: TrainingRecipe, seed: int, clips: ClipSource) -> SampleOrder:
    return SampleOrder(clips, task.cut, seed, recipe.batch, recipe.block, recipe.passes, task.collate)


def _held_out(
    task: AnyTask, recipe: TrainingRecipe, source: ClipSource | None, cache: Path | None, device: torch.device
) -> HeldOut:
    """Return samples of held-out clips, which are made at their first use."""
    clips = held_out_clips(recipe, cache) if source is None else LaterClips(source)
    return HeldOut(task, clips, recipe.held_out, device)


def _conclude(loop: TrainLoop, seed: int, held_out: HeldOut) -> None:
    """Calibrate the scores of a training that has ended, and write weights, card and curves."""
    recipe, task, folder = loop.recipe, loop.task, loop.folder
    parameters = sum(each.numel() for each in task.net.parameters() if each.requires_grad)
    card: dict[str, Any] = make_card(recipe, seed, loop.device, parameters, read_log(folder))
    if (head := judged_head(loop.average.net)) is not None:
        head.uncalibrate()
        card["calibration"] = calibrate(head, held_out.maps(loop.average.net))
    card["weights"] = {}
    for file in task.files(loop.average.net, recipe.name):
        path = folder / f"{file.name}{SUFFIX}"
        save_weights(path, file.net, {**file.metadata, "recipe": recipe.name, "seed": seed})
        card["weights"][file.name] = {"digest": digest(path), "bytes": path.stat().st_size}
    write_whole(folder / CARD, json.dumps(card, indent=2) + "\n")
    write_curves(folder)
