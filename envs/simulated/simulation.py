"""Simulated source of frames: a world, sensed by agents. An episode is traffic, then sensors, then perception."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np

from coopsim.envs.frames import AgentFrame, Frame, FrameProbe, FrameSource
from coopsim.envs.simulated.equipment import Equipment
from coopsim.envs.simulated.lidar_sensing import (
    CastSomeSweeps,
    CastSweeps,
    ExpectReturns,
    LidarReading,
    LidarSensing,
)
from coopsim.envs.simulated.occlusion_map import OcclusionMap
from coopsim.envs.simulated.perception import Perception, observation_format
from coopsim.envs.simulated.planned_driving import PlannedDriving
from coopsim.envs.simulated.simulation_options import SimulationOptions
from coopsim.errors import InvalidValueError
from coopsim.interfaces.attack import OpenFacts
from coopsim.sensors.lidar.lidar import LidarConfig
from coopsim.sensors.scene import RayScene, SceneGeometry
from coopsim.sensors.visibility import PixelVisibility, Visibility, measure_pixels
from coopsim.support.arrays import look_up
from coopsim.types import AgentSpec, CameraImage, Ints, Observation, Sweep, Tracks, seconds_to_ns
from coopsim.types.driving import ACCELERATION, MANEUVER, STEERING, CarState, Command, acceleration_of
from coopsim.world.intersections import LitJunction, lit_junctions
from coopsim.world.recording.episode_file import Episode
from coopsim.world.recording.recorded_world import PlayedWorld, RecordedWorld
from coopsim.world.scenario import EpisodeScenarios, Scenario
from coopsim.world.snapshot import Actors, AgentBody, DrivenWorld, WorldSource
from coopsim.world.traffic.mapped_ways import MappedWays
from coopsim.world.world import World

_COMMANDS: dict[str, Any] = {"policy": MANEUVER, "acceleration": ACCELERATION, "steering": STEERING}


class Simulation(FrameSource):
    """Frames of a `World`, as its agents' sensors see it."""

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
        if options.signal_messages and self._scenario.played is not None:
            raise InvalidValueError("signal_messages needs lights with known programs, got a log's or SUMO's traffic")
        world = self._make_world(seed=0)
        bodies = world.agents()
        self._equipment = Equipment(options, bodies.values())
        self._equipment.require_free_mounts(world)
        self._conflicts: tuple[int, ...] = ()
        self._driven = self._driven_among(bodies)
        self.specs = self._specify(bodies)
        self._world, self.road_map, self.static = world, world.map, world.static
        most = len(world.actors()) if scenarios.most_actors is None else scenarios.most_actors
        self.capacity = most if recording is None else recording.most_actors
        self.region_m = options.region_m
        skips_frames = options.sense_every > 1
        form = observation_format(self.specs, options, options.camera_modes, skips_frames=skips_frames)
        self.format = replace(form, signals=options.signal_messages)
        if options.signal_messages and not any(body.kind == "rsu" for body in bodies.values()):
            raise InvalidValueError("signal_messages needs a roadside unit that sends them: accepted with rsus >= 1")

    def start(self, seed: int, options: Mapping[str, Any]) -> Frame:
        """Begin an episode; see `FrameSource.start`."""
        before, self._scenario = self._scenario, self._scenarios.of(seed)
        made = world = self._make_world(seed)
        if self._scenario is not before:  # masts of another height
            self._equipment.require_free_masts(world.agents().values())
        if self._options.record is not None:
            world = RecordedWorld(world, self._options.record, self._scenario, seed, self._options.dt_s)
        self.specs, self._world = self._specify(world.agents()), made
        self.road_map, self.static = made.map, made.static
        self._episode = SimulatedEpisode(self._options, self._equipment, world, self.specs, seed, self._scenario)
        self._conflicts = made.conflict_ids if isinstance(made, DrivenWorld) else ()
        if isinstance(made, DrivenWorld) and self._driven:
            self._episode.let_drive(made, self._driven)
        return self._episode.frame()

    def advance(self, commands: Mapping[str, Command], tracks: Mapping[str, Tracks]) -> Frame:
        """Return the next frame; see `FrameSource.advance`."""
        frame = self._episode.advance(commands, tracks)
        self.road_map = self._world.map  # with traffic lights as they are now
        return frame

    @property
    def driven(self) -> tuple[str, ...]:
        """Names of the cars that a planner or the action drives; see `FrameSource.driven`."""
        return self._driven if self._options.traffic != "highway-env" else ()

    def car_ahead(self, name: str) -> CarState | None:
        """Return a connected car's motion and way ahead, unless a log or SUMO moves it; see `FrameSource.car_ahead`."""
        if self.specs[name].kind != "cav" or self._options.traffic == "highway-env":
            return None
        world = self._world
        if not isinstance(world, DrivenWorld) or not (isinstance(world, World) or name in self._driven):
            return None
        return world.car_ahead(name)

    def hear(self, received: Mapping[str, Observation]) -> None:
        """Let planners hear what others plan; see `FrameSource.hear`."""
        self._episode.hear(received)

    @property
    def open_facts(self) -> OpenFacts:
        """The planner and the map; see `FrameSource.open_facts`."""
        # Of the map alone: what is reachable from here, an attacker's code could read.
        return OpenFacts(self.driven, self._options.planner, MappedWays(self._scenario.layout.network).ahead)

    @property
    def junctions(self) -> tuple[LitJunction, ...]:
        """Junctions with lights; see `FrameSource.junctions`."""
        return lit_junctions(self._scenario.layout) if self._options.signal_messages else ()

    @property
    def staged(self) -> bool:
        """True if the scenario has a script; see `FrameSource.staged`."""
        return self._scenario.script is not None

    @property
    def episode_infos(self) -> dict[str, Any]:
        """The seed of the place, where it was drawn, and what is played."""
        place_seed, played = self._scenario.place_seed, self._scenario.played
        drawn = {} if place_seed is None else {"place_seed": place_seed}
        return drawn if played is None else drawn | dict(played.facts)

    @property
    def facts(self) -> dict[str, Any]:
        """Ids of the actors that the script names as conflicting; see `FrameSource.facts`."""
        return {"conflicts": self._conflicts} if self._conflicts else {}

    def close(self) -> None:
        """Release the renderer's resources."""
        self._equipment.close()
        self._scenarios.close()

    def _make_world(self, seed: int) -> WorldSource:
        if self._recording is not None:
            return PlayedWorld(self._recording, self._scenario)
        control, traffic, driven = self._options.world_control, self._options.traffic, self._options.driven_agents
        if self._scenario.played is not None:
            return self._scenario.played.world(self._scenario, seed, control=control, driven=driven)
        route_m, grip = self._options.route_m, self._options.chosen_grip
        return World(self._scenario, seed, control=control, traffic=traffic, driven=driven, route_m=route_m, grip=grip)

    def _driven_among(self, bodies: Mapping[str, AgentBody]) -> tuple[str, ...]:
        """Return the names of the connected cars that the option `control` is about."""
        if self._options.control == "traffic":
            return ()
        cars = tuple(name for name, body in bodies.items() if body.kind == "cav")
        return cars if self._options.driven_agents is None else tuple(self._options.driven_agents)

    def _specify(self, bodies: Mapping[str, AgentBody]) -> dict[str, AgentSpec]:
        return {
            name: AgentSpec(
                name,
                body.kind,
                self._options.dt_s,
                command=_COMMANDS.get(self._options.control) if name in self._driven else None,
                is_object=body.actor_id is not None,
                cameras=self._equipment.calibrations(body),
                lidars=self._equipment.mountings(body),
                sense_every=self._options.sense_every,
                calibration=self._options.chosen_detector.calibration,
            )
            for name, body in bodies.items()
        }


