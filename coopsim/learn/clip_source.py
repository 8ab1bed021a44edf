"""The clips of a training: from the simulator as it runs, from recordings or a folder, and made ahead by processes."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Self

from coopsim.catalog import is_recordings_folder
from coopsim.config.load import load
from coopsim.errors import InvalidValueError
from coopsim.learn.clips.clip import Clip
from coopsim.learn.clips.clip_store import CachedClips, ClipSource
from coopsim.learn.clips.clip_stream import ClipStream
from coopsim.learn.recipe import TrainingRecipe
from coopsim.learn.recorded.recorded_clips import MixedClips, RecordedClips
from coopsim.learn.rollout.rollout import SimulatedClips
from coopsim.learn.rollout.world_recipe import WorldRecipe

_LATER = 10**9


def clips_of_recipe(recipe: TrainingRecipe, seed: int, cache: Path | None = None) -> ClipSource:
    """Return the clips of a recipe's world, simulated or of recordings; with a folder `cache`, each is made once.

    Raises:
        InvalidValueError: a value of the recipe's world is not accepted.
    """
    clips = _clips_of(load(WorldRecipe, recipe.world, "world"), seed)
    return clips if cache is None else CachedClips(clips, cache)


def _clips_of(world: WorldRecipe, seed: int) -> ClipSource:
    folders = tuple(each for each in world.environments if is_recordings_folder(each))
    if not folders:
        return SimulatedClips(world, seed)
    if world.cameras:
        raise InvalidValueError(
            "cameras must be left out where environments has recordings: their pictures have no depths to learn from"
        )
    recorded = RecordedClips(folders, world.frames, tuple(world.dt_s), seed)
    others = tuple(each for each in world.environments if each not in folders)
    if not others:
        return recorded
    simulated = SimulatedClips(replace(world, environments=others), seed)
    return MixedClips(recorded, simulated, len(folders) / len(world.environments), seed)


def held_out_clips(recipe: TrainingRecipe, cache: Path | None = None) -> ClipSource:
    """Return clips of places that no training sees: towns 1000 to 1099; frames are close in time but for detectors."""
    close = ("cooperative", "flow", "together", "seen_covariance", "point_identity", "queries", "integrated")
    dt_s = 0.2 if recipe.kind in close else 0.5
    cameras = {"surround": 1.0} if "picture" in recipe.kind else {}
    clips = SimulatedClips(WorldRecipe.for_validation(dt_s=(dt_s,), cameras=cameras))
    return clips if cache is None else CachedClips(clips, Path(cache, "held_out"))


@dataclass(frozen=True, slots=True)
class LaterClips:
    """The clips of a source from a number on that no training comes to.

    Attributes:
        source: of the clips.
    """

    source: ClipSource

    def clip(self, index: int) -> Clip:
        """Return a clip by its number from 0."""
        return self.source.clip(_LATER + index)


@dataclass(frozen=True, slots=True)
class ClipsOfRank:
    """The clips of one of several processes that train together: every so many-th block.

    Attributes:
        source: of the clips.
        block: clips a block.
        rank: of the process.
        ranks: how many there are.
    """

    source: ClipSource
    block: int
    rank: int
    ranks: int

    def clip(self, index: int) -> Clip:
        """Return a clip by its number among those of the process."""
        block, place = divmod(index, self.block)
        return self.source.clip((block * self.ranks + self.rank) * self.block + place)


class ClipsAhead:
    """The clips of a source, made ahead by other processes for one who asks for one after the other.

    Args:
        source: of the clips.
        workers: number of processes, which end with the `with` statement.
        ahead: clips that each of them makes ahead.
    """

    def __init__(self, source: ClipSource, workers: int, ahead: int) -> None:
        self._source, self._workers, self._ahead = source, workers, ahead
        self._stream: ClipStream | None = None

    def clip(self, index: int) -> Clip:
        """Return a clip; at once if the one before it was asked for last, and it is made."""
        if self._stream is None or self._stream.index != index:
            self._close()
            self._stream = ClipStream(self._source, index, self._workers, self._ahead)
        return next(self._stream)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *exception: object) -> None:
        self._close()

    def _close(self) -> None:
        if self._stream is not None:
            self._stream.close()
