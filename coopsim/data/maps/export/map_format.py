"""Exports of places as maps: the formats by name, and the files that are written."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import fields
from pathlib import Path
from typing import Any

from coopsim.data.maps.export.town_network import TownNetwork, town_network
from coopsim.errors import InvalidValueError, UnknownNameError
from coopsim.support.checks import require_count
from coopsim.support.files import require_writable, write_whole
from coopsim.support.registry import Registry
from coopsim.world.drawn_options import PlaceSeeds, TownOptions
from coopsim.world.drawn_places import TOWN, TOWN_KEYS

MapFormat = Callable[[TownNetwork, Path], Mapping[Path, str]]
"""Returns the texts of files for a town, and for the path that the user names; raises `InvalidValueError` of paths."""

MAP_FORMATS: Registry[MapFormat] = Registry(
    "map format",
    home=("coopsim.data.maps.export.opendrive.document", "coopsim.data.maps.export.sumo.network"),
    group="coopsim.map_formats",
)
"""Formats in which `coopsim export` writes places. Installed packages add theirs through `coopsim.map_formats`."""


def export_map(format: str, place: str, out: str | Path, *, seed: int = 0, **options: Any) -> tuple[Path, ...]:  # noqa: A002
    """Write a drawn town as a map of another program. Return the files, all of them or none.

    Args:
        format: name of a map format, such as "opendrive".
        place: "town".
        out: the file; with SUMO's network, polygons are written beside it.
        seed: seed of an episode; the town is the one of that episode.
        **options: options of the town, such as `lanes=2` or `place_seed=7`.

    Raises:
        CoopsimError: the format, the place or an option is not known or not accepted; a file cannot be written, or
            exists and is another one; a program is missing.
    """
    write, path = MAP_FORMATS.get(format), Path(out)
    if place != TOWN:
        raise InvalidValueError(f"place must be {TOWN!r}: of other places {format} cannot be written, got {place!r}")
    for name in options:
        if name not in TOWN_KEYS:
            raise UnknownNameError("option of towns", name, TOWN_KEYS)
    require_count(0, seed=seed)
    require_writable(path)
    seeds, town = ({f.name: options[f.name] for f in fields(kind) if f.name in options} for kind in _KINDS)
    texts = write(town_network(PlaceSeeds(**seeds).of(seed), TownOptions(**town)), path)
    for file, text in texts.items():
        _require_free(file, text)
    return tuple(write_whole(file, text) for file, text in texts.items())


_KINDS: tuple[type[Any], ...] = (PlaceSeeds, TownOptions)


def require_suffix(path: Path, suffix: str) -> None:
    """Raise `InvalidValueError` unless a file's name ends as its format's do."""
    if not path.name.endswith(suffix) or path.name == suffix:
        raise InvalidValueError(f"the file must end in {suffix}, got {path.name!r}")


def _require_free(path: Path, text: str) -> None:
    """Refuse to replace a file that is not this very one."""
    require_writable(path)
    if path.is_file() and path.read_bytes() != text.encode():
        raise InvalidValueError(f"{path} exists, and has another content: remove it, or name another file")
