"""Cells and their results, as plain data. A cell is one policy in one condition with one seed."""

from __future__ import annotations

import math
import zlib
from collections.abc import Mapping, Sequence
from dataclasses import asdict, astuple, dataclass, field, replace
from functools import lru_cache
from typing import Any, ClassVar

import numpy as np

from coopsim.catalog import is_recordings_folder, is_scenario_file, scenario_file_options
from coopsim.config.load import read_mapping
from coopsim.errors import InvalidValueError
from coopsim.geometry.se3 import Floats
from coopsim.interfaces.attack_option import spell_attacks
from coopsim.support.checks import require_count, require_non_negative, require_number, require_probability
from coopsim.support.printable import require_printable


@dataclass(frozen=True, slots=True)
class Condition:
    """The disturbance of the agents; every policy in a condition meets the same traffic, noise and losses.

    Attributes:
        scenario: name of an environment, or path of a scenario file.
        latency_s: delay of every message.
        loss: probability that a message is lost on a link.
        position_noise_m: standard deviation of x and of y of the estimated pose.
        heading_noise_deg: standard deviation of its heading.
        bandwidth_bit_s: rate of the medium that all agents share; infinite: transmission takes no time.
        penetration: share of the other cars that are connected, for environments with that option; None: the
            environment's own.
        attacks: lies of agents, as the text of the environments' option `attacks`; empty: all are honest.
    """

    scenario: str = "crossing"
    latency_s: float = 0.0
    loss: float = 0.0
    position_noise_m: float = 0.0
    heading_noise_deg: float = 0.0
    bandwidth_bit_s: float = math.inf
    penetration: float | None = None
    attacks: str = ""

    def __post_init__(self) -> None:
        require_printable(environment=self.scenario, attacks=self.attacks)
        require_non_negative(
            latency_s=self.latency_s, position_noise_m=self.position_noise_m, heading_noise_deg=self.heading_noise_deg
        )
        require_probability(loss=self.loss)
        require_number("> 0 (inf: no limit)", lambda rate: rate > 0, bandwidth_bit_s=self.bandwidth_bit_s)
        if self.penetration is not None:
            require_probability(penetration=self.penetration)
        object.__setattr__(self, "attacks", spell_attacks(self.attacks))

    def __lt__(self, other: Condition) -> bool:
        return _order(self) < _order(other)

    def as_dict(self) -> dict[str, Any]:
        """Return the fields by name, without an unset penetration and without no attacks: keys are made from them."""
        found = asdict(self)
        if self.penetration is None:
            del found["penetration"]
        if not self.attacks:
            del found["attacks"]
        return found


def _order(condition: Condition) -> tuple[Any, ...]:
    """Return what conditions are sorted by: their fields, an unset penetration before all others."""
    *others, penetration, attacks = astuple(condition)
    return *others, -1.0 if penetration is None else penetration, attacks


@dataclass(frozen=True, slots=True, order=True)
class Cell:
    """Run of one policy in one condition with one seed.

    Attributes:
        policy: text of the policy (`PolicySpec.text`): a name, or a name with parameters,
            `late_fusion(delayed=replay)`.
        condition: the disturbance of the agents.
        seed: decides everything in the run.
        frames: length of the run; None: the episode's own, as in situations, which end by themselves.
    """

    policy: str
    condition: Condition
    seed: int = 0
    frames: int | None = 100

    def __post_init__(self) -> None:
        require_printable(policy=self.policy)
        require_count(0, seed=self.seed)
        if self.frames is not None:
            require_count(1, frames=self.frames)


@dataclass(frozen=True, slots=True, eq=False)
class CellResult:
    """Result of a cell: only data that are the same in every run of it.

    Attributes:
        cell: the cell.
        values: mean over agents by metric (see `docs/reference/metrics.md`); empty for a failed cell.
        agents: values of each agent by metric.
        rewards: (F,) mean over agents, per frame.
        messages: number of messages sent, lost, ..., by the names of `ChannelCounts`.
        traceback: traceback of the exception that made the cell fail; None for a finished cell.
        place_seed: seed of the drawn place that the run was in; None: the place is not drawn, or unknown.
        counts: counters of the policy, by name (`Policy.counts`).
        method: the method of a paper, or part of one, that the policy is (`Policy.method`).
        arithmetic: arithmetic of networks in the run, see `coopsim.support.precision`; empty: unknown, or the cell
            failed.
        bound: the policy was told the truth: an upper bound, which does not compete (`Needs.truth`).
    """

    cell: Cell
    values: Mapping[str, float] = field(default_factory=dict)
    agents: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    rewards: Floats = field(default_factory=lambda: np.zeros(0))
    messages: Mapping[str, int] = field(default_factory=dict)
    traceback: str | None = None
    place_seed: int | None = None
    counts: Mapping[str, int] = field(default_factory=dict)
    method: str = ""
    arithmetic: str = ""
    bound: bool = False

    @property
    def failed(self) -> bool:
        """True for a failed cell, which has no values."""
        return self.traceback is not None

    @property
    def reason(self) -> str | None:
        """The traceback's last line; None for a finished cell."""
        return last_line(self.traceback)


