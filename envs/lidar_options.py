"""Which LiDARs agents carry, from whatever the user wrote."""

from __future__ import annotations

from collections.abc import Mapping

from coopsim.checks import require_choice, require_count, require_number
from coopsim.errors import InvalidValueError
from coopsim.sensors.lidar import MOST_COLUMNS, LidarConfig
from coopsim.sensors.limits import FARTHEST_M
from coopsim.sensors.pattern_files import SUFFIXES
from coopsim.sensors.patterns import PATTERNS, BeamPattern

OneLidar = str | BeamPattern | LidarConfig
LidarOption = OneLidar | Mapping[str, OneLidar] | None

LIDAR = "lidar"
"""Name of the only LiDAR."""


def lidar_configs(lidar: LidarOption, columns: int, range_m: float) -> dict[str, LidarConfig]:
    """The LiDARs of each agent, by name; none for None.

    Args:
        lidar: a beam table, by name (see `coopsim.sensors.patterns`), path or as an object; a `LidarConfig`; or several
            of these by name: `{"roof": "OS1-128", "bumper": LidarConfig("VLP-16", x_m=2.9, above_m=-0.9)}`.
        columns: firings per turn, of beam tables.
        range_m: farthest return, of beam tables.

    Raises:
        UnknownNameError: no beam table of this name.
        InvalidValueError: says what was wrong.
    """
    usual = LidarConfig()
    require_count(1, MOST_COLUMNS, lidar_columns=columns)
    nearest_m = usual.min_range_m
    accepted = f"> {nearest_m:g} and <= {FARTHEST_M:g}"
    require_number(accepted, lambda far: nearest_m < far <= FARTHEST_M, lidar_range_m=range_m)
    if lidar is None:
        return {}
    named: Mapping[str, OneLidar]
    if isinstance(lidar, Mapping):
        named = _require_named(lidar)
    else:
        _require_lidar("lidar", lidar, ", a dict of these by name, or None")
        named = {LIDAR: lidar}
    if any(isinstance(one, LidarConfig) for one in named.values()):
        _refuse_beside_config(usual, columns, range_m)
    return {
        name: one if isinstance(one, LidarConfig) else LidarConfig(one, columns=columns, max_range_m=range_m)
        for name, one in named.items()
    }


def _require_named(lidars: Mapping[str, OneLidar]) -> Mapping[str, OneLidar]:
    if not lidars:
        raise InvalidValueError("lidar must name at least one LiDAR, or be None for none; got an empty dict")
    for name, lidar in lidars.items():
        if not (isinstance(name, str) and name):
            raise InvalidValueError(f"lidar must have a name for each, got {name!r}")
        _require_lidar(f"lidar {name!r}", lidar)
    return lidars


def _require_lidar(what: str, lidar: object, beside: str = "") -> None:
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
