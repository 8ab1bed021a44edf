"""Cells and their results, as plain data. A cell is one policy in one condition with one seed."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from coopsim.bench.grid.axis import AXES, DEFAULT, HEADING, LATENCY, LOSS, POLICY, POSITION, RATE, USUAL, axis_of
from coopsim.catalog import is_recordings_folder, is_scenario_file, scenario_file_options
from coopsim.config.load import read_mapping
from coopsim.errors import InvalidValueError
from coopsim.geometry.se3 import Floats
from coopsim.support.checks import require_count
from coopsim.support.printable import require_printable


@dataclass(frozen=True, slots=True, init=False, repr=False)
class Condition:
    """The options of a run that vary between the runs of a benchmark, besides its policy, seed and length.

    Every policy in a condition meets the same traffic, noise and losses. A condition that does not say otherwise has no
    latency, loss and pose noise, a medium without a limit, and honest agents; all other options are left alone, and so
    is one of these that is None.
    Arguments and attributes are options by name, or the columns of results (`bandwidth_bit_s`, `heading_noise_deg`).

    Args:
        scenario: name of an environment, or path of a scenario file or of a folder of recordings.
        settings: values by option, of inner options by dots (`weather.rain_mm_h`), and of parameters of policies
            (`policy.hits`); plain data.
        **named: further ones, whose names have no dots.

    Attributes:
        settings: options and values, sorted; what is usual is left out.

    Raises:
        InvalidValueError: a value is not accepted.
    """

    scenario: str
    settings: tuple[tuple[str, Any], ...]
    _place: tuple[Any, ...] = field(init=False, compare=False)

    def __init__(
        self, scenario: str = "crossing", settings: Mapping[str, Any] | Iterable[tuple[str, Any]] = (), **named: Any
    ) -> None:
        require_printable(environment=scenario)
        given = {**dict(settings), **{_OPTIONS.get(name, name): _of_column(name, named[name]) for name in named}}
        require_printable(**{name: str(value) for name, value in given.items()})
        told = {option: axis_of(option).clean(value) for option, value in given.items()}
        told = {option: value for option, value in told.items() if option not in USUAL or value != USUAL[option]}
        known = [_rank(told.get(option, usual)) for option, usual in USUAL.items()]
        further = sorted((option, _rank(value)) for option, value in told.items() if option not in USUAL)
        object.__setattr__(self, "scenario", scenario)
        object.__setattr__(self, "settings", tuple(sorted(told.items())))
        object.__setattr__(self, "_place", (scenario, known, further))

    def __repr__(self) -> str:
        return f"Condition({self.scenario!r}, {dict(self.settings)!r})"

    def __hash__(self) -> int:
        return hash((self.scenario, repr(self.settings)))

    def __lt__(self, other: Condition) -> bool:
        return self._place < other._place

    def __getattr__(self, name: str) -> Any:
        if name.startswith("_") or name in ("scenario", "settings"):
            raise AttributeError(name)
        columns = self.columns()
        if name not in columns:
            raise AttributeError(f"a condition has no {name!r} unless it says so. It has: {', '.join(columns)}")
        return columns[name]

    def get(self, option: str) -> Any:
        """Return the value of an option; `DEFAULT` if the condition says nothing of it."""
        return dict(self.settings).get(option, USUAL.get(option, DEFAULT))

    def changed(self, **named: Any) -> Condition:
        """Return the condition with other values of some options."""
        return Condition(self.scenario, self.settings, **named)

    def columns(self, further: Iterable[str] = ()) -> dict[str, Any]:
        """Return columns of results: the scenario, the options of `AXES`, and those of `settings` and `further`."""
        found: dict[str, Any] = {"scenario": self.scenario}
        for axis in AXES:
            value = self.get(axis.option)
            found[axis.column or axis.option] = axis.shown(value) if axis.option == HEADING and value else value
        return found | {option: self.get(option) for option in further_options([self], further)}


def columns_of(condition: Condition | None, further: Iterable[str]) -> dict[str, Any]:
    """Return a condition's columns and those of `further` options; all are None without a condition."""
    return dict.fromkeys(Condition().columns(further)) if condition is None else condition.columns(further)


_OPTIONS = {axis.column: axis.option for axis in AXES if axis.column}


def _of_column(name: str, value: Any) -> Any:
    """Return a value by the name of its column as its option has it."""
    return math.radians(value) if _OPTIONS.get(name) == HEADING and value is not None else value


def _rank(value: Any) -> tuple[int, float, str]:
    """Return what values of an option are sorted by: None, then numbers, then texts."""
    if value is None:
        return 0, 0.0, ""
    return (1, float(value), "") if isinstance(value, (bool, int, float)) else (2, 0.0, str(value))


