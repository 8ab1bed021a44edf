"""Options of every environment, as a frozen dataclass, and the sorting of keywords into such dataclasses."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from coopsim.comms.channel.channel_config import ChannelConfig, channel_config
from coopsim.comms.channel.latency import MOST_S, GaussianLatency
from coopsim.comms.channel.loss import BernoulliLoss
from coopsim.comms.uplinks.selection import SELECTIONS
from coopsim.comms.uplinks.uplink import MakeUplink
from coopsim.errors import InvalidValueError, UnknownNameError
from coopsim.support.checks import (
    require_between,
    require_choice,
    require_count,
    require_flag,
    require_number,
    require_probability,
    require_threshold,
)
from coopsim.support.rng import require_seed
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
        selection: which detections are sent first where not all fit: "need", "score" or "random", see
            `coopsim.comms.uplinks.selection`.
        match_iou: 3D IoU from which a track is on an object, in (0, 1].
        false_positives: "count", or "ignore" for comparison with tables that ignored them.
        expose_ground_truth: put the truth into `infos`, for training and export.
        expose_visibility: put there also how well each agent's LiDARs and cameras see every actor, which takes about
            twice the time of the rest of a step; needs `expose_ground_truth`.
        render_mode: None, "rgb_array" or "human".
        seed: of every episode for which `reset` is given no seed; None: a different one each time.
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
    match_iou: float = 0.25
    false_positives: Literal["count", "ignore"] = "count"
    expose_ground_truth: bool = False
    expose_visibility: bool = False
    render_mode: Literal["rgb_array", "human"] | None = None
    seed: int | None = None

    def __post_init__(self) -> None:
        require_choice("false_positives", self.false_positives, ("count", "ignore"))
        if self.render_mode is not None:
            require_choice("render_mode", self.render_mode, ("rgb_array", "human"))
        if self.seed is not None:
            require_seed(self.seed)
        require_threshold(match_iou=self.match_iou)
        require_flag(expose_ground_truth=self.expose_ground_truth, expose_visibility=self.expose_visibility)
        if self.expose_visibility and not self.expose_ground_truth:
            raise InvalidValueError("expose_visibility is part of the truth: it needs expose_ground_truth=True")
        require_choice("selection", self.selection, SELECTIONS.names())
        if self.budget_bytes is not None:
            require_count(1, budget_bytes=self.budget_bytes)
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
