"""Localizations from mappings and YAML files, for experiments that are written down."""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from coopsim.config.mappings import Given, make, read_mapping, require_mapping
from coopsim.errors import InvalidValueError
from coopsim.localization.localizer import LocalizationConfig
from coopsim.localization.pose_noise import PoseNoise

_AGENT = re.compile(r".+_\d+")


def localization_config(
    given: LocalizationConfig | Given | str | Path,
) -> LocalizationConfig | Mapping[str, LocalizationConfig]:
    """A localization for all agents, or one by agent, from itself, a mapping, or the path of a YAML file with one.

    A mapping has the fields of `LocalizationConfig`, of which `pose` is a mapping of the fields of `PoseNoise`; or,
    where a key is an agent's name, as `cav_0`, or a value is a `LocalizationConfig`, such mappings by agent.

    Raises:
        InvalidValueError: no such file, or a value that is not accepted.
        UnknownNameError: a field that there is not.
    """
    if isinstance(given, LocalizationConfig):
        return given
    mapping = read_mapping("localization", "a LocalizationConfig", given)
    if not mapping:
        raise InvalidValueError("localization has nothing in it: leave it out for the options beside it")
    if any(_AGENT.fullmatch(str(key)) or isinstance(value, LocalizationConfig) for key, value in mapping.items()):
        return {name: _localization(f"localization of {name}", each) for name, each in mapping.items()}
    return _localization("localization", mapping)


def _localization(what: str, given: Any) -> LocalizationConfig:
    if isinstance(given, LocalizationConfig):
        return given
    parts = dict(require_mapping(what, given))
    if "pose" in parts:
        parts["pose"] = make(f"{what} pose", PoseNoise, parts["pose"])
    config: LocalizationConfig = make(what, LocalizationConfig, parts)
    return config
