"""Which LiDARs agents carry, from whatever the user wrote."""

from __future__ import annotations

import math
from collections.abc import Mapping

from coopsim.checks import require_choice, require_count, require_number
from coopsim.errors import InvalidValueError
from coopsim.sensors.lidar import MOST_COLUMNS, LidarConfig
from coopsim.sensors.pattern_files import SUFFIXES
from coopsim.sensors.patterns import PATTERNS, BeamPattern

LidarOption = str | BeamPattern | LidarConfig | Mapping[str, LidarConfig] | None

LIDAR = "lidar"
"""Name of the only LiDAR."""


def lidar_configs(lidar: LidarOption, columns: int, range_m: float) -> dict[str, LidarConfig]:
    """The LiDARs of each agent, by name; none for None.

    Args:
        lidar: a beam table, by name (see `coopsim.sensors.patterns`), path or as an object; a `LidarConfig`; or several
            of these by name: `{"roof": LidarConfig(), "bumper": LidarConfig("VLP-16", x_m=2.9, above_m=-0.9)}`.
        columns: firings per turn, of a beam table.
        range_m: farthest return, of a beam table.

    Raises:
        UnknownNameError: no beam table of this name.
        InvalidValueError: says what was wrong.
    """
    usual = LidarConfig()
    require_count(1, MOST_COLUMNS, lidar_columns=columns)
    nearest_m = usual.min_range_m
    accepted = f"a finite number > {nearest_m:g}"
    require_number(accepted, lambda far: nearest_m < far < math.inf, lidar_range_m=range_m)
    if lidar is None:
        return {}
    if isinstance(lidar, str) and not lidar.lower().endswith(SUFFIXES):
        require_choice("lidar", lidar, PATTERNS)
    if isinstance(lidar, (str, BeamPattern)):
        return {LIDAR: LidarConfig(pattern=lidar, columns=columns, max_range_m=range_m)}
    for name, got, default in (
        ("lidar_columns", columns, usual.columns),
        ("lidar_range_m", range_m, usual.max_range_m),
    ):
        if got != default:
            raise InvalidValueError(f"{name} must be left out where lidar is a LidarConfig, which has its own")
    named = {LIDAR: lidar} if isinstance(lidar, LidarConfig) else lidar
    if not isinstance(named, Mapping) or not named:
        raise InvalidValueError(
            f"lidar must be a beam table, its name or path, a LidarConfig, a dict of these, or None; got {lidar!r}"
        )
    for name, config in named.items():
        if not (isinstance(name, str) and name and isinstance(config, LidarConfig)):
            raise InvalidValueError(f"lidar must have a name and a LidarConfig for each, got {name!r}: {config!r}")
    return dict(named)
