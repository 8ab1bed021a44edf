"""Everything a user can set, as frozen dataclasses; keywords are sorted into them by name."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any, Literal

from coopsim.comms.channel.channel_config import ChannelConfig
from coopsim.comms.channel.channel_files import channel_config
from coopsim.comms.channel.latency import MOST_S, GaussianLatency
from coopsim.comms.channel.loss import BernoulliLoss
from coopsim.comms.uplinks.selection import SELECTIONS
from coopsim.config.mappings import make
from coopsim.detection.presets import make_detector
from coopsim.detection.simulated.simulated import Detector
from coopsim.envs.lidar_options import LidarOption, lidar_configs
from coopsim.errors import InvalidValueError, UnknownNameError
from coopsim.localization.localization_files import localization_config
from coopsim.localization.localizer import LocalizationConfig
from coopsim.localization.pose_noise import PoseNoise
from coopsim.sensors.camera.daylight import Daylight, Illumination, as_daylight
from coopsim.sensors.camera.picture import TRUTH_MODES, require_modes
from coopsim.sensors.camera.renderers.choice import RENDERERS
from coopsim.sensors.camera.rigs import RigOption, check_rig
from coopsim.sensors.lidar.lidar import LidarConfig
from coopsim.sensors.weather import Weather
from coopsim.support.checks import (
    require_between,
    require_choice,
    require_count,
    require_flag,
    require_frame_time,
    require_instance,
    require_number,
    require_positive,
    require_probability,
    require_threshold,
)
from coopsim.support.files import require_writable
from coopsim.support.rng import require_seed
from coopsim.types.sensing import OBSERVED_MODES

_CHANNEL_OPTIONS = ("latency_s", "latency_jitter_s", "loss", "communication_range_m")
_LOCALIZATION_OPTIONS = ("position_noise_m", "heading_noise_rad", "odometry_noise_m", "odometry_heading_noise_rad")


@dataclass(frozen=True, slots=True)
class CommonOptions:
    """What every environment has, simulated or replayed.

    Attributes:
        uplink: what agents broadcast: "detections", "tracks" or "none"; a policy states what it needs.
        codec: how what they broadcast is encoded: name of a codec for it (for detections "compact" or "cpm",
            see `docs/reference/codecs.md`); None: by the one with the uplink's name.
        latency_s: delay of every message, any value in [0, 3600].
        latency_jitter_s: standard deviation of the delay, in [0, 3600].
        loss: probability that a message is lost on a link, in [0, 1].
        communication_range_m: farther apart than this, nothing arrives.
        channel: a whole channel in the place of the four options above: a `ChannelConfig`, its mapping, or the path of
            a YAML file with that.
        budget_bytes: largest size of a message of detections, envelope included; None: no limit.
        selection: which objects are sent first where not all fit: "need", "score" or "random", see
            `coopsim.comms.uplinks.selection`.
        match_iou: 3D IoU from which a track is on an object, in (0, 1].
        false_positives: "count", or "ignore" to stand beside tables that ignored them.
        expose_ground_truth: put the truth into `infos`, for training and export.
        render_mode: None, "rgb_array" or "human".
        seed: of every episode for which `reset` is given none; None: another one each time.
    """

    uplink: str = "detections"
    codec: str | None = None
    latency_s: float = 0.0
    latency_jitter_s: float = 0.0
    loss: float = 0.0
    communication_range_m: float = 300.0
    channel: ChannelConfig | Mapping[str, Any] | str | Path | None = None
    budget_bytes: int | None = None
    selection: str = "need"
    match_iou: float = 0.25
    false_positives: Literal["count", "ignore"] = "count"
    expose_ground_truth: bool = False
    render_mode: Literal["rgb_array", "human"] | None = None
    seed: int | None = None

    def __post_init__(self) -> None:
        require_choice("false_positives", self.false_positives, ("count", "ignore"))
        if self.render_mode is not None:
            require_choice("render_mode", self.render_mode, ("rgb_array", "human"))
        if self.seed is not None:
            require_seed(self.seed)
        require_threshold(match_iou=self.match_iou)
        require_flag(expose_ground_truth=self.expose_ground_truth)
        require_choice("selection", self.selection, SELECTIONS.names())
        if self.budget_bytes is not None:
            require_count(1, budget_bytes=self.budget_bytes)
        if self.channel is not None:
            _refuse_beside(self, _CHANNEL_OPTIONS, "channel")
            object.__setattr__(self, "channel", channel_config(self.channel))
        require_between(0, MOST_S, latency_s=self.latency_s, latency_jitter_s=self.latency_jitter_s)
        require_probability(loss=self.loss)
        require_number(">= 0 (inf: no limit)", lambda far: far >= 0, communication_range_m=self.communication_range_m)

    @property
    def channel_config(self) -> ChannelConfig:
        """The channel's part."""
        if isinstance(self.channel, ChannelConfig):
            return self.channel
        latency = GaussianLatency(self.latency_s, self.latency_jitter_s)
        return ChannelConfig(latency, BernoulliLoss(self.loss), self.communication_range_m)


