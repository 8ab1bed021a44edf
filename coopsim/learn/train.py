"""Training from a recipe: makes the parts, runs the loop, and writes what it gives."""

from __future__ import annotations

import copy
import json
from collections.abc import Callable, Mapping
from contextlib import AbstractContextManager, nullcontext
from pathlib import Path
from typing import Any

import torch
from torch import nn

from coopsim.config.load import load
from coopsim.errors import InvalidValueError
from coopsim.learn.clip_source import ClipsAhead, ClipsOfRank, LaterClips, clips_of_recipe, held_out_clips
from coopsim.learn.clips.clip_store import ClipSource
from coopsim.learn.clips.clips_on_ray import ClipsOnRay
from coopsim.learn.loop.checkpoint import load_checkpoint, read_state
from coopsim.learn.loop.ranks import Ranks, joined
from coopsim.learn.loop.train_loop import TrainingProgress, TrainLoop, Validate
from coopsim.learn.loop.training_card import CARD, make_card
from coopsim.learn.loop.training_curves import write_curves
from coopsim.learn.loop.training_log import read_log
from coopsim.learn.loop.validation import HeldOut
from coopsim.learn.recipe import TrainingRecipe, find_recipe
from coopsim.learn.samples.sample_order import SampleOrder, SampleSource
from coopsim.learn.tasks.training_task import TrainingTask
from coopsim.learn.weights import SUFFIX, digest, save_weights
from coopsim.nn.inference.devices import find_device
from coopsim.nn.inference.memory import keep_freed_memory
from coopsim.support.files import locked, make_folder, write_whole
from coopsim.support.rng import require_seed


def train(
    recipe: TrainingRecipe | str | Path,
    out: str | Path,
    seed: int = 0,
    *,
    source: ClipSource | None = None,
    device: str = "auto",
    cache: Path | None = None,
    workers: int | str = 1,
    validate: Validate | None = None,
    show: Callable[[TrainingProgress], object] | None = None,
) -> Path:
    """Train a network. Return the path of its weights, in `out`.

    If `out` holds an interrupted training of the same recipe and seed, it goes on, and ends in the same bytes as
    without the interruption (on the same machine, with the same number of threads).

    Args:
        recipe: a recipe, the name of a shipped one, or the path of a YAML file.
        out: folder for checkpoint, weights, card, log and curves.
        seed: of first weights, clips and samples.
        source: of the clips; None: the simulator, in the recipe's world, or the recordings that it names.
        device: "cpu", "cuda", "cuda:1", ...; "auto": a GPU if there is one.
        cache: folder of clips: those in it are read, others are made and stored.
        workers: processes that make clips ahead; 0: made in between; "ray": on a Ray cluster.
        validate: looks at held-out places every `validate_every` steps of the recipe.
        show: called after each step.

    Raises:
        InvalidValueError, UnknownNameError: of the recipe, or `out` holds another training, or is in use by another
            process.
        TrainingError: the losses are no numbers, or diverge; the last checkpoint is kept.
    """
    recipe, folder = find_recipe(recipe), Path(out)
    require_seed(seed)
    make_folder(folder)
    threads = torch.get_num_threads()
    torch.set_num_threads(recipe.threads)
    keep_freed_memory()
    try:
        with joined(find_device(device)) as ranks, locked(folder) if ranks.writes else nullcontext():
            task = make_task(recipe, seed).to(ranks.device)
            with _clips(task, recipe, seed, source, cache, workers, ranks) as clips:
                order = SampleOrder(clips, task.cut, seed, recipe.batch, recipe.block, recipe.passes, ranks.rank)
                run = {"recipe": recipe.as_data(), "seed": seed, "processes": ranks.ranks}
                validate = validate or _held_out(task, recipe, source, cache, ranks)
                loop = TrainLoop(task, recipe, order, ranks, folder, run, validate, show)
                loop.train()
            if ranks.writes:
                _conclude(loop, folder, seed)
    finally:
        torch.set_num_threads(threads)
    return folder / f"{recipe.name}{SUFFIX}"


def store_unfinished(folder: str | Path, out: str | Path) -> list[Path]:
    """Write the weights of a training's last checkpoint, to try them before the training ends. Return the files.

    Args:
        folder: of the training; may be in use.
        out: folder for the weights.

    Raises:
        InvalidValueError: there is no checkpoint, or it is broken.
    """
    state = read_state(Path(folder))
    recipe, seed = load(TrainingRecipe, state.run["recipe"], "recipe"), int(state.run["seed"])
    task = make_task(recipe, seed)
    average, adam = copy.deepcopy(task.net), torch.optim.AdamW(task.net.parameters())
    state = load_checkpoint(Path(folder), state.run, task.net, average, adam) or state
    make_folder(Path(out))
    return _store(task, average, recipe, Path(out), {"seed": seed, "step": state.step})


