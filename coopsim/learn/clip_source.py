"""The clips of a training: from the simulator as it runs, made ahead by other processes, or from a folder."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from coopsim.config.load import load
from coopsim.learn.clip_store import CachedClips, ClipSource
from coopsim.learn.ranks import Ranks
from coopsim.learn.recipe import TrainingRecipe


@contextmanager
def open_clips(
    recipe: TrainingRecipe, seed: int, cache: Path | None, workers: int | str, ranks: Ranks
) -> Iterator[ClipSource]:
    """Yield the clips of a recipe's world; its processes end with the context.

    Args:
        recipe: of the training.
        seed: of the clips.
        cache: folder of clips: those in it are read, others are made and stored.
        workers: processes that make clips ahead; 0: made in between; "ray": on a Ray cluster.
        ranks: processes that train together: each reads every so many-th block.
    """
    from coopsim.learn.rollout import SimulatedClips
    from coopsim.learn.world_recipe import WorldRecipe

    clips: ClipSource = SimulatedClips(load(WorldRecipe, recipe.world, "world"), seed)
    yield clips if cache is None else CachedClips(clips, cache)