@dataclass(frozen=True, slots=True)
class SimulationOptions:
    """What only a simulated environment has (next to its scenario's own numbers).

    Attributes:
        max_cycles: steps until the episode is truncated.
        dt_s: time between two frames, in [1e-06, 3600].
        lidar: each agent's LiDARs, see `lidar_configs`: name, path or object of a beam table; a `LidarConfig` or its
            mapping; several of these by name; or None, for a detector that is told how many returns it would have (see
            `coopsim.sensors.lidar.expected_returns`).
        drone_pitch_rad: how far a drone's LiDARs look down, in [0, pi / 2], next to their own pitch.
        lidar_columns: firings per turn; not beside a `LidarConfig`, which says so itself.
        lidar_range_m: farthest return; the nearest is at 1 m. Not beside a `LidarConfig`, either.
        weather: rain, fog and wet surfaces, for the LiDARs and cameras: a `Weather` or its mapping; None is dry and
            clear.
        threads: that share the agents' sweeps (not embree's); they change nothing but the time.
        time_of_day: "day", "dusk" or "night", or a `Daylight` of one's own; cameras see by it.
        cameras: each agent's cameras: False, the name of a rig ("front", "surround", "surround_6"; True is "surround"),
            a list of `Camera` objects, or one of these by agent. A policy states what it needs.
        camera_modes: what pictures consist of: "rgb", "depth", "instance", "semantic". The last two are truth, which
            goes into `infos` and needs `expose_ground_truth`.
        renderer: "auto" (OpenGL if it works, else ray casting), "opengl", "raycast" or "pyrender" (the reference).
        position_noise_m: standard deviation of the global position, x and y.
        heading_noise_rad: standard deviation of the global heading.
        odometry_noise_m: of the motion in a frame, x and y.
        odometry_heading_noise_rad: of the turn in a frame.
        localization: in the place of the four options above: a `LocalizationConfig` for all agents, or one by agent
            (whoever is not named has what the four options say); or a mapping of either, or the path of a YAML file
            with that.
        detector: the detector, or the name of one ("simulated", "pointpillars_v2v4real"); None is
            `SimulatedDetector()`.
        traffic: "arrays" (fast), or "highway-env" (the same models, stepped by highway-env's own objects).
        control: "traffic" (the traffic model drives) or "policy" (the action's `maneuver` drives).
        ground_truth: "visible" (objects that some agent's LiDAR hits count) or "all".
        region_x_m: objects within this distance ahead of and behind the agent count.
        region_y_m: objects within this distance to its left and right count.
        record: file to which every frame's world goes; each `reset` begins it anew.
        playback: such a file, whose world takes the place of simulated traffic. The population, `dt_s` and (unless
            fewer are asked for) `max_cycles` are then the recording's.
    """

    max_cycles: int = 200
    dt_s: float = 0.1
    lidar: LidarOption = "HDL-32E"
    drone_pitch_rad: float = math.pi / 4
    lidar_columns: int = LidarConfig().columns
    lidar_range_m: float = LidarConfig().max_range_m
    weather: Weather | Mapping[str, Any] | None = None
    threads: int = 2
    time_of_day: str | Daylight = "day"
    cameras: RigOption = False
    camera_modes: Sequence[str] = OBSERVED_MODES
    renderer: Literal["auto", "opengl", "raycast", "pyrender"] = "auto"
    position_noise_m: float = 0.0
    heading_noise_rad: float = 0.0
    odometry_noise_m: float = LocalizationConfig().odometry_noise_m
    odometry_heading_noise_rad: float = LocalizationConfig().odometry_heading_noise_rad
    localization: LocalizationConfig | Mapping[str, Any] | str | Path | None = None
    detector: Detector | str | None = None
    traffic: Literal["arrays", "highway-env"] = "arrays"
    control: Literal["traffic", "policy"] = "traffic"
    ground_truth: Literal["visible", "all"] = "visible"
    region_x_m: float = 100.0
    region_y_m: float = 40.0
    record: str | Path | None = None
    playback: str | Path | None = None

    def __post_init__(self) -> None:
        require_choice("traffic", self.traffic, ("arrays", "highway-env"))
        require_choice("control", self.control, ("traffic", "policy"))
        require_choice("ground_truth", self.ground_truth, ("visible", "all"))
        require_choice("renderer", self.renderer, RENDERERS)
        require_frame_time(self.dt_s)
        require_positive(region_x_m=self.region_x_m, region_y_m=self.region_y_m)
        require_between(0, math.pi / 2, drone_pitch_rad=self.drone_pitch_rad)
        require_count(1, max_cycles=self.max_cycles, threads=self.threads)
        check_rig(self.cameras)
        require_modes(self.camera_modes)
        if isinstance(self.detector, str):
            object.__setattr__(self, "detector", make_detector(self.detector))
        require_instance(Detector, detector=self.detector)
        if isinstance(self.weather, Mapping):
            object.__setattr__(self, "weather", make("weather", Weather, self.weather))
        if not (self.weather is None or isinstance(self.weather, Weather)):
            accepted = "a Weather, a mapping of its fields, or None"
            raise InvalidValueError(f"weather must be {accepted}, got {self.weather!r}")
        self._check_files()
        lidars = self.lidars
        self.illumination  # noqa: B018  (its own checks run now)
        self._check_localization()
        if not lidars and self.chosen_detector is not None and self.chosen_detector.needs_sweeps:
            raise InvalidValueError(f"detector must need no sweeps where lidar is None, got {self.detector!r}")

    def _check_files(self) -> None:
        for name in ("record", "playback"):
            path = getattr(self, name)
            if not (path is None or isinstance(path, (str, Path))):
                raise InvalidValueError(f"{name} must be the path of a file or None, got {path!r}")
        if self.record is not None:
            require_writable(Path(self.record))
        if self.record is not None and self.playback is not None:
            raise InvalidValueError("record and playback exclude each other: what is played back is recorded already")
        if self.playback is not None and self.control == "policy":
            raise InvalidValueError(
                'control="policy" cannot be played back: a recording\'s cars have driven already; '
                'accepted: control="traffic"'
            )

    @property
    def lidars(self) -> dict[str, LidarConfig]:
        """The LiDARs' part, by name."""
        return lidar_configs(self.lidar, self.lidar_columns, self.lidar_range_m)

    @property
    def drone_lidars(self) -> dict[str, LidarConfig]:
        """The same on a drone."""
        return {
            name: replace(config, pitch_rad=config.pitch_rad + self.drone_pitch_rad)
            for name, config in self.lidars.items()
        }

    @property
    def chosen_detector(self) -> Detector | None:
        """The detector itself, where a name may have been given."""
        return self.detector if isinstance(self.detector, Detector) else None

    @property
    def illumination(self) -> Illumination:
        """What cameras see by."""
        return Illumination(as_daylight(self.time_of_day), self.chosen_weather)

    @property
    def chosen_weather(self) -> Weather | None:
        """The weather itself, where a mapping may have been given."""
        return self.weather if isinstance(self.weather, Weather) else None

    def localization_of(self, agent: str) -> LocalizationConfig:
        """An agent's localization."""
        if isinstance(self.localization, LocalizationConfig):
            return self.localization
        if isinstance(self.localization, Mapping) and agent in self.localization:
            config: LocalizationConfig = self.localization[agent]
            return config
        return LocalizationConfig(
            PoseNoise(self.position_noise_m, self.heading_noise_rad),
            self.odometry_noise_m,
            self.odometry_heading_noise_rad,
        )

    def _check_localization(self) -> None:
        if self.localization is not None:
            object.__setattr__(self, "localization", localization_config(self.localization))
            if isinstance(self.localization, LocalizationConfig):
                _refuse_beside(self, _LOCALIZATION_OPTIONS, "localization")
        self.localization_of("")  # its own checks run now, not at the first episode


