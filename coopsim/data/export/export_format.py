"""Formats of exports: the plan that they are given, their interface, and the formats by name."""

from __future__ import annotations

import os
from abc import ABC, abstractmethod
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any, ClassVar

from coopsim.config.spec import instantiate, parse_spec
from coopsim.data.export.export_frame import ExportFrame, ExportPlan
from coopsim.data.export.folder_checks import Problem, check_by_reading
from coopsim.errors import InvalidValueError
from coopsim.support.checks import require_choice
from coopsim.support.files import note_written
from coopsim.support.registry import Registry
from coopsim.types import AgentSpec

EXPORT_FORMATS: Registry[type[ExportFormat]] = Registry(
    "export format", home="coopsim.data.export.shipped_formats", group="coopsim.export_formats"
)
"""Formats of `coopsim export`. Installed packages add theirs through the entry-point group `coopsim.export_formats`."""


class ExportFormat(ABC):
    """Writes episodes in one format, and checks folders of it.

    The parameters of its constructor are those of its spec, `name(parameter=value)`. The calls of an export are, in
    order: `begin`; for each episode `begin_episode`, `write` for each frame, `end_episode`; `end`.

    An export that was interrupted goes on in another process: finished episodes are left out, the one that was
    interrupted is written again from its first frame, `begin` and `end` are called as ever. So every file is written
    whole (`coopsim.support.files`), nothing of a finished episode may be needed in memory afterwards, and what `end`
    puts together it reads from the folder. Files must depend on the frames alone: no times, no random names.
    """

    usual_options: ClassVar[Mapping[str, Any]] = {}
    """Options of the environment that the format needs, unless the user gives others, as `{"cameras": "surround"}`."""

    reader: ClassVar[str | None] = None
    """Name of the format of recordings that reads the folder, for `check`; a format without one overrides `check`."""

    def require(self, agents: Mapping[str, AgentSpec]) -> None:
        """Raise `InvalidValueError` if these agents, by name, cannot be exported, as when they lack a camera.

        Asked before anything is written.
        """

    @abstractmethod
    def begin(self, folder: Path, plan: ExportPlan) -> None:
        """Begin, or go on with, an export into an existing folder."""

    def begin_episode(self, seed: int) -> None:
        """Begin an episode; `plan.episode_name(seed)` names it. What an interrupted one left may be overwritten."""

    @abstractmethod
    def write(self, frame: ExportFrame) -> None:
        """Write a frame of the episode that was begun last; called in the order of frames."""

    def end_episode(self) -> None:
        """End the episode: afterwards it counts as finished."""

    def end(self) -> None:
        """End the export: write what spans episodes, from what is in the folder."""

    def check(self, folder: Path) -> Iterator[Problem]:
        """Yield the faults of a folder of this format, which need not be one that coopsim wrote."""
        return iter(()) if self.reader is None else check_by_reading(folder, self.reader)


def require_lidar(name: str, spec: AgentSpec, lidar: str | None = None) -> None:
    """Raise `InvalidValueError` if an agent has no LiDAR, or none of that name."""
    if not spec.lidars:
        raise InvalidValueError(f"every agent needs a LiDAR in this format, {name} has none")
    if lidar is not None:
        require_choice("lidar", lidar, spec.lidars, f"of {name}")


def make_export_format(spec: str) -> ExportFormat:
    """Make the format of a spec, as "opv2v" or "kitti(agent=cav_1)".

    Raises:
        UnknownNameError: there is no such format or parameter; the message lists the close ones.
        InvalidValueError: the spec has another shape, or a value is not accepted.
    """
    name, parameters = parse_spec("export format", spec)
    return instantiate("export format", name, EXPORT_FORMATS.get(name), parameters)


class LineFile:
    """A text file of which lines are appended; it gets its name when it is closed.

    Until then it is called `<name>.tmp`. What an interrupted writer left under that name is overwritten.

    Raises:
        InvalidValueError: the file cannot be written, also by `append` and `close`.
    """

    def __init__(self, path: Path) -> None:
        self._path, self._part = path, path.with_name(f"{path.name}.tmp")
        self._write("w", ())

    def append(self, *lines: str) -> None:
        """Append lines; ends of lines are added."""
        self._write("a", lines)

    def close(self) -> None:
        """End the file and give it its name."""
        try:
            os.replace(self._part, self._path)
            note_written(self._path)
        except OSError as error:
            raise self._failed(error) from error

    def discard(self) -> None:
        """Remove what was written; for writers that do not go on later."""
        self._part.unlink(missing_ok=True)

    def _write(self, mode: str, lines: Iterable[str]) -> None:
        try:
            # Opened for each call: an export that is given up leaves no open files.
            with self._part.open(mode, encoding="utf-8", newline="\n") as file:
                file.writelines(f"{line}\n" for line in lines)
        except OSError as error:
            raise self._failed(error) from error

    def _failed(self, error: OSError) -> InvalidValueError:
        return InvalidValueError(f"cannot write {self._path}: {error.strerror or error}")
