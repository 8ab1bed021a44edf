"""The grid of a benchmark: every policy in every condition with every seed."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, fields
from typing import Any, Literal

from coopsim.bench.grid.axis import ATTACKS, AXES, HEADING, POSITION, USUAL, Axis, axis_of
from coopsim.bench.grid.cell import Cell, Condition
from coopsim.bench.grid.plain_options import plain_options
from coopsim.bench.grid.policies import PROCESSOR, detector_on, name_all, policy_on, require_device
from coopsim.catalog import PolicySpec
from coopsim.errors import InvalidValueError
from coopsim.support.checks import (
    MOST_RUNS,
    as_runs,
    require_choice,
    require_count,
)

_MOST_SEED = 2**63 - 1
"""Largest seed that fits an integer column of the store."""

_NOT_OPTIONS: Mapping[str, str] = {
    "max_cycles": "frames",
    "seed": "seeds",
    "uplink": "policies, each of which has its own",
    "threads": "workers",
    "record": "`coopsim record`",
}
"""Options of an environment that are set by another part of the grid, and by which: neither options nor axes of it."""


@dataclass(frozen=True, slots=True, eq=False)
class Grid:
    """The cells of a benchmark: the product of its lists, or a part of it.

    Attributes:
        policies: policies, as `PolicySpec` reads them; at least one, each once. "all" stands for every other registered
            policy whose weights ship, see `name_all`.
        scenarios: names of environments, or paths of scenario files.
        latencies_ms: delays of every message.
        losses: probabilities that a message is lost on a link.
        position_noises_m: standard deviations of x and of y of the estimated pose.
        heading_noises_deg: standard deviations of its heading.
        pose: "product", or "together": the first position noise with the first heading noise, and so on.
        bandwidths_mbit_s: rates of the medium that all agents share, 1e6 bit/s; infinite: transmission takes no time.
        penetrations: shares of the other cars that are connected; None: the environment's own.
        attacks: lies of agents, each as "cav_1=ghost(ahead_m=15) + rsu_0=remove"; "none" or empty: all are honest.
        axes: values of further options of environments, by name; those of inner options by dots, as
            `weather.rain_mm_h`, and of policies' parameters as `policy.hits`, for the policies that have it. The lists
            above are short forms of `latency_s`, `loss`, `position_noise_m`, `heading_noise_rad`,
            `channel.bandwidth.rate_bit_s`, `penetration` and `attacks`.
        vary: "product", or "one_by_one": in each condition at most one axis is not at the mildest value of its list.
            With `pose="together"` both noises are one. Of `axes` without a short form the mildest are null, then the
            smallest number (the largest of a budget or a range) and the first name by the alphabet.
        seeds: each decides everything in a run.
        frames: length of each run; None: the episode's own.
        options: further options of the environments, plain data, the same in all cells.
        device: where networks of policies and of the detector compute: "cpu", "cuda", "cuda:1" or "auto"; it becomes a
            parameter in the names of these policies.
        left_out: policies that "all" does not stand for as their weights do not ship, with the reason.

    Raises:
        InvalidValueError: a value is not accepted; the message begins with the attribute's name.
    """

    policies: Sequence[str]
    scenarios: Sequence[str] = ("crossing",)
    latencies_ms: Sequence[float] = (0.0,)
    losses: Sequence[float] = (0.0,)
    position_noises_m: Sequence[float] = (0.0,)
    heading_noises_deg: Sequence[float] = (0.0,)
    pose: Literal["product", "together"] = "product"
    bandwidths_mbit_s: Sequence[float] = (math.inf,)
    penetrations: Sequence[float | None] = (None,)
    attacks: Sequence[str] = ("",)
    axes: Mapping[str, Sequence[Any]] = field(default_factory=dict)
    vary: Literal["product", "one_by_one"] = "product"
    seeds: Sequence[int] = (0,)
    frames: int | None = 100
    options: Mapping[str, Any] = field(default_factory=dict)
    device: str = PROCESSOR
    left_out: Mapping[str, str] = field(default_factory=dict, init=False)

    def __post_init__(self) -> None:
        for name in LISTS:
            object.__setattr__(self, name, as_runs(**{name: getattr(self, name)}))
        for name in ("policies", "scenarios"):
            for value in getattr(self, name):
                if not isinstance(value, str):
                    raise InvalidValueError(f"{name} must be texts, got {value!r}")
        named, left_out = name_all([PolicySpec.parse(policy).text for policy in self.policies])
        require_device(self.device)
        object.__setattr__(self, "policies", tuple(policy_on(self.device, text) for text in named))
        object.__setattr__(self, "left_out", left_out)
        for axis in AXES:
            for value in getattr(self, axis.short):
                if not (value is None and axis.usual is None):
                    axis.require(**{axis.short: value})
        object.__setattr__(self, "attacks", tuple(map(axis_of(ATTACKS).clean, self.attacks)))
        for seed in self.seeds:
            require_count(0, _MOST_SEED, seeds=seed)
        if self.frames is not None:
            require_count(1, frames=self.frames)
        require_choice("pose", self.pose, ("product", "together"))
        require_choice("vary", self.vary, ("product", "one_by_one"))
        if self.pose == "together" and len(self.position_noises_m) != len(self.heading_noises_deg):
            raise InvalidValueError(
                "pose must be 'product' where position_noises_m and heading_noises_deg differ in length, got "
                f"'together' with {len(self.position_noises_m)} and {len(self.heading_noises_deg)}"
            )
        self._check_options()
        for name in ("policies", "scenarios", "seeds"):
            _require_distinct(name, getattr(self, name))
        for group in self._groups():
            _require_distinct(group.given, [each if len(each) > 1 else each[0] for each in group.values])
        if len(self) > MOST_RUNS:
            raise InvalidValueError(
                f"seeds, policies and conditions must make at most {MOST_RUNS:,} runs, got {len(self):,}"
            )

    def __len__(self) -> int:
        return len(self.policies) * len(list(self.conditions())) * len(self.seeds)

    def conditions(self) -> Iterator[Condition]:
        """Yield the conditions; the last list varies fastest, and `vary` decides which are left out."""
        groups = self._groups()
        options = [axis.option for group in groups for axis in group.axes]
        for scenario, *values in itertools.product(self.scenarios, *(group.values for group in groups)):
            disturbed = sum(group.disturbs(value) for group, value in zip(groups, values, strict=True))
            if self.vary == "product" or disturbed <= 1:
                yield Condition(scenario, zip(options, itertools.chain(*values), strict=True))

    def cells(self) -> tuple[Cell, ...]:
        """Return all cells, by condition, then policy, then seed."""
        frames = None if self.frames is None else int(self.frames)
        return tuple(
            Cell(policy, condition, int(seed), frames)
            for condition, policy, seed in itertools.product(self.conditions(), self.policies, self.seeds)
        )

    def _groups(self) -> list[_Group]:
        """Return the axes with their values; those that vary together are one group."""
        groups = []
        for axis in AXES:
            named = axis.option in self.axes
            short = [None if each is None else axis.from_short(each) for each in getattr(self, axis.short)]
            values = self.axes[axis.option] if named else short
            given = axis.option if named else axis.short
            groups.append(_Group(given, (axis,), [(axis.clean(each),) for each in values]))
        if self.pose == "together":
            k = next(k for k, group in enumerate(groups) if group.given == "position_noises_m")
            groups[k : k + 2] = [groups[k].along(groups[k + 1])]
        further = {option: values for option, values in self.axes.items() if option not in USUAL}
        made = [(axis_of(option, values), values) for option, values in further.items()]
        return [*groups, *(_Group(axis.option, (axis,), [(each,) for each in values]) for axis, values in made)]

    def _check_options(self) -> None:
        """Check `options` and `axes`, and make them plain data."""
        for given, of in (("options", "values"), ("axes", "lists of values")):
            if not isinstance(getattr(self, given), Mapping):
                raise InvalidValueError(f"{given} must be names and {of}, got {getattr(self, given)!r}")
        axes = {str(name): as_runs(**{str(name): values}) for name, values in self.axes.items()}
        for name in (*self.options, *axes):
            if name in _NOT_OPTIONS:
                raise InvalidValueError(f"{name} is not an option here: use {_NOT_OPTIONS[name]}")
        for axis in AXES:
            if axis.option in self.options and axis.usual is not None:
                raise InvalidValueError(f"{axis.option} is not an option here: use {axis.short}")
            if axis.option in axes and len(getattr(self, axis.short)) > 1:
                raise InvalidValueError(f"{axis.option} must be given once, got it among axes, and {axis.short}")
        if self.pose == "together" and {POSITION, HEADING} & axes.keys():
            raise InvalidValueError("pose must be 'product' where its noises are among axes, got 'together'")
        for twice in sorted(self.options.keys() & axes.keys()):
            raise InvalidValueError(f"{twice} must be given once, got it among options and axes")
        options = dict(self.options)
        if "detector" in options:
            options["detector"] = detector_on(self.device, options["detector"])
        if "detector" in axes:
            axes["detector"] = tuple(detector_on(self.device, each) for each in axes["detector"])
        object.__setattr__(self, "options", plain_options(options))
        object.__setattr__(self, "axes", {name: tuple(each) for name, each in plain_options(axes).items()})


@dataclass(frozen=True, slots=True)
class _Group:
    """Axes that vary together, by the name they were given, with the values of each step."""

    given: str
    axes: tuple[Axis, ...]
    values: list[tuple[Any, ...]]

    def along(self, other: _Group) -> _Group:
        """Return one group of two with as many values."""
        values = [(*mine, *theirs) for mine, theirs in zip(self.values, other.values, strict=True)]
        return _Group(f"{self.given} with {other.given}", self.axes + other.axes, values)

    def disturbs(self, step: tuple[Any, ...]) -> bool:
        """Return whether any value of a step is not the mildest."""
        for k, axis in enumerate(self.axes):
            harms = [axis.harm(axis.shown(each[k])) for each in self.values]
            if axis.harm(axis.shown(step[k])) > min(harms):
                return True
        return False


ATTRIBUTES = tuple(each.name for each in fields(Grid) if each.init)
"""The attributes that are given, in order."""

LISTS = tuple(name for name in ATTRIBUTES if name not in ("pose", "axes", "vary", "frames", "options", "device"))
"""The attributes that are lists."""


def _require_distinct(name: str, values: Sequence[Any]) -> None:
    met = set[Any]()
    for value in values:
        met_as = repr(value) if isinstance(value, (list, tuple, Mapping)) else value
        if met_as in met:
            raise InvalidValueError(f"{name} must be distinct, got {value!r} twice")
        met.add(met_as)
