"""Options of simulated environments as a frozen dataclass, and the option `lidar` in its several forms."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any, Literal

from coopsim.comms.codecs.dsrc import require_dsrc
from coopsim.config.load import has_parameters, load
from coopsim.detection.presets import DEFAULT_DETECTOR
from coopsim.envs.options import PerceptionOptions
from coopsim.envs.simulated.planned_driving import require_planner
from coopsim.errors import InvalidValueError
from coopsim.interfaces.planner import PlannerOption
from coopsim.localization.localizer import LocalizationConfig
from coopsim.sensors import FARTHEST_M
from coopsim.sensors.camera.camera import RigOption, check_rig
from coopsim.sensors.camera.daylight import Daylight, Illumination, as_daylight
from coopsim.sensors.camera.picture import require_modes
from coopsim.sensors.camera.renderers import RENDERERS
from coopsim.sensors.lidar.lidar import MOST_COLUMNS, LidarConfig
from coopsim.sensors.lidar.patterns import PATTERNS, SUFFIXES, BeamPattern
from coopsim.sensors.weather import Weather, as_weather
from coopsim.support.checks import (
    require_between,
    require_choice,
    require_count,
    require_flag,
    require_frame_time,
    require_number,
)
from coopsim.types.messages import AGENT_KINDS
from coopsim.types.sensing import OBSERVED_MODES
from coopsim.world.drawn_places import LIVE_TRAFFIC, is_live
from coopsim.world.recording.episode_file import require_recording
from coopsim.world.scenario import DETAILS
from coopsim.world.traffic.navigation import ROUTE_M, checked_route
from coopsim.world.traffic.steered import DRY, WET
from coopsim.world.traffic.traffic import ENGINES

OneLidar = str | BeamPattern | LidarConfig
LidarOption = OneLidar | Mapping[str, OneLidar | Mapping[str, Any]] | Mapping[str, Any] | None

CONTROLS = ("traffic", "policy", "acceleration", "steering", "planner")
"""Drivers of connected cars."""

LIDAR = "lidar"
"""Name of the only LiDAR."""


def lidar_configs(lidar: LidarOption, columns: int, range_m: float) -> dict[str, LidarConfig]:
    """Return the LiDARs of each agent, by name; no LiDAR for None.

    Args:
        lidar: a beam table, by name (see `coopsim.sensors.lidar.patterns`), path or as an object; a `LidarConfig`, or a
            mapping of its fields; or several of these by name (not a name like that of a field): `{"roof": "OS1-128",
            "bumper": LidarConfig("VLP-16", x_m=2.9, above_m=-0.9)}`.
        columns: firings per turn, of beam tables.
        range_m: farthest return, of beam tables.

    Raises:
        UnknownNameError: there is no beam table, or no field, of this name.
        InvalidValueError: a value is not accepted.
    """
    usual = LidarConfig()
    require_count(1, MOST_COLUMNS, lidar_columns=columns)
    accepted = f"> {usual.min_range_m:g} and <= {FARTHEST_M:g}"
    require_number(accepted, lambda far: usual.min_range_m < far <= FARTHEST_M, lidar_range_m=range_m)
    if lidar is None:
        return {}
    if not isinstance(lidar, Mapping) or _has_fields(lidar):
        named = {LIDAR: _lidar(lidar, "lidar", ", a mapping of its fields, a dict of these by name, or None")}
    elif not lidar:
        raise InvalidValueError("lidar must name at least one LiDAR, or be None for none; got an empty dict")
    else:
        named = {name: _lidar(one, f"lidar {name!r}", " or a mapping of its fields") for name, one in lidar.items()}
    for name, one in named.items():
        if not (isinstance(name, str) and name):
            raise InvalidValueError(f"lidar must have a name for each, got {name!r}")
        if isinstance(one, LidarConfig) and (columns, range_m) != (usual.columns, usual.max_range_m):
            option = "lidar_range_m" if columns == usual.columns else "lidar_columns"
            raise InvalidValueError(f"{option} must be left out where lidar is a LidarConfig, which has its own")
    return {
        name: one if isinstance(one, LidarConfig) else LidarConfig(one, columns=columns, max_range_m=range_m)
        for name, one in named.items()
    }


def lidar_carriers(lidar_agents: Iterable[str] | None, kinds: Mapping[str, str]) -> frozenset[str]:
    """Return the names of the agents that carry the LiDARs.

    Args:
        lidar_agents: names of agents, or kinds of them; None: all agents.
        kinds: "cav", "rsu" or "drone", by agent.

    Raises:
        UnknownNameError: no agent or kind is called that.
        InvalidValueError: there is no agent of these kinds.
    """
    if lidar_agents is None:
        return frozenset(kinds)
    wanted = tuple(lidar_agents)
    for name in wanted:
        require_choice("agent in lidar_agents", name, (*kinds, *AGENT_KINDS))
    carriers = frozenset(agent for agent, kind in kinds.items() if agent in wanted or kind in wanted)
    if not carriers:
        raise InvalidValueError(
            f"lidar_agents must name some of the agents ({', '.join(kinds)}) or of their kinds, got {list(wanted)}; "
            "lidar=None is for no LiDAR at all"
        )
    return carriers


def checked_lidar_agents(lidar_agents: object, lidar: object) -> tuple[str, ...] | None:
    """Return the option `lidar_agents` as names, which the environment looks up later.

    Raises:
        InvalidValueError: it is not a name or a list of names, or there are no LiDARs.
    """
    if lidar_agents is None:
        return None
    names = (lidar_agents,) if isinstance(lidar_agents, str) else lidar_agents
    if not (isinstance(names, (list, tuple)) and names and all(isinstance(name, str) for name in names)):
        raise InvalidValueError(
            f"lidar_agents must be names of agents, or of {', '.join(AGENT_KINDS)}, or None for all; "
            f"got {lidar_agents!r}"
        )
    if lidar is None:
        raise InvalidValueError("lidar_agents must be left out where lidar is None: there are no LiDARs to carry")
    return tuple(names)


def _has_fields(lidar: Mapping[str, Any]) -> bool:
    """Return whether the keys are fields of a `LidarConfig`, misspelt ones included, and not names of LiDARs.

    A LiDAR may be called "above", almost as the field `above_m`: its value tells them apart.
    """
    if any(field.name in lidar for field in fields(LidarConfig)):
        return True
    named = any(isinstance(one, (LidarConfig, BeamPattern, Mapping)) for one in lidar.values())
    return not named and has_parameters(LidarConfig, lidar)


def _lidar(given: Any, what: str, more: str) -> OneLidar:
    """Return one LiDAR, made of its mapping; `more` says what else is accepted, for the error."""
    lidar: OneLidar = load(LidarConfig, given, what) if isinstance(given, Mapping) else given
    if not isinstance(lidar, (str, BeamPattern, LidarConfig)):
        raise InvalidValueError(f"{what} must be a beam table, its name or path, a LidarConfig{more}; got {lidar!r}")
    if isinstance(lidar, str) and not lidar.lower().endswith(SUFFIXES):
        require_choice(what, lidar, PATTERNS)
    return lidar


@dataclass(frozen=True, slots=True)
class SimulationOptions(PerceptionOptions):
    """Options of a simulated environment (next to its scenario's own numbers).

    Attributes:
        max_cycles: steps until the episode is truncated.
        dt_s: time between two frames, in [1e-06, 3600]. Traffic is stepped in tenths of a second at most, so large
            values work, and make frames that differ (1 s apart, say) for training.
        sense_every: sensors, cameras and detector run in every n-th frame only, beginning with the first. In the other
            frames there are no points, images or detections, and nothing is sent; poses, arriving messages, truth and
            scores go on, and the objects that count are those that were visible when last sensed.
        detail: "plain" (roads, buildings, a few shapes of actors), "full" (street furniture and plants, which hide what
            is behind them, and varied actors), "street" (also the surroundings of real streets, and people and vehicles
            at rest), or None: "full" in towns and in files with the key `furniture`, "plain" elsewhere.
        lidar: each agent's LiDARs, see `lidar_configs`: name, path or object of a beam table; a `LidarConfig` or its
            mapping; several of these by name; or None, for no rays: simulated detectors are then given the number of
            returns to expect (see `coopsim.sensors.lidar.expected_returns`).
        lidar_agents: the agents that carry them, by name or kind ("cav", "rsu", "drone"); None: all. The others have no
            sweeps; simulated detectors and the truth take the returns that the first LiDAR is expected to have on them.
        drone_pitch_rad: angle by which a drone's LiDARs look down, in [0, pi / 2], in addition to their own pitch.
        lidar_columns: firings per revolution; not with a `LidarConfig`, which has its own.
        lidar_range_m: farthest return; the nearest is at 1 m. Not with a `LidarConfig`, either.
        weather: rain, fog and wet surfaces, for the LiDARs and cameras: a `Weather`, its mapping, or the name of one;
            None is dry and clear.
        threads: number of threads that share the agents' sweeps (not embree's); they change nothing but the time.
        time_of_day: "day", "dusk" or "night", or a custom `Daylight`: the light for cameras.
        cameras: each agent's cameras: False, the name of a rig ("front", "surround", "surround_6"; True is "surround"),
            a list of `Camera` objects, or one of these by agent or kind of agent. A policy states its needs.
        camera_modes: modes of images: "rgb", "depth", "instance", "semantic". The last two are truth, which
            goes into `infos` and needs `expose_ground_truth`.
        renderer: "auto" (OpenGL if it works, else ray casting), "opengl", "raycast" or "pyrender" (the reference).
        position_noise_m: standard deviation of the global position, x and y.
        heading_noise_rad: standard deviation of the global heading.
        odometry_noise_m: standard deviation of the motion in a frame, x and y.
        odometry_heading_noise_rad: standard deviation of the turn in a frame.
        localization: overrides the four options above: a `LocalizationConfig` for all agents (without errors of the
            pose it leaves the first two), or one by agent (the four options hold for agents without one); or a mapping
            of either, or the path of a YAML file with that.
        detector: a `Detector` or `OracleDetector`, or the name of one ("none" never detects anything); None is
            `DEFAULT_DETECTOR`.
        embedder: an `Embedder`, or the name of one, that gives every detection an appearance; None: the detector's own.
        traffic: "arrays" (fast), "highway-env" (the same models, stepped by highway-env's own objects), or another
            program, such as "sumo": one of `coopsim.world.drawn_places.LIVE_TRAFFIC`.
        control: driver of connected cars: "traffic" (the traffic model), "policy" (the action's `maneuver`),
            "acceleration" (the action's `acceleration_m_s2`), "steering" (the action's `steering`: an acceleration and
            an angle of the front wheels) or "planner" (the option `planner`, by reported tracks).
        planner: a planner by name, also with parameters, such as "idm_aeb(headway_s=2)", or a class of them.
        route_m: bounds of the distance along the lanes from a steered car's start to its goal.
        grip: coefficient of friction of steered cars' tyres, in [0.05, 1.5]; None: `coopsim.world.traffic.steered.DRY`,
            and towards `WET` by the weather's wetness. Hard-packed snow has 0.2, ice 0.1.
        driven_agents: names of the connected cars that `control` is about; the traffic model drives the others. None:
            all of them.
        ends_on_crash: the episode terminates when one of these cars crashes.
        ends_on_arrival: the episode terminates when all of these cars have reached their goals; rails have none.
        ground_truth: the objects that count: "visible" (hit by some agent's LiDAR) or "all".
        region_x_m: objects within this distance ahead of and behind the agent count.
        region_y_m: objects within this distance to its left and right count.
        signal_messages: roadside units broadcast the lights of junctions within 50 m of them (SPATEM and MAPEM, with
            the extra `etsi`), and all agents hear them: see `coopsim.comms.ReceivedLights`.
        record: file for every frame's world; each `reset` begins it anew.
        playback: such a file, whose world replaces simulated traffic. The population, `dt_s` and (unless fewer are
            asked for) `max_cycles` are then the recording's.
    """

    max_cycles: int = 200
    dt_s: float = 0.1
    sense_every: int = 1
    detail: Literal["plain", "full", "street"] | None = None
    lidar: LidarOption = "HDL-32E"
    lidar_agents: Sequence[str] | None = None
    drone_pitch_rad: float = math.pi / 4
    lidar_columns: int = LidarConfig().columns
    lidar_range_m: float = LidarConfig().max_range_m
    weather: Weather | Mapping[str, Any] | str | None = None
    threads: int = 2
    time_of_day: str | Daylight = "day"
    cameras: RigOption = False
    camera_modes: Sequence[str] = OBSERVED_MODES
    renderer: Literal["auto", "opengl", "raycast", "pyrender"] = "auto"
    odometry_noise_m: float = LocalizationConfig().odometry_noise_m
    odometry_heading_noise_rad: float = LocalizationConfig().odometry_heading_noise_rad
    traffic: str = "arrays"
    control: Literal["traffic", "policy", "acceleration", "steering", "planner"] = "traffic"
    planner: PlannerOption = "idm_aeb"
    route_m: tuple[float, float] = ROUTE_M
    grip: float | None = None
    driven_agents: Sequence[str] | None = None
    ends_on_crash: bool = False
    ends_on_arrival: bool = False
    ground_truth: Literal["visible", "all"] = "visible"
    signal_messages: bool = False
    record: str | Path | None = None
    playback: str | Path | None = None

    def __post_init__(self) -> None:
        if self.detail is not None:
            require_choice("detail", self.detail, DETAILS)
        if not is_live(self.traffic):
            require_choice("traffic", self.traffic, (*ENGINES, *LIVE_TRAFFIC))
        self._check_control()
        self.check_scored()
        require_choice("renderer", self.renderer, RENDERERS)
        require_frame_time(self.dt_s)
        require_between(0, math.pi / 2, drone_pitch_rad=self.drone_pitch_rad)
        require_count(1, max_cycles=self.max_cycles, threads=self.threads, sense_every=self.sense_every)
        check_rig(self.cameras)
        require_modes(self.camera_modes)
        require_flag(signal_messages=self.signal_messages)
        if self.signal_messages:
            require_choice("traffic with signal_messages, which tell the place's own programs", self.traffic, ENGINES)
            require_dsrc()
        object.__setattr__(self, "weather", as_weather(self.weather))
        self._check_files()
        lidars = self.lidars
        object.__setattr__(self, "lidar_agents", checked_lidar_agents(self.lidar_agents, self.lidar))
        self.illumination  # noqa: B018  (its own checks run now)
        self.check_perception(DEFAULT_DETECTOR, lidar=bool(lidars), cameras=bool(self.cameras))

    def _check_control(self) -> None:
        require_choice("control", self.control, CONTROLS)
        require_flag(ends_on_crash=self.ends_on_crash, ends_on_arrival=self.ends_on_arrival)
        if self.traffic == "highway-env" and self.control in ("acceleration", "steering", "planner"):
            raise InvalidValueError(f'control="{self.control}" needs traffic="arrays", got traffic="highway-env"')
        if self.control == "planner":
            require_planner(self.planner)
        object.__setattr__(self, "route_m", checked_route(self.route_m))
        if self.grip is not None:
            require_between(0.05, 1.5, grip=self.grip)
        driven = self.driven_agents
        if driven is not None:
            listed = isinstance(driven, Sequence) and not isinstance(driven, str) and len(driven)
            if not (listed and all(isinstance(name, str) for name in driven)):
                accepted = "names of connected cars, or None for all"
                raise InvalidValueError(f"driven_agents must be {accepted}, got {driven!r}")
            object.__setattr__(self, "driven_agents", tuple(driven))
        given = {
            "driven_agents": driven is not None,
            "ends_on_crash": self.ends_on_crash,
            "ends_on_arrival": self.ends_on_arrival,
        }
        if self.control == "traffic" and any(given.values()):
            name = next(name for name, is_given in given.items() if is_given)
            others = ", ".join(CONTROLS[1:])
            raise InvalidValueError(f"{name} needs cars that agents drive: accepted with control = {others}")

    def _check_files(self) -> None:
        for name in ("record", "playback"):
            path = getattr(self, name)
            if not (path is None or isinstance(path, (str, Path))):
                raise InvalidValueError(f"{name} must be the path of a file or None, got {path!r}")
        if self.record is not None:
            require_recording(Path(self.record))
        if self.record is not None and self.playback is not None:
            raise InvalidValueError("record and playback exclude each other: a played episode is recorded already")
        if self.playback is not None and self.control != "traffic":
            raise InvalidValueError(
                f'control="{self.control}" cannot be played back: a recording\'s cars have driven already; '
                'accepted: control="traffic"'
            )

    @property
    def world_control(self) -> str:
        """The control of the world: a planner that steers commands as an action that does."""
        return "steering" if self.control == "planner" and require_planner(self.planner) else self.control

    @property
    def chosen_grip(self) -> float:
        """The coefficient of friction of tyres."""
        if self.grip is not None:
            return self.grip
        return DRY if self.chosen_weather is None else DRY + (WET - DRY) * self.chosen_weather.wetness

    @property
    def lidars(self) -> dict[str, LidarConfig]:
        """The LiDARs of agents on the ground, by name."""
        return lidar_configs(self.lidar, self.lidar_columns, self.lidar_range_m)

    @property
    def drone_lidars(self) -> dict[str, LidarConfig]:
        """The LiDARs of drones, by name."""
        return {
            name: replace(config, pitch_rad=config.pitch_rad + self.drone_pitch_rad)
            for name, config in self.lidars.items()
        }

    @property
    def sweep_threads(self) -> int:
        """Number of threads that share the agents' sweeps."""
        # Embree's scene is made at the first cast into it, which two threads could begin at once.
        return 1 if any(config.backend == "embree" for config in self.lidars.values()) else self.threads

    @property
    def illumination(self) -> Illumination:
        """The light for cameras."""
        return Illumination(as_daylight(self.time_of_day), self.chosen_weather)

    @property
    def chosen_weather(self) -> Weather | None:
        """The weather as an object; None is dry and clear."""
        return self.weather if isinstance(self.weather, Weather) else None
