"""The simulated source of frames: a world, sensed by agents."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from coopsim.envs.frames import Frame, FrameSource
from coopsim.envs.simulated.equipment import Equipment
from coopsim.envs.simulated.simulated_episode import SimulatedEpisode
from coopsim.envs.simulated.simulation_options import SimulationOptions
from coopsim.support.checks import require_choice
from coopsim.types import AgentSpec
from coopsim.wire.observation_format import ObservationFormat
from coopsim.world.recording.episode_file import Episode
from coopsim.world.recording.recorded_world import PlayedWorld, RecordedWorld
from coopsim.world.scenario import EpisodeScenarios
from coopsim.world.snapshot import AgentBody, WorldSource
from coopsim.world.world import World


class Simulation(FrameSource):
    """Frames of a `World`, as its agents' sensors see it.

    Args:
        name: the environment's id.
        scenarios: the place and its population, of each episode.
        options: of sensing and scoring.
        recording: a recorded world, to be sensed instead of one that is simulated now.
    """

    _episode: SimulatedEpisode

    def __init__(
        self,
        name: str,
        scenarios: EpisodeScenarios,
        options: SimulationOptions,
        recording: Episode | None = None,
    ) -> None:
        self.name = name
        self._scenarios, self._options, self._recording = scenarios, options, recording
        self._scenario = scenarios.of(0)
        world = self._make_world(seed=0)
        bodies = world.agents()
        self._equipment = Equipment(options, bodies.values())
        self._equipment.require_free_mounts(world)
        self.specs = self._specify(bodies)
        self.road_map = world.map
        most = len(world.actors()) if scenarios.most_actors is None else scenarios.most_actors
        self.capacity = most if recording is None else recording.most_actors
        self.region_m = options.region_m
        if isinstance(options.localization, Mapping):
            for agent in options.localization:
                require_choice("agent in localization", agent, self.specs)
        self.format = ObservationFormat(
            agents=tuple(self.specs),
            lidars={name: tuple(spec.lidars) for name, spec in self.specs.items()},
            cameras={
                name: {camera: calibration.size for camera, calibration in spec.cameras.items()}
                for name, spec in self.specs.items()
            },
            camera_modes=options.camera_modes,
            embedding_dim=options.embedding_dim,
            detection_covariances=options.chosen_detector.states_covariance,
            pose_covariances=any(options.localization_of(name).covariance_scale is not None for name in self.specs),
            skips_frames=options.sense_every > 1,
        )

    def start(self, seed: int, options: Mapping[str, Any]) -> Frame:
        """Begin an episode; see `FrameSource.start`."""
        before, self._scenario = self._scenario, self._scenarios.of(seed)
        world = self._make_world(seed)
        if self._scenario is not before:  # masts of another height
            self._equipment.require_free_masts(world.agents().values())
        if self._options.record is not None:
            world = RecordedWorld(world, self._options.record, self._scenario, seed, self._options.dt_s)
        self.specs, self.road_map = self._specify(world.agents()), world.map
        self._episode = SimulatedEpisode(self._options, self._equipment, world, self.specs, seed)
        return self._episode.frame()

    def advance(self, maneuvers: Mapping[str, int]) -> Frame:
        """Return the next frame; see `FrameSource.advance`."""
        return self._episode.advance(maneuvers)

    @property
    def episode_infos(self) -> dict[str, Any]:
        """The seed of the place, where it was drawn."""
        place_seed = self._scenario.place_seed
        return {} if place_seed is None else {"place_seed": place_seed}

    def close(self) -> None:
        """Release the renderer's resources."""
        self._equipment.close()

    def _make_world(self, seed: int) -> WorldSource:
        if self._recording is not None:
            return PlayedWorld(self._recording, self._scenario)
        policy_control = self._options.control == "policy"
        return World(self._scenario, seed, policy_control=policy_control, traffic=self._options.traffic)

    def _specify(self, bodies: Mapping[str, AgentBody]) -> dict[str, AgentSpec]:
        return {
            name: AgentSpec(
                name,
                body.kind,
                self._options.dt_s,
                drives=self._options.control == "policy" and body.kind == "cav",
                is_object=body.actor_id is not None,
                cameras=self._equipment.calibrations(body),
                lidars=self._equipment.mountings(body),
                sense_every=self._options.sense_every,
                calibration=self._options.chosen_detector.calibration,
            )
            for name, body in bodies.items()
        }
