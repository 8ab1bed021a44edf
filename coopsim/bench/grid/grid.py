"""The grid of a benchmark: every policy in every condition with every seed."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, fields
from typing import Any, Literal

from coopsim.bench.grid.cell import Cell, Condition
from coopsim.bench.grid.policies import PROCESSOR, detector_on, name_all, policy_on, require_device
from coopsim.bench.store.fingerprint import plain_options
from coopsim.catalog import PolicySpec
from coopsim.errors import InvalidValueError
from coopsim.interfaces.attack_option import spell_attacks
from coopsim.support.checks import (
    MOST_RUNS,
    as_runs,
    require_choice,
    require_count,
    require_non_negative,
    require_number,
    require_probability,
)

_MOST_SEED = 2**63 - 1
"""Largest seed that fits an integer column of the store."""

_NOT_OPTIONS: Mapping[str, str] = {
    "latency_s": "latencies_ms",
    "loss": "losses",
    "position_noise_m": "position_noises_m",
    "heading_noise_rad": "heading_noises_deg",
    "max_cycles": "frames",
    "seed": "seeds",
    "attacks": "attacks",
    "uplink": "policies, each of which has its own",
    "threads": "workers",
    "record": "`coopsim record`",
}
"""Options of an environment that are set by another part of the grid, and by which."""


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
        vary: "product", or "one_by_one": in each condition at most one of latency, loss, pose, bandwidth,
            penetration and attacks is not at the mildest value of its list. With `pose="together"` both noises are one.
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
        for name in ("latencies_ms", "position_noises_m", "heading_noises_deg"):
            _check_each(name, getattr(self, name), require_non_negative)
        _check_each("losses", self.losses, require_probability)
        _check_each("bandwidths_mbit_s", self.bandwidths_mbit_s, _require_rate)
        _check_each("penetrations", [each for each in self.penetrations if each is not None], require_probability)
        object.__setattr__(self, "attacks", tuple(_spelled(each) for each in self.attacks))
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
        for name in set(LISTS) - {"position_noises_m", "heading_noises_deg"}:
            _require_distinct(name, getattr(self, name))
        _require_distinct("position_noises_m with heading_noises_deg", tuple(self._poses()))
        if len(self) > MOST_RUNS:
            raise InvalidValueError(
                f"seeds, policies and conditions must make at most {MOST_RUNS:,} cells, got {len(self):,}"
            )
        self._check_options()

    def __len__(self) -> int:
        return len(self.policies) * len(list(self.conditions())) * len(self.seeds)

    def conditions(self) -> Iterator[Condition]:
        """Yield the conditions; the last list varies fastest, and `vary` decides which are left out."""
        for scenario, latency_ms, loss, (position_m, heading_deg), rate, connected, lies in itertools.product(
            self.scenarios,
            self.latencies_ms,
            self.losses,
            self._poses(),
            self.bandwidths_mbit_s,
            self.penetrations,
            self.attacks,
        ):
            share = None if connected is None else float(connected)
            numbers = latency_ms / 1000, float(loss), float(position_m), float(heading_deg), rate * 1e6
            condition = Condition(scenario, *numbers, share, lies)
            if self.vary == "product" or self._disturbances(condition) <= 1:
                yield condition

    def cells(self) -> tuple[Cell, ...]:
        """Return all cells, by condition, then policy, then seed."""
        frames = None if self.frames is None else int(self.frames)
        return tuple(
            Cell(policy, condition, int(seed), frames)
            for condition, policy, seed in itertools.product(self.conditions(), self.policies, self.seeds)
        )

    def _poses(self) -> Iterator[tuple[float, float]]:
        pairs = zip if self.pose == "together" else itertools.product
        yield from pairs(self.position_noises_m, self.heading_noises_deg)

    def _disturbances(self, condition: Condition) -> int:
        """Count the numbers of a condition that are not at the mildest of their list."""
        position = condition.position_noise_m > min(self.position_noises_m)
        heading = condition.heading_noise_deg > min(self.heading_noises_deg)
        pose = position or heading if self.pose == "together" else position + heading
        others = (
            condition.latency_s > min(self.latencies_ms) / 1000,
            condition.loss > min(self.losses),
            condition.bandwidth_bit_s < max(self.bandwidths_mbit_s) * 1e6,
            _share(condition.penetration) < max(map(_share, self.penetrations)),
            condition.attacks != self.attacks[0],
        )
        return pose + sum(others)

    def _check_options(self) -> None:
        if not isinstance(self.options, Mapping):
            raise InvalidValueError(f"options must be names and values, got {self.options!r}")
        for name, instead in _NOT_OPTIONS.items():
            if name in self.options:
                raise InvalidValueError(f"{name} is not an option here: use {instead}")
        made = {name: detector_on(self.device, each) for name, each in self.options.items() if name == "detector"}
        object.__setattr__(self, "options", plain_options({**self.options, **made}))


ATTRIBUTES = tuple(each.name for each in fields(Grid) if each.init)
"""The attributes that are given, in order."""

LISTS = tuple(name for name in ATTRIBUTES if name not in ("pose", "vary", "frames", "options", "device"))
"""The attributes that are lists."""


def _spelled(attacks: object) -> str:
    """Return attacks as one text; empty for "none"."""
    if not isinstance(attacks, str):
        raise InvalidValueError(f'attacks must be texts like "cav_1=ghost + rsu_0=remove" or "none", got {attacks!r}')
    return "" if attacks == "none" else spell_attacks(attacks)


def _require_distinct(name: str, values: Sequence[Any]) -> None:
    met = set[Any]()
    for value in values:
        if value in met:
            raise InvalidValueError(f"{name} must be distinct, got {value!r} twice")
        met.add(value)


def _share(penetration: float | None) -> float:
    """Return a penetration as a number; infinite for the environment's own, which is no disturbance."""
    return math.inf if penetration is None else penetration


def _check_each(name: str, values: Sequence[Any], check: Any) -> None:
    for value in values:
        check(**{name: value})


def _require_rate(**values: Any) -> None:
    # Less than a bit per second is a mistake, and its airtime may not fit the clock.
    require_number(">= 1e-6 (inf: no limit)", lambda rate: rate >= 1e-6, **values)
