"""Options of an environment that plays a recording."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from coopsim.errors import InvalidValueError, RecordingError
from coopsim.support.checks import require_count
from coopsim.world.recording.episode_file import Episode
from coopsim.world.scenario import Place
from coopsim.world.towns.scenarios import TOWN, TOWN_KEYS


def as_recorded(episode: Episode, scenario: str | Place, options: Mapping[str, Any]) -> dict[str, Any]:
    """Return the options with the recording's population, `dt_s` and (unless fewer are asked for) `max_cycles`.

    Args:
        episode: the recording.
        scenario: the environment's, its name or a custom place.
        options: the user's.

    Raises:
        RecordingError: the recording is of another scenario, of one that does not exist, or has a single frame.
        InvalidValueError: an option differs from the recorded one.
    """
    header, steps = episode.header, episode.frames - 1
    name = scenario.name if isinstance(scenario, Place) else scenario
    if header.scenario != name and (name != TOWN or header.description is None):
        hint = "" if header.description is None else f", or {TOWN!r}, which plays all recordings that carry their place"
        raise RecordingError(f"{episode.path} was recorded in {header.scenario!r}; accepted here: {name!r}{hint}")
    for key in TOWN_KEYS:
        if options.get(key) is not None:
            raise InvalidValueError(f"{key} must be left out with playback: {episode.path} carries its place")
    if not steps:
        raise RecordingError(f"{episode.path} holds a single frame and no step; accepted: at least two frames")
    asked = options.get("max_cycles", steps)
    require_count(1, max_cycles=asked)
    if asked > steps:
        raise InvalidValueError(f"max_cycles must be at most {steps}, as {episode.path} has no more steps, got {asked}")
    fixed = {**header.population, "dt_s": header.dt_s, "detail": header.detail}
    for name, value in fixed.items():
        if options.get(name, value) != value and (name, options[name]) != ("detail", None):
            raise InvalidValueError(f"{name} must be {value!r}, as {episode.path} was recorded, got {options[name]!r}")
    return {**options, **fixed, "max_cycles": asked}