def _refuse_beside(options: object, names: Iterable[str], whole: str) -> None:
    """Raise `InvalidValueError` if any of these fields is set beside the one that stands in their place."""
    defaults = {field.name: field.default for field in fields(options)}  # type: ignore[arg-type]
    for name in names:
        if getattr(options, name) != defaults[name]:
            raise InvalidValueError(f"{name} is not an option beside {whole}, which says so itself")


def require_truth_exposed(modes: Sequence[str], *, exposed: bool) -> None:
    """Truth goes into `infos`, and only where it was asked for.

    Raises:
        InvalidValueError: a mode of `camera_modes` is truth, and truth is not exposed.
    """
    truth = [mode for mode in modes if mode in TRUTH_MODES]
    if truth and not exposed:
        raise InvalidValueError(
            f"camera_modes {', '.join(map(repr, truth))} are ground truth, which no observation has: they stand in "
            "infos[agent]['segmentation'] if the environment is made with expose_ground_truth=True"
        )


def sort_options(options: Mapping[str, Any], *groups: type[Any], beside: Iterable[str] = ()) -> list[dict[str, Any]]:
    """Sort keywords by the dataclass that has a field of that name; one dict per group, in order.

    Args:
        options: keywords as the user gave them.
        *groups: dataclasses with distinct field names.
        beside: what else the user could have given, for the message.

    Raises:
        UnknownNameError: a keyword belongs to none of them.
    """
    names = [[field.name for field in fields(group)] for group in groups]
    known = {name for group in names for name in group}
    for name in options:
        if name not in known:
            raise UnknownNameError("option", name, known.union(beside))
    return [{name: options[name] for name in group if name in options} for group in names]