def last_line(text: str | None) -> str | None:
    """Return the last line of a traceback; None without one."""
    return None if text is None else "".join(text.strip().splitlines()[-1:])


_ONE_THREAD = {"threads": 1}
"""Each cell runs on one core, as many at once as there are cores."""

_JITTER_AND_RANGE = {"latency_jitter_s": 0.0, "communication_range_m": 300.0}
"""Options that a whole channel overrides, and their defaults."""


def environment_options(cell: Cell, options: Mapping[str, Any]) -> dict[str, Any]:
    """Return keywords of `coopsim.evaluate`: the cell's condition and length, and the options of all cells.

    A `channel` among the options, a mapping or the path of a file, must have neither latency, loss nor rate: the
    condition sets them.

    Raises:
        InvalidValueError: an option is not accepted, or would override the condition.
    """
    condition = cell.condition
    made = {name: value for name, value in options.items() if name != "channel"}
    limited = math.isfinite(condition.bandwidth_bit_s)
    if limited or options.get("channel") is not None:
        made["channel"] = _channel(cell, options)
        on_air = {"latency_s": 0.0, "loss": 0.0, **_JITTER_AND_RANGE}  # overrides a scenario file, too
    else:
        on_air = {"latency_s": condition.latency_s, "loss": condition.loss}
    noise = {
        "position_noise_m": condition.position_noise_m,
        "heading_noise_rad": math.radians(condition.heading_noise_deg),
    }
    one_thread = {} if is_recordings_folder(condition.scenario) else _ONE_THREAD
    connected = {} if condition.penetration is None else {"penetration": condition.penetration}
    length = {} if cell.frames is None else {"max_cycles": cell.frames}
    lies = {"attacks": condition.attacks} if condition.attacks else {}
    return {**one_thread, **made, **on_air, **noise, **connected, **length, **lies}


def scenario_options(scenario: str) -> Mapping[str, Any]:
    """Return the options in a scenario's file; none for a scenario without a file."""
    return scenario_file_options(scenario) if is_scenario_file(scenario) else {}


def _channel(cell: Cell, options: Mapping[str, Any]) -> dict[str, Any]:
    """Return the channel: latency, loss and rate of the condition; else as in `options` or the scenario's file."""
    condition, given = cell.condition, read_mapping("channel", "None", options.get("channel") or {})
    medium = given.get("bandwidth") or {}
    for name in ("latency", "loss"):
        if name in given:
            raise InvalidValueError(f"channel must be without {name}, which is the grid's, got {given[name]!r}")
    if not isinstance(medium, Mapping) or "rate_bit_s" in medium:
        raise InvalidValueError(f"channel.bandwidth must be a mapping without rate_bit_s, the grid's, got {medium!r}")
    usual = {**_JITTER_AND_RANGE, **scenario_options(condition.scenario), **options}
    limited = math.isfinite(condition.bandwidth_bit_s)
    return {
        "range_m": usual["communication_range_m"],
        **given,
        "latency": {"model": "gaussian", "mean_s": condition.latency_s, "jitter_s": usual["latency_jitter_s"]},
        "loss": {"model": "bernoulli", "probability": condition.loss},
        "bandwidth": {**medium, "rate_bit_s": condition.bandwidth_bit_s} if limited else None,
    }


@dataclass(frozen=True, slots=True)
class Axis:
    """A number of a condition, with its labels.

    Attributes:
        field: name in `Condition`.
        scale: factor from the field's unit to the shown one.
        endless: text of an infinite value.
        less_harms: True where a smaller value disturbs more.
        along: axes that vary together with this one: each of their values belongs to one value of this.
        named: the values are names, in no order but that of their texts.
    """

    field: str
    name: str
    unit: str
    scale: float = 1.0
    endless: str = "no limit"
    less_harms: bool = False
    along: tuple[Axis, ...] = ()
    named: ClassVar[bool] = False

    @property
    def title(self) -> str:
        """The name, with the names of axes that vary along."""
        return " and ".join(axis.name for axis in (self, *self.along))

    @property
    def label(self) -> str:
        """The title with its unit, if it has one, for plots."""
        unit = f" ({self.unit})" if self.unit else ""
        return self.name + unit + "".join(f", with {axis.name}" for axis in self.along)

    def value(self, condition: Condition) -> float:
        """Return the condition's value in the shown unit."""
        found = getattr(condition, self.field)
        # 12 digits, because 0.07 * 100 is not 7.
        return math.inf if found is None else float(f"{found * self.scale:.12g}")

    def text(self, condition: Condition) -> str:
        """Format the condition's value with its unit, and those of axes that vary along."""
        return " and ".join(axis.own_text(condition) for axis in (self, *self.along))

    def own_text(self, condition: Condition) -> str:
        """Format the condition's value with its unit, without axes that vary along."""
        value = self.value(condition)
        return f"{value:g} {self.unit}" if math.isfinite(value) else self.endless

    def phrase(self, condition: Condition) -> str:
        """Return the title with the value, as "latency 300 ms"."""
        return f"{self.title} {self.text(condition)}"

    def harm(self, value: float) -> float:
        """Return a number that rises with the harm of a value."""
        return -value if self.less_harms else value


