"""Sources of the clips of a training and of its validation: simulator, recordings, or both."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

from coopsim.catalog import is_recordings_folder
from coopsim.config.load import load
from coopsim.errors import InvalidValueError
from coopsim.learn.clips.clip import Clip, ClipSource
from coopsim.learn.clips.recorded import MixedClips, RecordedClips
from coopsim.learn.clips.simulated import SimulatedClips
from coopsim.learn.clips.store import CachedClips
from coopsim.learn.clips.world_recipe import WorldRecipe
from coopsim.learn.recipe import KINDS, TrainingRecipe

_LATER = 10**9


def clips_of_recipe(recipe: TrainingRecipe, seed: int, cache: Path | None = None) -> ClipSource:
    """Return the clips of a recipe's world, simulated or recorded; with a folder `cache`, each is made once."""
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
    cameras = {"surround": 1.0} if "picture" in recipe.kind else {}
    sweep_s = (0.1,) if recipe.network.get("sweeps", 1) > 1 else ()
    world = WorldRecipe.for_validation(dt_s=(KINDS[recipe.kind].dt_s,), sweep_s=sweep_s, cameras=cameras)
    clips = SimulatedClips(world)
    return clips if cache is None else CachedClips(clips, Path(cache, "held_out"))


@dataclass(frozen=True, slots=True)
class LaterClips:
    """Held-out clips: those of a source from number 10^9 on, which no training comes to."""

    source: ClipSource

    def clip(self, index: int) -> Clip:
        clip: Clip = self.source.clip(_LATER + index)
        return clip
