"""The option `lidar`: the LiDARs that agents carry."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import fields
from typing import Any

from coopsim.config.load import has_parameters, load
from coopsim.errors import InvalidValueError
from coopsim.sensors.lidar.lidar import MOST_COLUMNS, LidarConfig
from coopsim.sensors.lidar.pattern_files import SUFFIXES
from coopsim.sensors.lidar.patterns import PATTERNS, BeamPattern
from coopsim.sensors.limits import FARTHEST_M
from coopsim.support.checks import require_choice, require_count, require_number
from coopsim.types.messages import AGENT_KINDS

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
    accepted = f"> {usual.min_range_m:g} and <= {FARTHEST_M:g}"
    require_number(accepted, lambda far: usual.min_range_m < far <= FARTHEST_M, lidar_range_m=range_m)
    if lidar is None:
        return {}
    if not isinstance(lidar, Mapping) or _has_fields(lidar):
        named = {LIDAR: _lidar(lidar, "lidar", ", a mapping of its fields, a dict of these by name, or None")}
    elif not lidar:
        raise InvalidValueError("lidar must name at least one LiDAR, or be None for none; got an empty dict")
    else:
        named = {name: _lidar(one, f"lidar {name!r}", " or a mapping of its fields") for name, one in lidar.items()}
    for name, one in named.items():
        if not (isinstance(name, str) and name):
            raise InvalidValueError(f"lidar must have a name for each, got {name!r}")
        if isinstance(one, LidarConfig) and (columns, range_m) != (usual.columns, usual.max_range_m):
            option = "lidar_range_m" if columns == usual.columns else "lidar_columns"
            raise InvalidValueError(f"{option} must be left out where lidar is a LidarConfig, which has its own")
    return {
        name: one if isinstance(one, LidarConfig) else LidarConfig(one, columns=columns, max_range_m=range_m)
        for name, one in named.items()
    }


def lidar_carriers(lidar_agents: Iterable[str] | None, kinds: Mapping[str, str]) -> frozenset[str]:
    """Return the names of the agents that carry the LiDARs.

    Args:
        lidar_agents: names of agents, or kinds of them; None: all agents.
        kinds: "cav", "rsu" or "drone", by agent.

    Raises:
        UnknownNameError: no agent or kind is called that.
        InvalidValueError: there is no agent of these kinds.
    """
    if lidar_agents is None:
        return frozenset(kinds)
    wanted = tuple(lidar_agents)
    for name in wanted:
        require_choice("agent in lidar_agents", name, (*kinds, *AGENT_KINDS))
    carriers = frozenset(agent for agent, kind in kinds.items() if agent in wanted or kind in wanted)
    if not carriers:
        raise InvalidValueError(
            f"lidar_agents must name some of the agents ({', '.join(kinds)}) or of their kinds, got {list(wanted)}; "
            "lidar=None is for no LiDAR at all"
        )
    return carriers


def checked_lidar_agents(lidar_agents: object, lidar: object) -> tuple[str, ...] | None:
    """Return the option `lidar_agents` as names, which the environment looks up later.

    Raises:
        InvalidValueError: it is not a name or a list of names, or there are no LiDARs.
    """
    if lidar_agents is None:
        return None
    names = (lidar_agents,) if isinstance(lidar_agents, str) else lidar_agents
    if not (isinstance(names, (list, tuple)) and names and all(isinstance(name, str) for name in names)):
        raise InvalidValueError(
            f"lidar_agents must be names of agents, or of {', '.join(AGENT_KINDS)}, or None for all; "
            f"got {lidar_agents!r}"
        )
    if lidar is None:
        raise InvalidValueError("lidar_agents must be left out where lidar is None: there are no LiDARs to carry")
    return tuple(names)


def _has_fields(lidar: Mapping[str, Any]) -> bool:
    """Return whether the keys are fields of a `LidarConfig`, misspelt ones included, and not names of LiDARs.

    A LiDAR may be called "above", almost as the field `above_m`: its value tells them apart.
    """
    if any(field.name in lidar for field in fields(LidarConfig)):
        return True
    named = any(isinstance(one, (LidarConfig, BeamPattern, Mapping)) for one in lidar.values())
    return not named and has_parameters(LidarConfig, lidar)


def _lidar(given: Any, what: str, more: str) -> OneLidar:
    """Return one LiDAR, made of its mapping; `more` says what else is accepted, for the error."""
    lidar: OneLidar = load(LidarConfig, given, what) if isinstance(given, Mapping) else given
    if not isinstance(lidar, (str, BeamPattern, LidarConfig)):
        raise InvalidValueError(f"{what} must be a beam table, its name or path, a LidarConfig{more}; got {lidar!r}")
    if isinstance(lidar, str) and not lidar.lower().endswith(SUFFIXES):
        require_choice(what, lidar, PATTERNS)
    return lidar
