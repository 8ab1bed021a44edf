"""Clips straight from the simulator."""

from __future__ import annotations

import hashlib
import warnings
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from coopsim.envs.frames import AgentFrame, Frame
from coopsim.envs.simulated.equipment import Equipment
from coopsim.envs.simulated.simulated_episode import SimulatedEpisode
from coopsim.envs.simulated.simulation_options import SimulationOptions
from coopsim.errors import CrowdedWarning
from coopsim.learn.clip_world import ClipWorld, draw_world
from coopsim.learn.compact_points import round_points
from coopsim.learn.scene import AgentScene, Clip, Scene
from coopsim.learn.world_recipe import WorldRecipe
from coopsim.support.arrays import look_up
from coopsim.support.checks import require_count
from coopsim.support.rng import require_seed
from coopsim.types import AgentSpec, Ints, stack_xyz_yaw
from coopsim.world.snapshot import Actors
from coopsim.world.world import World


@dataclass(frozen=True, slots=True)
class SimulatedClips:
    """Clips of worlds that are drawn from a recipe; the agents' cars are driven by the traffic.

    An environment would sense also what nobody wants while traffic runs up, and exchange, score and pack: clips are
    made of its parts, which give the same frames.

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
            scenes = _scenes(drawn, self.recipe.frames)
        place = drawn.scenario.name if drawn.scenario.place_seed is None else f"town {drawn.scenario.place_seed}"
        recipe = hashlib.sha256(repr(self.recipe).encode()).hexdigest()[:8]
        return Clip(f"{place}, recipe {recipe}, seed {self.seed}, clip {index}", drawn.dt_s, scenes)


def _scenes(drawn: ClipWorld, frames: int) -> tuple[Scene, ...]:
    options = SimulationOptions(
        dt_s=drawn.dt_s, lidar=drawn.lidar, weather=drawn.weather, detector="none", threads=1, ground_truth="all"
    )
    world = World(drawn.scenario, drawn.seed)
    if drawn.start_s > 0:
        world.step(drawn.start_s)
    bodies = world.agents()
    equipment = Equipment(options, bodies.values())
    specs = {
        name: AgentSpec(name, body.kind, drawn.dt_s, is_object=body.actor_id is not None)
        for name, body in bodies.items()
    }
    episode = SimulatedEpisode(options, equipment, world, specs, drawn.seed)
    scenes = [_scene(episode.frame())]
    scenes += [_scene(episode.advance({})) for _ in range(frames - 1)]
    return tuple(scenes)


def _scene(frame: Frame) -> Scene:
    actors = frame.actors
    return Scene(
        time_ns=frame.time_ns,
        agents=tuple(_agent(name, agent) for name, agent in frame.agents.items()),
        object_id=actors.id,
        boxes=actors.boxes.array,
        velocity=actors.velocity,
        label=actors.label,
        returns=_returns(actors, frame.agents),
    )


def _agent(name: str, agent: AgentFrame) -> AgentScene:
    seen = agent.observation
    sweeps = [np.column_stack([sweep.points, sweep.intensity]) for sweep in seen.sweeps.values()]
    points: NDArray[np.float32] = round_points(np.concatenate(sweeps).astype(np.float32, copy=False))
    at = stack_xyz_yaw(agent.body.world_SE3_base)
    return AgentScene(name, agent.body.kind, at, seen.odometry.xyz_yaw, points, agent.body.actor_id)


def _returns(actors: Actors, agents: Mapping[str, AgentFrame]) -> Ints:
    """Return the number of returns (N, A): the truth around an agent leaves out itself, which it has none of."""
    order = np.argsort(actors.id)
    returns = np.zeros((len(actors), len(agents)), np.int64)
    for column, agent in enumerate(agents.values()):
        assert agent.truth.returns is not None, "LiDARs count them"
        place, known = look_up(actors.id[order], agent.truth.id)
        assert known.all(), "the truth is about actors"
        returns[order[place], column] = agent.truth.returns[:, column]
    return returns
