"""From a cell to the options of its environment."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from coopsim.bench.grid.cell import Cell
from coopsim.catalog import is_scenario_file, scenario_file_options
from coopsim.config.mappings import make, read_mapping
from coopsim.errors import InvalidValueError
from coopsim.sensors.weather import Weather

_ONE_THREAD = {"threads": 1}
"""As many cells at once as there are cores; each on one of them."""

_JITTER_AND_RANGE = {"latency_jitter_s": 0.0, "communication_range_m": 300.0}
"""Options that say what a whole channel says itself, and their defaults, which say nothing beside one."""

_OBJECTS = {"weather": Weather}
"""Options that may be written down as a mapping of the fields of these."""


def environment_options(cell: Cell, options: Mapping[str, Any]) -> dict[str, Any]:
    """Keywords for `coopsim.evaluate`: the cell's condition and length, and what is the same in all cells.

    Args:
        cell: the condition decides latency, loss, noise and bandwidth.
        options: plain data, as `Grid.options`. A `channel` among them, a mapping or a file with one, is without these.

    Raises:
        InvalidValueError: an option is not accepted, or decides what is the condition's.
    """
    condition = cell.condition
    made = {name: value for name, value in as_objects(options).items() if name != "channel"}
    limited = math.isfinite(condition.bandwidth_bit_s)
    if limited or options.get("channel") is not None:
        made["channel"] = _channel(cell, options)
        on_air = {"latency_s": 0.0, "loss": 0.0, **_JITTER_AND_RANGE}  # not a scenario file's, either
    else:
        on_air = {"latency_s": condition.latency_s, "loss": condition.loss}
    noise = {
        "position_noise_m": condition.position_noise_m,
        "heading_noise_rad": math.radians(condition.heading_noise_deg),
    }
    return {**_ONE_THREAD, **made, **on_air, **noise, "max_cycles": cell.frames}


def scenario_options(scenario: str) -> Mapping[str, Any]:
    """What a scenario says itself: the options in its file, or nothing.

    Raises:
        ScenarioFileError: the file is missing or broken.
    """
    return scenario_file_options(scenario) if is_scenario_file(scenario) else {}


def as_objects(options: Mapping[str, Any]) -> dict[str, Any]:
    """Options of an environment from plain data: some may be written down as mappings of an object's fields.

    Raises:
        InvalidValueError: such a mapping is not accepted.
    """
    return {name: _as_object(name, value) for name, value in options.items()}


def _as_object(name: str, value: Any) -> Any:
    if not (isinstance(value, Mapping) and name in _OBJECTS):
        return value
    return make(name, _OBJECTS[name], value)


def _channel(cell: Cell, options: Mapping[str, Any]) -> dict[str, Any]:
    """The whole channel as a mapping: the condition's latency, loss and rate, and beside them what `options` say, else
    the scenario's file.
    """
    condition, given = cell.condition, read_mapping("channel", "None", options.get("channel") or {})
    medium = given.get("bandwidth") or {}
    for name in ("latency", "loss"):
        if name in given:
            raise InvalidValueError(f"channel must be without {name}, which is the grid's, got {given[name]!r}")
    if not isinstance(medium, Mapping) or "rate_bit_s" in medium:
        raise InvalidValueError(f"channel.bandwidth must be a mapping without rate_bit_s, the grid's, got {medium!r}")
    beside = {**_JITTER_AND_RANGE, **scenario_options(condition.scenario), **options}
    limited = math.isfinite(condition.bandwidth_bit_s)
    return {
        "range_m": beside["communication_range_m"],
        **given,
        "latency": {"model": "gaussian", "mean_s": condition.latency_s, "jitter_s": beside["latency_jitter_s"]},
        "loss": {"model": "bernoulli", "probability": condition.loss},
        "bandwidth": {**medium, "rate_bit_s": condition.bandwidth_bit_s} if limited else None,
    }