class SimulatedEpisode:
    """A running episode."""

    def __init__(
        self,
        options: SimulationOptions,
        equipment: Equipment,
        world: WorldSource,
        specs: Mapping[str, AgentSpec],
        seed: int,
        scenario: Scenario,
    ) -> None:
        self._options, self._equipment, self._world, self._specs = options, equipment, world, specs
        self._scenario = scenario
        self._ends_when_over = scenario.played is not None
        self._geometry = SceneGeometry(world.models, world.static)
        self._lidars = self._lidar_sensing(specs, seed)
        self._perception = Perception(options, specs, seed)
        self._cycle = 0
        self._last_sensed: tuple[Ints, Ints]  # ids (N,) of all actors, returns (N, A) from each to each agent
        self._cars: DrivenWorld | None = None
        self._driven: tuple[str, ...] = ()
        self._planning: PlannedDriving | None = None
        self._commands: Mapping[str, Command] = {}
        self._frame: Frame

    def let_drive(self, world: DrivenWorld, driven: tuple[str, ...]) -> None:
        """Let the action or a planner drive some connected cars of a world, by name."""
        self._cars, self._driven = world, driven
        if self._options.control == "planner":
            entries = world.entries if isinstance(world, World) else lambda name: np.zeros((0, 5))
            occlusions = OcclusionMap(self._world.map, entries)
            self._planning = PlannedDriving(
                self._options.planner, {name: self._specs[name] for name in driven}, occlusions
            )

    def advance(self, commands: Mapping[str, Command], tracks: Mapping[str, Tracks]) -> Frame:
        """Step the world and return the next frame; see `FrameSource.advance`."""
        if self._planning is not None:
            commands = self._planning.commands(self._frame, tracks)
        self._world.step(self._options.dt_s, commands)
        self._commands = commands
        self._cycle += 1
        return self.frame()

    def hear(self, received: Mapping[str, Observation]) -> None:
        """Let planners hear what others plan."""
        if self._planning is not None:
            self._planning.hear(received)

    def frame(self) -> Frame:
        """Sense the world as it is now."""
        # From the cycle, not by addition: 0.1 s must not drift from the tenth of a second.
        time_ns = seconds_to_ns(self._cycle * self._options.dt_s)
        actors, bodies = self._world.actors(), self._world.agents()
        sensed = self._cycle % self._options.sense_every == 0
        scene = cache(lambda: RayScene(self._geometry.triangles(actors, lights=self._world.map.lights)))
        readings = self._lidars.sense(scene, actors, bodies) if sensed else {}
        probe = SceneProbe(self._equipment, scene, actors, bodies, readings)
        if sensed:
            self._last_sensed = actors.id, np.stack([reading.returns for reading in readings.values()], axis=1)
            sweeps = {name: reading.sweeps for name, reading in readings.items()}
            images = probe.photograph() if self._equipment.has_cameras else {}
        else:
            self._lidars.skip(actors, bodies)
            sweeps = {name: dict.fromkeys(self._specs[name].lidars, Sweep.empty()) for name in bodies}
            images = {name: self._equipment.blank_images(name) for name in bodies}
        returns = self._returns(actors)
        frames = self._perception.frames(time_ns, bodies, actors, returns, sweeps, images, sensed=sensed)
        if images:
            frames = {name: replace(each, segmentation=images.get(name, {})) for name, each in frames.items()}
        agents = frames | self._driven_frames(frames)
        crashed = self._options.ends_on_crash and self._any_crashed(bodies)
        arrived = self._options.ends_on_arrival and not crashed and _all_arrived(agents[name] for name in self._driven)
        last = crashed or arrived or self._cycle >= self._options.max_cycles or (self._ends_when_over and self._is_over)
        end = "crash" if crashed else "arrived" if arrived else self._end
        self._frame = Frame(time_ns, agents, actors, last, probe, end)
        return self._frame

    @property
    def _end(self) -> str:
        """Return why the episode would end now, without a crash."""
        if not self._is_over:
            return "max_cycles"
        return "log over" if self._ends_when_over else "situation over"

    @property
    def _is_over(self) -> bool:
        over_s = self._scenario.over_s  # of a situation, or of what is played, as far as it is known by now
        if over_s is None:
            return False
        if self._ends_when_over and self._cars is not None:
            return self._cars.is_over_in(self._options.dt_s)
        if self._ends_when_over:  # no agent is there in the next frame
            return (self._cycle + 1) * self._options.dt_s > over_s + 1e-6
        return self._cycle * self._options.dt_s >= over_s - 1e-9

    def _driven_frames(self, frames: Mapping[str, AgentFrame]) -> dict[str, AgentFrame]:
        """Return the frames of driven cars with their states, which highway-env's own objects lack."""
        if self._cars is None or self._options.traffic == "highway-env":
            return {}
        asked = {} if self._options.control == "policy" else self._commands
        return {
            name: replace(frames[name], car=self._cars.car_ahead(name), command_m_s2=_acceleration(asked.get(name)))
            for name in self._driven
        }

    def _any_crashed(self, bodies: Mapping[str, AgentBody]) -> bool:
        """Return whether a driven car has crashed."""
        if self._cars is None:
            return False
        crashed = self._cars.crashed()
        return any(bodies[name].actor_id in crashed for name in self._driven)

    def _lidar_sensing(self, specs: Mapping[str, AgentSpec], seed: int) -> LidarSensing:
        options, carriers = self._options, self._equipment.lidar_carriers
        if not carriers:
            usual = LidarConfig(columns=options.lidar_columns, max_range_m=options.lidar_range_m)
            return self._expected_returns(usual)
        agents = [name for name in specs if name in carriers]
        cast = CastSweeps(self._equipment.lidars, agents, seed, options.dt_s, options.sweep_threads)
        if len(agents) == len(specs):
            return cast
        first = next(iter(options.lidars.values()))
        return CastSomeSweeps(cast, carriers, self._expected_returns(first))

    def _expected_returns(self, config: LidarConfig) -> ExpectReturns:
        options = self._options
        return ExpectReturns(config, options.drone_pitch_rad, self._world.static, options.chosen_weather)

    def _returns(self, actors: Actors) -> Ints:
        """Return the number of returns (N, A) from each actor when last sensed; 0 for those that came since."""
        ids, sensed = self._last_sensed
        if ids is actors.id:
            return sensed
        order = np.argsort(ids)
        place, known = look_up(ids[order], actors.id)
        returns = np.zeros((len(actors), sensed.shape[1]), np.int64)
        returns[known] = sensed[order[place[known]]]
        return returns


