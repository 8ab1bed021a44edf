"""Clips straight from the simulator."""

from __future__ import annotations

import hashlib
import warnings
from collections.abc import Iterator
from contextlib import closing
from dataclasses import dataclass

from coopsim.errors import CrowdedWarning
from coopsim.learn.clips.clip import Clip, Scene
from coopsim.learn.rollout.clip_sensing import ClipSensing
from coopsim.learn.rollout.clip_world import ClipWorld, draw_world
from coopsim.learn.rollout.world_recipe import WorldRecipe
from coopsim.support.checks import require_count
from coopsim.support.rng import require_seed
from coopsim.types import seconds_to_ns
from coopsim.world.world import World


@dataclass(frozen=True, slots=True)
class SimulatedClips:
    """Clips of worlds that are drawn from a recipe; the agents' cars are driven by the traffic.

    A frame is what an environment of the same world shows, bit by bit but for the rounding of points. No environment is
    made, which would sense also before a clip's start, exchange, score and pack.

    Attributes:
        recipe: what to draw from.
        seed: another one gives other clips.
    """

    recipe: WorldRecipe
    seed: int = 0

    def __post_init__(self) -> None:
        require_seed(self.seed)

    def clip(self, index: int) -> Clip:
        """Return a clip: the same bits for the same recipe, seed and index, in any process and any order.

        Pictures are the same bits only with the same renderer: OpenGL where it works, else ray casting.

        Args:
            index: >= 0.

        Raises:
            InvalidValueError: the index is no count, or the recipe asks for agents that a place has no room for.
        """
        require_count(0, index=index)
        with warnings.catch_warnings():
            # A drawn density asks for more than some places hold; there are then as many as fit, which is as good.
            warnings.simplefilter("ignore", CrowdedWarning)
            drawn = draw_world(self.recipe, self.seed, int(index))
            scenes = tuple(_scenes(drawn, self.recipe.frames))
        place = drawn.scenario.name if drawn.scenario.place_seed is None else f"town {drawn.scenario.place_seed}"
        recipe = hashlib.sha256(repr(self.recipe).encode()).hexdigest()[:8]
        return Clip(f"{place}, recipe {recipe}, seed {self.seed}, clip {index}", drawn.dt_s, scenes)


def _scenes(drawn: ClipWorld, frames: int) -> Iterator[Scene]:
    world = World(drawn.scenario, drawn.seed)
    if drawn.start_s > 0:
        world.step(drawn.start_s)
    with closing(ClipSensing(drawn, world)) as sensing:
        for frame in range(frames):
            if frame:
                world.step(drawn.dt_s)
            yield sensing.sense(seconds_to_ns(frame * drawn.dt_s))
