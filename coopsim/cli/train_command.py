"""`coopsim train`."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

from coopsim.cli.argument_types import count, count_or_zero
from coopsim.cli.arguments import INTERRUPTED, Command, add_flags, add_options, named_options
from coopsim.support.files import require_writable, write_whole

if TYPE_CHECKING:
    from tqdm import tqdm

    from coopsim.learn.loop.train_loop import TrainingProgress
    from coopsim.learn.recipe import TrainingRecipe


def _add_train(parser: argparse.ArgumentParser) -> None:
    add = parser.add_argument
    add("recipe", metavar="RECIPE", help="name of a shipped recipe (pillars, attfuse, ...), or path of a YAML file")
    of = "folders of recordings with sweeps, town or scenario files, instead of the recipe's"
    add("environments", nargs="*", metavar="ENVIRONMENT", help=of)
    add("--start", metavar="WEIGHTS", help="begin with these, by name or path, as pillars (default: the recipe's)")
    add("--out", type=Path, required=True, metavar="DIR", help="for checkpoint, weights, card, log and curves")
    add("--seed", type=count_or_zero, default=0, help="of first weights and samples (default: %(default)s)")
    add("--steps", type=count, help="of the optimizer (default: the recipe's)")
    add("--workers", type=count_or_zero, default=1, help="processes that make batches ahead (default: %(default)s)")
    add("--cache", type=Path, metavar="DIR", help="of clips: those in it are read, others are made and stored")
    add("--trust", action="store_true", help="run code that the file RECIPE names as file.py:Class or module:Class")
    of = "of networks: cpu, cuda, cuda:1 or auto, a GPU if there is one (default: auto)"
    add_flags(parser, "--device", default="auto", help=of)
    add_flags(parser, "--json", help="write the card of the weights here as well")
    add_options(parser, "of the recipe, as lr=0.001 or world.environments=[FOLDER]")


def _run_train(options: argparse.Namespace) -> int:
    from tqdm import tqdm

    recipe = _recipe(options)
    if options.json is not None:
        require_writable(options.json)
    import coopsim.nn  # noqa: F401  (says how to install torch, where it is not)
    from coopsim.learn.loop.training_log import CARD
    from coopsim.learn.train import train

    shape = "{desc}: {percentage:3.0f}%|{bar}| {n_fmt}/{total_fmt} steps [{elapsed}{postfix}]"
    with tqdm(total=recipe.steps, disable=None, desc=recipe.name, bar_format=shape) as bar:
        try:
            weights = train(
                recipe,
                options.out,
                options.seed,
                device=options.device,
                cache=options.cache,
                workers=options.workers,
                show=lambda progress: _show(bar, progress),
            )
        except KeyboardInterrupt:
            bar.close()
            print(f"coopsim: interrupted; {_kept(options.out)}", file=sys.stderr)
            return INTERRUPTED
    for path in (weights, *(options.out / name for name in (CARD, "curves.svg"))):
        print(f"written: {path}")
    if options.json is not None:
        print(f"written: {write_whole(options.json, (options.out / CARD).read_text())}")
    return 0


def _recipe(options: argparse.Namespace) -> TrainingRecipe:
    from coopsim.learn.recipe import find_recipe

    flags = {"steps": "--steps", "start": "--start"}
    given = {"steps": options.steps, "start": options.start, "world.environments": options.environments or None}
    recipe = find_recipe(options.recipe, trust=options.trust).changed(
        **{name: each for name, each in given.items() if each is not None}
    )
    return recipe.changed(**named_options(options, flags))


def _kept(folder: Path) -> str:
    from coopsim.learn.loop.checkpoint import CHECKPOINT

    if (folder / CHECKPOINT).exists():
        return f"its state is stored in {folder}, and the same command goes on from there"
    return "there is no state yet to be stored"


def _show(bar: tqdm[Any], progress: TrainingProgress) -> None:
    if bar.n == 0:
        bar.initial = progress.step - 1
    values = {"loss": progress.losses["loss"], **progress.validation}
    shown = ", ".join(f"{name} {value:.3g}" for name, value in values.items())
    left = "?" if progress.left_s is None else bar.format_interval(progress.left_s)
    bar.set_postfix_str(f"{shown}, about {left} left", refresh=False)
    bar.update(progress.step - bar.n)


TRAIN = Command(
    "train a network on what the simulator shows; the same command goes on after an interruption",
    _add_train,
    _run_train,
    (
        "coopsim train attfuse --out attfuse",
        "coopsim train pillars --out mine --seed 1 --option lr=0.001",
    ),
)