def _all_arrived(driven: Iterable[AgentFrame]) -> bool:
    """Return whether there are driven cars, and all have reached their goals."""
    cars = [agent.car for agent in driven]
    return bool(cars) and all(car is not None and car.route.arrived for car in cars)


def _acceleration(command: Command | None) -> float:
    """Return the acceleration that was asked for, m/s²; NaN: none was."""
    return math.nan if command is None else acceleration_of(command)


class SceneProbe(FrameProbe):
    """Measurements of a simulated frame; its triangles are made when first asked for. Unsensed, it has no readings."""

    def __init__(
        self,
        equipment: Equipment,
        scene: Callable[[], RayScene],
        actors: Actors,
        bodies: Mapping[str, AgentBody],
        readings: Mapping[str, LidarReading],
    ) -> None:
        self._equipment, self._scene, self._actors, self._bodies = equipment, scene, actors, bodies
        self._readings = readings

    def photograph(self) -> Mapping[str, Mapping[str, CameraImage]]:
        """Return images by every agent's cameras; see `FrameProbe.photograph`."""
        return self._equipment.rig.render(self._scene().triangles, self._actors, self._bodies)

    def visibility(self) -> Mapping[str, Visibility]:
        """Follow the LiDARs' rays through everything; see `FrameProbe.visibility`."""
        probes = self._equipment.visibility_probes
        return {
            name: probes[self._bodies[name].kind].measure(
                self._scene(), self._bodies[name], self._actors, reading.returns
            )
            for name, reading in self._readings.items()
            if reading.sweeps
        }

    def pixel_visibility(self) -> Mapping[str, PixelVisibility]:
        """Follow the cameras' rays through everything; see `FrameProbe.pixel_visibility`."""
        if not self._readings or not self._equipment.images_tell_actors:
            return {}
        return {
            name: measure_pixels(cameras, self._scene(), self._bodies[name], self._actors)
            for name, cameras in self._equipment.cameras.items()
            if cameras
        }
