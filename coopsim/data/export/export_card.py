"""The card of an export: what a folder holds, and how far it is.

`export.json` is for programs, `README.md` for people. Neither has a time, so the same export ends in the same bytes.
"""

from __future__ import annotations

import json
import os
from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from coopsim.data.export.export_frame import ExportAgent, ExportFrame, ExportPlan
from coopsim.data.export.folder_checks import SUMS, Problem, check_sums, files_below, write_sums
from coopsim.errors import ExportError, InvalidValueError
from coopsim.support.arrays import runs_of
from coopsim.support.files import LOCK, WrittenFiles, write_durably, write_whole
from coopsim.support.pictures import encode_png
from coopsim.viz.bev import BevFrame, BevRenderer
from coopsim.world.snapshot import Actors, RoadMap

CARD, PAGE, PICTURE = "export.json", "README.md", "picture.png"

WRITING, DONE = "writing", "done"
"""States of an export."""

_SUFFIX_OF_UNFINISHED = ".tmp"
_UNLISTED = (CARD, PAGE)
_NO_ARGUMENTS = ("state", "episodes", "files", "bytes")


@dataclass(slots=True)
class EpisodeCounts:
    """Contents of an episode.

    Attributes:
        agents: their names.
        points: points of all sweeps.
        pictures: pictures of all cameras.
        objects: objects that some agent's LiDAR hit, counted anew in each frame.
    """

    agents: list[str] = field(default_factory=list)
    points: int = 0
    pictures: int = 0
    objects: int = 0


class ExportCard:
    """The card of a folder: opened by `open_card`, written after each episode."""

    def __init__(self, folder: Path, facts: Mapping[str, Any]) -> None:
        self.folder, self.facts = folder, facts
        self.episodes: dict[int, EpisodeCounts] = {}
        self.done = False
        self._sizes: dict[str, int] = {}

    def write(self) -> None:
        """Write `export.json`."""
        content = {
            **self.facts,
            "state": DONE if self.done else WRITING,
            "episodes": {str(seed): asdict(counts) for seed, counts in self.episodes.items()},
            **self._sizes,
        }
        write_durably(self.folder / CARD, (json.dumps(content, indent=2) + "\n").encode())

    def finish(self, written: WrittenFiles) -> None:
        """Write checksums, the page for people, and, once all of it is on the disk, that the export is done."""
        files, size = write_sums(self.folder, _UNLISTED)
        self._sizes = {"files": files, "bytes": size}
        write_whole(self.folder / PAGE, self._page())
        written.sync()
        self.done = True
        self.write()

    def _page(self) -> str:
        facts, episodes = self.facts, list(self.episodes.values())
        agents = sorted({name for counts in episodes for name in counts.agents})
        options = ", ".join(f"{name}={value}" for name, value in facts["options"].items())
        rows = {
            "format": facts["format"],
            "environment": facts["environment"],
            "options": options or "the environment's own",
            "seeds": _ranges(facts["seeds"]),
            "frames of each seed": facts["frames"],
            "agents": ", ".join(agents),
            "points": sum(counts.points for counts in episodes),
            "pictures": sum(counts.pictures for counts in episodes),
            "boxes of hit objects": sum(counts.objects for counts in episodes),
            "files": self._sizes["files"],
            "size": f"{self._sizes['bytes'] / 1e6:.1f} MB",
            "made by": ", ".join(f"{name} {number}" for name, number in facts["versions"].items()),
        }
        lines = [f"| {name} | {value} |" for name, value in rows.items()]
        return "\n".join(
            [
                f"# {facts['environment']} as {facts['format']}",
                "",
                "Simulated cooperative perception, exported by `coopsim export`.",
                "",
                f"![a frame of seed {facts['seeds'][0]}]({PICTURE})",
                "",
                "| | |",
                "|---|---|",
                *lines,
                "",
                f"`{SUMS}` has a checksum of every file; `coopsim check-export` checks them and the format.",
                "",
            ]
        )