def make_task(recipe: TrainingRecipe, seed: int) -> TrainingTask:
    """Return what a recipe trains, with its first weights."""
    if recipe.kind == "detector":
        from coopsim.learn.tasks.detector_task import DetectorTask

        return DetectorTask(recipe, seed)
    if recipe.kind in ("pictures", "points_and_pictures"):
        from coopsim.learn.tasks.pictures_task import PicturesTask

        return PicturesTask(recipe, seed)
    if recipe.kind == "covariance":
        from coopsim.learn.tasks.covariance_task import CovarianceTask

        return CovarianceTask(recipe, seed)
    if recipe.kind == "seen_covariance":
        from coopsim.learn.tasks.seen_covariance_task import SeenCovarianceTask

        return SeenCovarianceTask(recipe, seed)
    if recipe.kind == "point_identity":
        from coopsim.learn.tasks.point_identity_task import PointIdentityTask

        return PointIdentityTask(recipe, seed)
    if recipe.kind == "picture_identity":
        from coopsim.learn.tasks.picture_identity_task import PictureIdentityTask

        return PictureIdentityTask(recipe, seed)
    if recipe.kind == "queries":
        from coopsim.learn.tasks.query_task import QueryTask

        return QueryTask(recipe, seed)
    if recipe.kind == "integrated":
        from coopsim.learn.tasks.integrated_task import IntegratedTask

        return IntegratedTask(recipe, seed)
    if recipe.kind == "cooperative":
        from coopsim.learn.tasks.cooperative_task import CooperativeTask

        return CooperativeTask(recipe, seed)
    if recipe.kind == "flow":
        from coopsim.learn.tasks.flow_task import FlowTask

        return FlowTask(recipe, seed)
    from coopsim.learn.tasks.together_task import TogetherTask

    return TogetherTask(recipe, seed)


def _clips(
    task: TrainingTask,
    recipe: TrainingRecipe,
    seed: int,
    source: ClipSource | None,
    cache: Path | None,
    workers: int | str,
    ranks: Ranks,
) -> AbstractContextManager[SampleSource]:
    if source is None and "picture" in recipe.kind and not recipe.world.get("cameras"):
        raise InvalidValueError(
            f"world.cameras must name rigs with kind: {recipe.kind}, as {{surround: 1}}: without cameras there are no "
            "pictures"
        )
    own: Any = source or task.source(seed)
    clips: Any = own or clips_of_recipe(recipe, seed, cache)
    if ranks.ranks > 1:
        clips = ClipsOfRank(clips, recipe.block, ranks.rank, ranks.ranks)
    if workers == "ray":
        return ClipsOnRay(clips, ahead=4 * recipe.block)
    if isinstance(workers, str):
        raise InvalidValueError(f"workers must be an integer >= 0 or 'ray', got {workers!r}")
    return nullcontext(clips) if own or not workers else ClipsAhead(clips, workers, recipe.block)


def _held_out(
    task: TrainingTask, recipe: TrainingRecipe, source: ClipSource | None, cache: Path | None, ranks: Ranks
) -> Validate | None:
    """Return what looks at held-out places: of a source of one's own at its clips from number 1,000,000 on."""
    if not recipe.validate_every:
        return None
    own = task.validation()
    if own is not None:
        return own
    clips = held_out_clips(recipe, cache) if source is None else LaterClips(source)
    return HeldOut(task, clips, recipe.held_out, ranks.device)


def _conclude(loop: TrainLoop, folder: Path, seed: int) -> None:
    """Write weights, card and curves of a training that has ended."""
    recipe, task = loop.recipe, loop.task
    parameters = sum(each.numel() for each in task.net.parameters() if each.requires_grad)
    card = make_card(recipe, seed, loop.ranks, parameters, read_log(folder))
    paths = _store(task, loop.average.net, recipe, folder, {"seed": seed})
    card["weights"] = {path.stem: {"digest": digest(path), "bytes": path.stat().st_size} for path in paths}
    write_whole(folder / CARD, json.dumps(card, indent=2) + "\n")
    write_curves(folder)


def _store(
    task: TrainingTask, net: nn.Module, recipe: TrainingRecipe, folder: Path, said: Mapping[str, Any]
) -> list[Path]:
    """Write the files of a trained network. Return their paths."""
    files = task.files(net, recipe.name)
    paths = [folder / f"{file.name}{SUFFIX}" for file in files]
    for file, path in zip(files, paths, strict=True):
        save_weights(path, file.net, {**file.metadata, "recipe": recipe.name, **said})
    return paths
