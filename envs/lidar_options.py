"""The option `lidar`: the LiDARs that agents carry."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from coopsim.config.load import has_parameters, load
from coopsim.errors import InvalidValueError
from coopsim.sensors.lidar.lidar import MOST_COLUMNS, LidarConfig
from coopsim.sensors.lidar.pattern_files import SUFFIXES
from coopsim.sensors.lidar.patterns import PATTERNS, BeamPattern
from coopsim.sensors.limits import FARTHEST_M
from coopsim.support.checks import require_choice, require_count, require_number

OneLidar = str | BeamPattern | LidarConfig
LidarOption = OneLidar | Mapping[str, OneLidar | Mapping[str, Any]] | Mapping[str, Any] | None

LIDAR = "lidar"
"""Name of the only LiDAR."""


def lidar_configs(lidar: LidarOption, columns: int, range_m: float) -> dict[str, LidarConfig]:
    """Return the LiDARs of each agent, by name; no LiDAR for None.

    Args:
        lidar: a beam table, by name (see `coopsim.sensors.lidar.patterns`), path or as an object; a `LidarConfig`, or a
            mapping of its fields; or several of these by name (not a name like that of a field): `{"roof": "OS1-128",
            "bumper": LidarConfig("VLP-16", x_m=2.9, above_m=-0.9)}`.
        columns: firings per turn, of beam tables.
        range_m: farthest return, of beam tables.

    Raises:
        UnknownNameError: there is no beam table, or no field, of this name.
        InvalidValueError: a value is not accepted.
    """
    usual = LidarConfig()
    require_count(1, MOST_COLUMNS, lidar_columns=columns)
    nearest_m = usual.min_range_m
    accepted = f"> {nearest_m:g} and <= {FARTHEST_M:g}"
    require_number(accepted, lambda far: nearest_m < far <= FARTHEST_M, lidar_range_m=range_m)
    if lidar is None:
        return {}
    named = _by_name(lidar) if isinstance(lidar, Mapping) else {LIDAR: lidar}
    if not isinstance(lidar, Mapping):
        _require_lidar("lidar", lidar, ", a mapping of its fields, a dict of these by name, or None")
    if any(isinstance(one, LidarConfig) for one in named.values()):
        _refuse_beside_config(usual, columns, range_m)
    return {
        name: one if isinstance(one, LidarConfig) else LidarConfig(one, columns=columns, max_range_m=range_m)
        for name, one in named.items()
    }


def _by_name(lidar: Mapping[str, Any]) -> dict[str, OneLidar]:
    if not lidar:
        raise InvalidValueError("lidar must name at least one LiDAR, or be None for none; got an empty dict")
    if has_parameters(LidarConfig, lidar):
        return {LIDAR: load(LidarConfig, lidar, "lidar")}
    named: dict[str, OneLidar] = {}
    for name, one in lidar.items():
        if not (isinstance(name, str) and name):
            raise InvalidValueError(f"lidar must have a name for each, got {name!r}")
        what = f"lidar {name!r}"
        named[name] = load(LidarConfig, one, what) if isinstance(one, Mapping) else one
        _require_lidar(what, named[name], " or a mapping of its fields")
    return named


def _require_lidar(what: str, lidar: object, beside: str) -> None:
    if not isinstance(lidar, (str, BeamPattern, LidarConfig)):
        raise InvalidValueError(f"{what} must be a beam table, its name or path, a LidarConfig{beside}; got {lidar!r}")
    if isinstance(lidar, str) and not lidar.lower().endswith(SUFFIXES):
        require_choice(what, lidar, PATTERNS)


def _refuse_beside_config(usual: LidarConfig, columns: int, range_m: float) -> None:
    for name, got, default in (
        ("lidar_columns", columns, usual.columns),
        ("lidar_range_m", range_m, usual.max_range_m),
    ):
        if got != default:
            raise InvalidValueError(f"{name} must be left out where lidar is a LidarConfig, which has its own")
