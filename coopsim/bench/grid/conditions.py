"""From a cell to the options of its environment."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from coopsim.bench.grid.cell import Cell
from coopsim.catalog import is_scenario_file, scenario_file_options
from coopsim.config.load import read_mapping
from coopsim.errors import InvalidValueError

_ONE_THREAD = {"threads": 1}
"""As many cells at once as there are cores; each on one of them."""

_JITTER_AND_RANGE = {"latency_jitter_s": 0.0, "communication_range_m": 300.0}
"""Options that say what a whole channel says itself, and their defaults, which say nothing beside one."""


def environment_options(cell: Cell, options: Mapping[str, Any]) -> dict[str, Any]:
    """Keywords for `coopsim.evaluate`: the cell's condition and length, and what is the same in all cells.

    Args:
        cell: the condition decides latency, loss, noise and bandwidth.
        options: plain data, as `Grid.options`. A `channel` among them, a mapping or a file with one, is without these.

    Raises:
        InvalidValueError: an option is not accepted, or decides what is the condition's.
    """
    condition = cell.condition
    made = {name: value for name, value in options.items() if name != "channel"}
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