def open_card(folder: Path, plan: ExportPlan) -> ExportCard:
    """Open the card of an existing folder: a new one, or that of the export to go on with.

    Raises:
        ExportError: the folder holds something else, or an export with other arguments; the message says which.
        InvalidValueError: the folder cannot be written.
    """
    if not os.access(folder, os.W_OK):
        raise InvalidValueError(f"cannot write into the folder {folder}: permission denied")
    card = ExportCard(folder, plan.facts())
    if not (folder / CARD).exists():
        if any(path.name != LOCK and path.suffix != _SUFFIX_OF_UNFINISHED for path in folder.iterdir()):
            raise ExportError(f"{folder} must be new, empty, or hold the export to go on with (a file {CARD})")
        card.write()
        return card
    content = read_card(folder)
    given = {name: value for name, value in content.items() if name not in _NO_ARGUMENTS}
    differing = [name for name in sorted({*card.facts, *given}) if card.facts.get(name) != given.get(name)]
    if differing:
        told = "; ".join(f"{name} is {given.get(name)!r} there, {card.facts.get(name)!r} here" for name in differing)
        raise ExportError(f"{folder} holds an export with other arguments: {told}. Choose another folder")
    card.episodes = {int(seed): EpisodeCounts(**counts) for seed, counts in content["episodes"].items()}
    card.done = content["state"] == DONE
    if not card.done:
        _remove_unfinished(folder)
    return card


def read_card(folder: Path) -> dict[str, Any]:
    """Read `export.json`.

    Raises:
        ExportError: it is missing or broken; the message names it and the field.
    """
    path = folder / CARD
    try:
        content: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError) as error:
        raise ExportError(f"{path} cannot be read: {error}") from error
    wanted = {
        "format": str,
        "seeds": list,
        "frames": int,
        "state": str,
        "episodes": dict,
        "environment": str,
        "options": dict,
    }
    for name, kind in wanted.items():
        if not isinstance(content, dict) or not isinstance(content.get(name), kind):
            raise ExportError(f"{path}: {name} must be a {kind.__name__}")
    counted = {"agents", "points", "pictures", "objects"}
    for seed, counts in content["episodes"].items():
        if not (seed.isdecimal() and isinstance(counts, dict) and set(counts) == counted):
            raise ExportError(f"{path}: episodes.{seed} must have {', '.join(sorted(counted))}")
    return content


def check_card(folder: Path) -> Iterator[Problem]:
    """Yield what is wrong with an export, whatever its format: its state, and files that are not as they were written.

    Raises:
        ExportError: `read_card` refuses it.
    """
    content = read_card(folder)
    if content["state"] != DONE:
        told = f"{len(content['episodes'])} of {len(content['seeds'])} seeds are there"
        yield Problem(CARD, "state", f"the export was interrupted ({told}): run the same command again")
        return
    yield from check_sums(folder, _UNLISTED)


def _remove_unfinished(folder: Path) -> None:
    """Remove the temporary files that a killed command left."""
    for path in files_below(folder):
        if path.name.endswith(_SUFFIX_OF_UNFINISHED):
            path.unlink(missing_ok=True)


def _ranges(seeds: list[int]) -> str:
    """Return seeds as a user gives them, as "0-4, 7"."""
    return ", ".join(f"{run[0]}-{run[-1]}" if len(run) > 1 else str(run[0]) for run in runs_of(seeds))


def frame_picture(frame: ExportFrame, road_map: RoadMap) -> bytes:
    """Return a PNG of the exported points, boxes and agents over the map, and pictures of cameras where there are any.

    Points are moved from their sensors' frames to the world by the exported poses, so a wrong pose shows.
    """
    objects = frame.objects
    count = len(objects)
    plain = np.zeros(count, np.int64), np.zeros((count, 3), np.uint8)
    actors = Actors(objects.id, objects.boxes, frame.velocity, objects.label, *plain)
    points = [
        agent.world_SE3_base.compose(scan.mounting.base_SE3_lidar).apply(scan.points)
        for agent in frame.agents
        for scan in agent.lidars.values()
    ]
    bodies = {agent.name: agent.body for agent in frame.agents}
    all_points = np.concatenate(points) if points else np.zeros((0, 3))
    renderer = BevRenderer(road_map)
    picture = renderer.draw(BevFrame(frame.time_ns, actors, bodies, all_points, {}))
    renderer.close()
    strips = [_strip(agent, picture.shape[1]) for agent in frame.agents if agent.cameras]
    return encode_png(np.concatenate([picture, *strips[:1]]))


def _strip(agent: ExportAgent, width: int) -> NDArray[np.uint8]:
    """Return an agent's pictures side by side, scaled to a width in pixels together."""
    shots = [shot.image.rgb for shot in agent.cameras.values() if shot.image.rgb is not None]
    if not shots:
        return np.zeros((0, width, 3), np.uint8)
    edges = np.linspace(0, width, len(shots) + 1).round().astype(int)
    height = max(round(shot.shape[0] * width / len(shots) / shot.shape[1]) for shot in shots)
    parts = [
        np.asarray(Image.fromarray(shot).resize((int(right - left), height)))
        for shot, left, right in zip(shots, edges[:-1], edges[1:], strict=True)
    ]
    return np.concatenate(parts, axis=1)
