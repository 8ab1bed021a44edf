"""The layout that OPV2V and its successors share: `<scenario>/<agent>/<time stamp>.yaml`, `.pcd` and pictures.

Agents are folders whose names are integers: cars, and roadside units with negative ones. All agents of a scenario have
the same time stamps. A folder with scenarios may be below folders of splits ("train", "test").
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

from coopsim.data.recordings.file_fields import as_id, read_tagged_yaml
from coopsim.errors import RecordingError
from coopsim.recordings.recorded_folder import ReadingOptions, RecordedFolder, RecordedSequence
from coopsim.support.checks import require_choice

HEIGHT_M = {"cav": 1.9, "rsu": 4.27}
"""Usual heights of LiDARs over the ground: on a car's roof, and on a mast of 14 feet."""

_DEEPEST = 2  # folders between the one that is given and a scenario, as in root/train/scenario
_LOOKED_AT = 2000  # entries of a folder, until it is clear that it has no frame


@dataclass(frozen=True)
class StampedScenario:
    """Scenario: a folder of agents.

    Attributes:
        name: path relative to the folder that was given, or its own name if it is that folder.
    """

    name: str
    path: Path

    @cached_property
    def agents(self) -> tuple[tuple[str, ...], tuple[str, ...]]:
        """The folders of cars and those of roadside units, each in the order of their ids.

        Raises:
            RecordingError: a folder with frames has a name that is no integer.
        """
        found = sorted((as_id(entry.name, self.path, "an agent"), entry.name) for entry in _agent_folders(self.path))
        return tuple(name for key, name in found if key >= 0), tuple(name for key, name in found if key < 0)

    @cached_property
    def stamps(self) -> tuple[str, ...]:
        """The time stamps, in order.

        Raises:
            RecordingError: there is none, or the agents differ in them.
        """
        first, *others = [name for names in self.agents for name in names]
        stamps = _stamps(self.path / first)
        for name in others:
            for stamp in sorted(set(stamps) ^ (own := set(_stamps(self.path / name)))):
                has, lacks = (name, first) if stamp in own else (first, name)
                raise RecordingError(
                    f"{self.path}: agents must have the same time stamps, but {has} has {stamp} and {lacks} has not"
                )
        return stamps

    def first_frame(self) -> Path:
        """Return the YAML file of the first agent's first frame; the other agents need not have the same frames."""
        cars, masts = self.agents
        agent = (*cars, *masts)[0]
        return self.file(agent, _stamps(self.path / agent)[0], ".yaml")

    def file(self, agent: str, stamp: str, ending: str) -> Path:
        """Return the path of an agent's file, as with the ending ".yaml" or "_camera0.png"."""
        return self.path / agent / f"{stamp}{ending}"


@dataclass(frozen=True)
class StampedFolder(RecordedFolder):
    """A folder of this layout: a scenario, a split, or all of it."""

    usual_height_m = HEIGHT_M

    @cached_property
    def scenarios(self) -> dict[str, StampedScenario]:
        """The scenarios by name."""
        return find_scenarios(self.path)

    @property
    def sequences(self) -> tuple[str, ...]:
        return tuple(self.scenarios)

    def scenario(self, sequence: str) -> StampedScenario:
        """Return a scenario; raises `UnknownNameError` if there is none of that name."""
        require_choice("sequence", sequence, self.sequences, f"in {self.path}")
        return self.scenarios[sequence]


@dataclass(frozen=True)
class StampedSequence(RecordedSequence):
    """A scenario of this layout as a sequence."""

    scenario: StampedScenario
    options: ReadingOptions

    @property
    def frames(self) -> int:
        return len(self.scenario.stamps)


def find_scenarios(path: Path) -> dict[str, StampedScenario]:
    """Return the scenarios in a folder or below it, by name, sorted; empty where there are none."""
    found: dict[str, StampedScenario] = {}
    for place in sorted(_scenario_folders(path, _DEEPEST)):
        name = path.name if place == path else place.relative_to(path).as_posix()
        found[name or "scenario"] = StampedScenario(name, place)
    return found


def has_tables_of_poses(path: Path) -> bool | None:
    """Return whether the poses in a folder's first frame are tables (4, 4), as V2V4Real's; None: it has no scenario."""
    scenarios = find_scenarios(path)
    if not scenarios:
        return None
    frame = read_tagged_yaml(next(iter(scenarios.values())).first_frame())
    return frame.numbers("lidar_pose", (6,), (4, 4)).ndim == 2


def _scenario_folders(path: Path, deeper: int) -> Iterator[Path]:
    if next(_agent_folders(path), None) is not None:
        yield path
    elif deeper:
        for entry in _folders(path):
            yield from _scenario_folders(Path(entry.path), deeper - 1)


def _agent_folders(path: Path) -> Iterator[os.DirEntry[str]]:
    return (entry for entry in _folders(path) if _has_frames(entry.path))


def _folders(path: Path) -> list[os.DirEntry[str]]:
    with os.scandir(path) as entries:
        return [entry for entry in entries if entry.is_dir()]


def _has_frames(path: str) -> bool:
    with os.scandir(path) as entries:
        return any(_is_frame(entry.name) for _, entry in zip(range(_LOOKED_AT), entries, strict=False))


def _stamps(path: Path) -> tuple[str, ...]:
    names = sorted(name.removesuffix(".yaml") for name in os.listdir(path) if _is_frame(name))
    return tuple(sorted(names, key=int))


def _is_frame(name: str) -> bool:
    stem, dot, ending = name.partition(".")
    return ending == "yaml" and bool(dot) and stem.isascii() and stem.isdecimal()