def further_options(conditions: Iterable[Condition], more: Iterable[str] = ()) -> tuple[str, ...]:
    """Return the options of conditions besides those of `AXES`, sorted: each is a column of results."""
    told = {option for each in conditions for option, _ in each.settings} | set(more)
    return tuple(sorted(told - USUAL.keys()))


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
        film: file of the run's film in the store that the result is from; None: it was not filmed.
        arrays: further measurements of a plan by name, such as detections.
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
    film: Path | None = None
    arrays: Mapping[str, NDArray[Any]] = field(default_factory=dict)

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

_OF_CHANNEL = (LATENCY, LOSS, RATE)


def environment_options(cell: Cell, options: Mapping[str, Any]) -> dict[str, Any]:
    """Return keywords of `coopsim.evaluate`: the cell's condition and length, and the options of all cells.

    A `channel` among the options, a mapping or the path of a file, must have neither latency, loss nor rate where the
    condition sets them.

    Raises:
        InvalidValueError: an option is not accepted, or would override the condition.
    """
    condition = cell.condition
    given = _with_settings(condition, options)
    made = {name: value for name, value in given.items() if name != "channel"}
    latency_s, loss, rate_bit_s = map(condition.get, _OF_CHANNEL)
    on_air = {name: value for name, value in ((LATENCY, latency_s), (LOSS, loss)) if value is not None}
    if (on_air and given.get("channel") is not None) or math.isfinite(rate_bit_s or math.inf):
        made["channel"] = _channel(condition, given)
        on_air = {LATENCY: 0.0, LOSS: 0.0, **_JITTER_AND_RANGE}  # overrides a scenario file, too
    elif given.get("channel") is not None:
        made["channel"] = given["channel"]
    noise = {option: condition.get(option) for option in (POSITION, HEADING)}
    noise = {option: value for option, value in noise.items() if value is not None}
    one_thread = {} if is_recordings_folder(condition.scenario) else _ONE_THREAD
    length = {} if cell.frames is None else {"max_cycles": cell.frames}
    return {**one_thread, **made, **on_air, **noise, **length}


def scenario_options(scenario: str) -> Mapping[str, Any]:
    """Return the options in a scenario's file; none for a scenario without a file."""
    return scenario_file_options(scenario) if is_scenario_file(scenario) else {}


_SET_APART = (*_OF_CHANNEL, POSITION, HEADING)


def _with_settings(condition: Condition, options: Mapping[str, Any]) -> dict[str, Any]:
    """Return options with those that a condition sets; an inner one leaves the others of its mapping as they are."""
    given = dict(options)
    for option, value in condition.settings:
        name, *inner = option.split(".")
        if option.startswith(POLICY) or option in _SET_APART or (value is None and option in USUAL):
            continue
        if not inner:
            given[name] = value
            continue
        if name not in given and (of_file := scenario_options(condition.scenario).get(name)) is not None:
            given[name] = of_file
        level = given[name] = dict(read_mapping(name, "None", given.get(name) or {}))
        for part in inner[:-1]:
            level[part] = level = dict(level.get(part) or {})
        level[inner[-1]] = value
    return given


def _channel(condition: Condition, options: Mapping[str, Any]) -> dict[str, Any]:
    """Return the channel: latency, loss and rate of the condition; else as in `options` or the scenario's file."""
    given = read_mapping("channel", "None", options.get("channel") or {})
    latency_s, loss, rate_bit_s = map(condition.get, _OF_CHANNEL)
    medium = given.get("bandwidth") or {}
    for name, value in (("latency", latency_s), ("loss", loss)):
        if name in given and value is not None:
            raise InvalidValueError(f"channel must be without {name}, which is the grid's, got {given[name]!r}")
    if not isinstance(medium, Mapping) or "rate_bit_s" in medium:
        raise InvalidValueError(f"channel.bandwidth must be a mapping without rate_bit_s, the grid's, got {medium!r}")
    usual = {**_JITTER_AND_RANGE, **scenario_options(condition.scenario), **options}
    made: dict[str, Any] = {"range_m": usual["communication_range_m"], **given}
    if latency_s is not None:
        made["latency"] = {"model": "gaussian", "mean_s": latency_s, "jitter_s": usual["latency_jitter_s"]}
    if loss is not None:
        made["loss"] = {"model": "bernoulli", "probability": loss}
    limited = math.isfinite(rate_bit_s or math.inf)
    return {**made, "bandwidth": {**medium, "rate_bit_s": rate_bit_s} if limited else None}
