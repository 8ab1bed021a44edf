"""Options that environments share, as frozen dataclasses, and the sorting of keywords into them."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from coopsim.comms.channel.channel_config import ChannelConfig, channel_config
from coopsim.comms.channel.latency import MOST_S, GaussianLatency
from coopsim.comms.channel.loss import BernoulliLoss
from coopsim.comms.uplinks.budget import make_selection
from coopsim.comms.uplinks.uplink import MakeUplink
from coopsim.detection.detector import Detector, DetectorBase
from coopsim.detection.embedder import Embedder, make_embedder
from coopsim.detection.oracle import OracleDetector
from coopsim.detection.presets import make_detector
from coopsim.errors import InvalidValueError, UnknownNameError
from coopsim.interfaces.attack_option import AttacksOption, attacks_by_agent
from coopsim.localization.localizer import LocalizationConfig, localization_config
from coopsim.localization.pose_noise import PoseNoise
from coopsim.support.checks import (
    require_between,
    require_choice,
    require_count,
    require_flag,
    require_instance,
    require_number,
    require_positive,
    require_probability,
    require_threshold,
)
from coopsim.support.rng import require_seed, stream
from coopsim.types.sensing import TRUTH_MODES

if TYPE_CHECKING:
    from coopsim.agents.policy import Policy


_CHANNEL_OPTIONS = ("latency_s", "latency_jitter_s", "loss", "communication_range_m")


@dataclass(frozen=True, slots=True)
class CommonOptions:
    """Options of every environment, simulated or replayed.

    Attributes:
        uplink: content of broadcasts: a name with or without parameters ("detections", "tracks", "points(keep=0.5)",
            "none"), a policy (its `make_uplink` is asked), or a factory that returns the `Uplink` of an agent for its
            spec and a random stream. `coopsim.evaluate` passes the policy.
        codec: the codec of broadcasts, as "compact" or "points(number=float16)", see
            `docs/reference/codecs.md`; None: the uplink's own choice.
        latency_s: delay of every message, any value in [0, 3600].
        latency_jitter_s: standard deviation of the delay, in [0, 3600].
        loss: probability that a message is lost on a link, in [0, 1].
        communication_range_m: largest distance between sender and receiver at which messages arrive.
        channel: a whole channel, which replaces the four options above: a `ChannelConfig`, its mapping, or the path of
            a YAML file with that.
        budget_bytes: largest size of a message, envelope included; None: no limit. The uplink's codec must be able to
            leave out the least useful part.
        selection: order in which detections are sent where not all fit: "need", "score", "random" or
            "learned(weights=FILE)", see `coopsim.comms.uplinks.budget`.
        attacks: lies of agents: a mapping of agents to attacks, one or more each, as `{"cav_1": "ghost(ahead_m=9)"}`,
            or the text of that, as "cav_1=ghost(ahead_m=9) + rsu_0=remove". None: all are honest.
        match_iou: 3D IoU from which a track is on an object, in (0, 1].
        false_positives: "count", or "ignore" for comparison with tables that ignored them.
        expose_ground_truth: put the truth into `infos`, for training and export.
        expose_visibility: put there also how well each agent's LiDARs and cameras see every actor, which takes about
            twice the time of the rest of a step; needs `expose_ground_truth`.
        render_mode: None, "rgb_array" or "human".
        render_tracks: tracks in pictures: "own", those of the agent that they are about, or "all".
        seed: seed of every episode for which `reset` is given no seed; None: a different one each time.
    """

    uplink: str | Policy | MakeUplink = "detections"
    codec: str | None = None
    latency_s: float = 0.0
    latency_jitter_s: float = 0.0
    loss: float = 0.0
    communication_range_m: float = 300.0
    channel: ChannelConfig | Mapping[str, Any] | str | Path | None = None
    budget_bytes: int | None = None
    selection: str = "need"
    attacks: AttacksOption = None
    match_iou: float = 0.25
    false_positives: Literal["count", "ignore"] = "count"
    expose_ground_truth: bool = False
    expose_visibility: bool = False
    render_mode: Literal["rgb_array", "human"] | None = None
    render_tracks: Literal["own", "all"] = "own"
    seed: int | None = None

    def __post_init__(self) -> None:
        require_choice("false_positives", self.false_positives, ("count", "ignore"))
        if self.render_mode is not None:
            require_choice("render_mode", self.render_mode, ("rgb_array", "human"))
        require_choice("render_tracks", self.render_tracks, ("own", "all"))
        if self.seed is not None:
            require_seed(self.seed)
        require_threshold(match_iou=self.match_iou)
        require_flag(expose_ground_truth=self.expose_ground_truth, expose_visibility=self.expose_visibility)
        if self.expose_visibility and not self.expose_ground_truth:
            raise InvalidValueError("expose_visibility is part of the truth: it needs expose_ground_truth=True")
        make_selection(self.selection, stream(0, "selection"))  # refused now, not at the first episode
        if self.budget_bytes is not None:
            require_count(1, budget_bytes=self.budget_bytes)
        attacks_by_agent(self.attacks)  # its own checks run now
        if self.channel is not None:
            refuse_overridden(self, _CHANNEL_OPTIONS, "channel")
            object.__setattr__(self, "channel", channel_config(self.channel))
        require_between(0, MOST_S, latency_s=self.latency_s, latency_jitter_s=self.latency_jitter_s)
        require_probability(loss=self.loss)
        require_number(">= 0 (inf: no limit)", lambda far: far >= 0, communication_range_m=self.communication_range_m)

    @property
    def channel_config(self) -> ChannelConfig:
        """Configuration of the channel by these options."""
        if isinstance(self.channel, ChannelConfig):
            return self.channel
        latency = GaussianLatency(self.latency_s, self.latency_jitter_s)
        return ChannelConfig(latency, BernoulliLoss(self.loss), self.communication_range_m)


def refuse_overridden(options: object, names: Iterable[str], whole: str) -> None:
    """Raise `InvalidValueError` if any of these fields is set although `whole`, which replaces them, is given."""
    defaults = {field.name: field.default for field in fields(options)}  # type: ignore[arg-type]
    for name in names:
        if getattr(options, name) != defaults[name]:
            raise InvalidValueError(f"{name} cannot be combined with {whole}, which sets it")


def require_truth_exposed(modes: Sequence[str], *, exposed: bool) -> None:
    """Raise `InvalidValueError` if a mode of `camera_modes` is truth, and truth is not exposed."""
    truth = [mode for mode in modes if mode in TRUTH_MODES]
    if truth and not exposed:
        raise InvalidValueError(
            f"camera_modes {', '.join(map(repr, truth))} are ground truth, which no observation has: they stand in "
            "infos[agent]['segmentation'] if the environment is made with expose_ground_truth=True"
        )


def sort_options(
    options: Mapping[str, Any], *groups: type[Any], also_accepted: Iterable[str] = ()
) -> list[dict[str, Any]]:
    """Sort keywords by the dataclass that has a field of that name; one dict per group, in order.

    Args:
        options: keywords as the user gave them.
        *groups: dataclasses with distinct field names.
        also_accepted: further keywords of the user, for the message.

    Raises:
        UnknownNameError: a keyword belongs to none of them.
    """
    names = [[field.name for field in fields(group)] for group in groups]
    known = {name for group in names for name in group}
    for name in options:
        if name not in known:
            raise UnknownNameError("option", name, known.union(also_accepted))
    return [{name: options[name] for name in group if name in options} for group in names]


_POSE_OPTIONS = ("position_noise_m", "heading_noise_rad")
_ODOMETRY_OPTIONS = ("odometry_noise_m", "odometry_heading_noise_rad")


@dataclass(frozen=True, slots=True)
class PerceptionOptions:
    """Options of localization, detection and of what counts. A subclass calls `check_perception` when it is made.

    Attributes:
        detector: a `Detector` or `OracleDetector`, or the name of one; None is the subclass's own.
        embedder: an `Embedder`, or the name of one; None: the detector's own embeddings stay.
        position_noise_m: standard deviation of the error of estimated positions, x and y.
        heading_noise_rad: standard deviation of the error of headings.
        odometry_noise_m: standard deviation of the error of the motion in a frame, x and y.
        odometry_heading_noise_rad: standard deviation of the error of the turn in a frame.
        localization: overrides the four options above: a config, its mapping or file, or one by agent. A config for
            all agents that has no errors of the pose leaves the first two.
        ground_truth: the objects that count: "all", or the "visible" ones.
        region_x_m: objects within this distance ahead of and behind the agent count.
        region_y_m: objects within this distance to its left and right count.
    """

    detector: DetectorBase | str | None = None
    embedder: Embedder | str | None = None
    position_noise_m: float = 0.0
    heading_noise_rad: float = 0.0
    odometry_noise_m: float = 0.0
    odometry_heading_noise_rad: float = 0.0
    localization: LocalizationConfig | Mapping[str, Any] | str | Path | None = None
    ground_truth: Literal["visible", "all"] = "all"
    region_x_m: float = 100.0
    region_y_m: float = 40.0

    @property
    def region_m(self) -> tuple[float, float]:
        """Half the length and width of the evaluation region."""
        return self.region_x_m, self.region_y_m

    @property
    def chosen_detector(self) -> DetectorBase:
        """The detector as an object."""
        assert isinstance(self.detector, DetectorBase)
        return self.detector

    @property
    def chosen_embedder(self) -> Embedder | None:
        """The embedder as an object; None: the detector's own embeddings stay."""
        return self.embedder if isinstance(self.embedder, Embedder) else None

    @property
    def embedding_dim(self) -> int:
        """Length of the embeddings of detections; 0: they have none."""
        return self.chosen_detector.embedding_dim if self.chosen_embedder is None else self.chosen_embedder.dim

    def localization_of(self, agent: str) -> LocalizationConfig:
        """Return an agent's localization: of recordings, the errors that are added to the recorded poses."""
        noise = PoseNoise(self.position_noise_m, self.heading_noise_rad)
        if isinstance(self.localization, LocalizationConfig):
            whole = self.localization
            return replace(whole, pose=noise) if whole.pose == PoseNoise() else whole
        if isinstance(self.localization, Mapping) and agent in self.localization:
            config: LocalizationConfig = self.localization[agent]
            return config
        return LocalizationConfig(noise, self.odometry_noise_m, self.odometry_heading_noise_rad)

    def check_scored(self) -> None:
        """Check which objects count.

        Raises:
            InvalidValueError: a value is not accepted.
        """
        require_choice("ground_truth", self.ground_truth, ("visible", "all"))
        require_positive(region_x_m=self.region_x_m, region_y_m=self.region_y_m)

    def check_perception(self, default: str, *, lidar: bool, cameras: bool) -> None:
        """Check localization, detector and embedder, and make the objects that are named.

        Args:
            default: name of the detector where none is given.
            lidar: agents have LiDARs.
            cameras: agents have cameras.

        Raises:
            InvalidValueError, UnknownNameError: a value is not accepted.
        """
        if self.localization is not None:
            object.__setattr__(self, "localization", localization_config(self.localization))
            if isinstance(self.localization, LocalizationConfig):
                refuse_overridden(self, _ODOMETRY_OPTIONS, "localization")
                if self.localization.pose != PoseNoise():
                    refuse_overridden(self, _POSE_OPTIONS, "localization")
        self.localization_of("")  # its own checks run now, not at the first episode
        detector = default if self.detector is None else self.detector
        if isinstance(detector, str):
            object.__setattr__(self, "detector", make_detector(detector))
        if isinstance(self.embedder, str):
            object.__setattr__(self, "embedder", make_embedder(self.embedder))
        if not isinstance(self.detector, OracleDetector):
            require_instance(Detector, detector=self.detector)
        require_instance(Embedder, embedder=self.embedder)
        self.chosen_detector.needs.require("detector", self.detector, lidar=lidar, cameras=cameras)
        if self.chosen_embedder is not None:
            self.chosen_embedder.needs.require("embedder", self.embedder, lidar=lidar, cameras=cameras)
