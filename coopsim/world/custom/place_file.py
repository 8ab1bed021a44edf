"""Scenario files of described places."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from coopsim.config.yaml_text import yaml_text
from coopsim.errors import InvalidValueError, ScenarioFileError
from coopsim.support.files import write_whole


def write_place_file(path: str | Path, description: Mapping[str, Any], content: Mapping[str, Any]) -> Path:
    """Write a scenario file with a place that reads back to the same numbers, bit by bit.

    Args:
        path: the file; an older one is replaced.
        description: of the place, as `Place.description`.
        content: other keys of the file as plain data; they are checked when it is read.

    Raises:
        ScenarioFileError: the file cannot be written.
    """
    try:
        return write_whole(path, yaml_text({"place": description, **content}))
    except InvalidValueError as error:
        raise ScenarioFileError(str(error)) from error