NOBODY_LIES = "nobody lies"
"""The condition in which all agents are honest, in words."""


@dataclass(frozen=True, slots=True)
class AttackAxis(Axis):
    """The attacks of a condition, which are no number: honest is 0, and each attack has a number of its own."""

    named: ClassVar[bool] = True

    def value(self, condition: Condition) -> float:
        if not condition.attacks:
            return 0.0
        return 1.0 + zlib.crc32(condition.attacks.encode()) / 2**32

    def own_text(self, condition: Condition) -> str:
        return condition.attacks or NOBODY_LIES

    def phrase(self, condition: Condition) -> str:
        return NOBODY_LIES if not condition.attacks and not self.along else f"{self.title} {self.text(condition)}"


AXES = (
    Axis("latency_s", "latency", "ms", 1e3),
    Axis("loss", "loss", "%", 1e2),
    Axis("position_noise_m", "position noise", "m"),
    Axis("heading_noise_deg", "heading noise", "°"),
    Axis("bandwidth_bit_s", "bandwidth", "Mbit/s", 1e-6, less_harms=True),
    Axis("penetration", "penetration", "%", 1e2, "the environment's own", less_harms=True),
    AttackAxis("attacks", "attacks", ""),
)


def varying_axes(conditions: Sequence[Condition]) -> tuple[Axis, ...]:
    """Return the axes on which conditions differ; axes that only vary together are one."""
    return _varying(tuple(conditions))


@lru_cache(maxsize=8)
def _varying(conditions: tuple[Condition, ...]) -> tuple[Axis, ...]:
    axes: list[Axis] = []
    for axis in AXES:
        count = len({axis.value(each) for each in conditions})
        if count == 1:
            continue
        for k, other in enumerate(axes):
            pairs = {(other.value(each), axis.value(each)) for each in conditions}
            if len(pairs) == count == len({other.value(each) for each in conditions}):
                axes[k] = replace(other, along=(*other.along, axis))
                break
        else:
            axes.append(axis)
    return tuple(axes)


def values_of(axis: Axis, conditions: Sequence[Condition]) -> dict[float, str]:
    """Return the values of an axis with their texts, rising; names by their texts, after that of no harm."""
    texts = {axis.value(each): axis.text(each) for each in conditions}
    if not axis.named:
        return dict(sorted(texts.items()))
    return dict(sorted(texts.items(), key=lambda each: (each[0] > 0, each[1])))


def label(condition: Condition, conditions: Sequence[Condition]) -> str:
    """Name a condition among others by what differs between them, or by its scenario if nothing does."""
    return _joined(condition, conditions, [axis.phrase(condition) for axis in varying_axes(conditions)])


def short_label(condition: Condition, conditions: Sequence[Condition]) -> str:
    """Name a condition as `label` does, without the axes' titles."""
    return _joined(condition, conditions, [axis.text(condition) for axis in varying_axes(conditions)])


def _joined(condition: Condition, conditions: Sequence[Condition], parts: Sequence[str]) -> str:
    several = len({each.scenario for each in conditions}) > 1
    return ", ".join([*([condition.scenario] if several or not parts else []), *parts])


def mildest(conditions: Sequence[Condition]) -> tuple[Condition, ...]:
    """Return the conditions that are mildest on every axis, at most one per scenario; a grid may lack that corner."""
    return tuple(conditions[k] for k in mildest_along(None, conditions))


def mildest_along(axis: Axis | None, conditions: Sequence[Condition]) -> list[int]:
    """Return the numbers of the conditions that are mildest on every axis but one."""
    others = [each for each in varying_axes(conditions) if each != axis]
    least = [min((each.value(condition) for condition in conditions), key=each.harm) for each in others]
    return [k for k, each in enumerate(conditions) if [other.value(each) for other in others] == least]


def name_of_cell(cell: Cell, conditions: Sequence[Condition]) -> str:
    """Name a cell among those of some conditions."""
    return f"{cell.policy}, {label(cell.condition, conditions)}, seed {cell.seed}"
