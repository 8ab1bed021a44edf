"""Options of the environment of a cell."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from coopsim.bench.grid.cell import Cell
from coopsim.catalog import is_recordings_folder, is_scenario_file, scenario_file_options
from coopsim.config.load import read_mapping
from coopsim.errors import InvalidValueError

_ONE_THREAD = {"threads": 1}
"""Each cell runs on one core, as many at once as there are cores."""

_JITTER_AND_RANGE = {"latency_jitter_s": 0.0, "communication_range_m": 300.0}
"""Options that a whole channel overrides, and their defaults."""


def environment_options(cell: Cell, options: Mapping[str, Any]) -> dict[str, Any]:
    """Return keywords of `coopsim.evaluate`: the cell's condition and length, and the options of all cells.

    Args:
        cell: the cell; its condition sets latency, loss, noise and bandwidth.
        options: plain data, as `Grid.options`. A `channel` among them, a mapping or the path of a file, has none of
            these.

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
    return {**one_thread, **made, **on_air, **noise, "max_cycles": cell.frames}


def scenario_options(scenario: str) -> Mapping[str, Any]:
    """Return the options in a scenario's file; none for a scenario without a file.

    Raises:
        ScenarioFileError: the file is missing or broken.
    """
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
