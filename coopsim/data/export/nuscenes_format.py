"""nuScenes: one scene per episode and agent, and checks of such folders; docs/reference/export.md has every field."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from coopsim.data.export.export_format import EXPORT_FORMATS, ExportFormat, require_lidar
from coopsim.data.export.export_frame import ExportFrame, ExportPlan
from coopsim.data.export.folder_checks import Problem
from coopsim.data.export.nuscenes_records import (
    SPLIT,
    VERSION,
    Records,
    SceneRecords,
    camera_channel,
    fixed_tables,
    lidar_channel,
    scene_name,
)
from coopsim.data.export.record_parts import RecordParts, as_line, token
from coopsim.data.files.pcd import read_float_points
from coopsim.data.recordings.file_fields import read_json
from coopsim.errors import InvalidValueError, RecordingError
from coopsim.support.checks import require_choice, require_positive
from coopsim.support.files import make_folder, write_whole, write_whole_bytes
from coopsim.support.pictures import encode_png, opened_picture
from coopsim.types import AgentSpec

GROWING = ("scene", "log", "sample", "sample_data", "sample_annotation", "instance", "calibrated_sensor", "ego_pose")
"""Tables whose records come with the frames."""

NO_MAP = "maps/none.png"
"""The tools want a picture for every map; this one is a black pixel, as no map is exported."""

POINTS = ("all", "own")


@EXPORT_FORMATS.register("nuscenes")
class NuscenesFormat(ExportFormat):
    """nuScenes' tables, with a scene per episode and agent, as a scene has one ego vehicle.

    Args:
        agent: name of the only agent to export; None: all, a scene each.
        key_frame_s: time between two key frames, which alone have annotations and results; in between are sweeps.
        points: returns that `num_lidar_pts` counts, by which the official tools choose what is scored: of "all"
            agents, so that what only others see counts, as in coopsim; or the scene's "own" agent's.
    """

    def __init__(self, agent: str | None = None, key_frame_s: float = 0.5, points: str = "all") -> None:
        require_positive(key_frame_s=key_frame_s)
        require_choice("points", points, POINTS)
        self._agent, self._key_frame_s, self._own = agent, key_frame_s, points == "own"

    def require(self, agents: Mapping[str, AgentSpec]) -> None:
        if self._agent is not None:
            require_choice("agent", self._agent, agents)
        self._specs = {name: each for name, each in agents.items() if self._agent in (None, name)}
        for name, each in self._specs.items():
            require_lidar(name, each)
            for camera, calibration in each.cameras.items():
                if calibration.distortion.any():
                    raise InvalidValueError(f"lenses must not distort in this format, {camera} of {name} does")

    def begin(self, folder: Path, plan: ExportPlan) -> None:
        self._root, self._plan = folder, plan
        self._tables = RecordParts(folder, [f"{VERSION}/{name}" for name in GROWING])

    def begin_episode(self, seed: int) -> None:
        self._episode = self._plan.episode_name(seed)
        self._scenes: list[SceneRecords] = []
        self._tables.begin_episode(self._episode)

    def write(self, frame: ExportFrame) -> None:
        if frame.index == 0:
            every = self.key_every(next(iter(self._specs.values())).dt_s)
            self._scenes = [
                SceneRecords(
                    scene_name(self._episode, agent.name), column, self._plan.frames, every, own_points=self._own
                )
                for column, agent in enumerate(frame.agents)
                if agent.name in self._specs
            ]
        for scene in self._scenes:
            records, files = scene.add(frame)
            for name, content in files.items():
                make_folder((self._root / name).parent)
                write_whole_bytes(self._root / name, content)
            self._append(records)

    def end_episode(self) -> None:
        for scene in self._scenes:
            self._append(scene.end())
        self._tables.end_episode()

    def end(self) -> None:
        folder = self._root / VERSION
        make_folder(folder)
        episodes = [self._plan.episode_name(seed) for seed in self._plan.seeds]
        scenes = [scene_name(episode, agent) for episode in episodes for agent in self._specs]
        channels: dict[str, str] = {}
        for spec in self._specs.values():
            channels |= {lidar_channel(name, position): "lidar" for position, name in enumerate(spec.lidars)}
            channels |= {camera_channel(name): "camera" for name in spec.cameras}
        tables = fixed_tables()
        tables["sensor"] = [
            {"token": token("sensor", channel), "channel": channel, "modality": modality}
            for channel, modality in channels.items()
        ]
        logs = [token(scene, "log") for scene in scenes]
        tables["map"] = [{"token": token("map"), "log_tokens": logs, "category": "semantic_prior", "filename": NO_MAP}]
        for name, records in tables.items():
            write_whole(folder / f"{name}.json", "[\n" + ",\n".join(map(as_line, records)) + "\n]\n")
        write_whole(folder / "splits.json", json.dumps({SPLIT: scenes}, indent=0) + "\n")
        make_folder((self._root / NO_MAP).parent)
        write_whole_bytes(self._root / NO_MAP, encode_png(np.zeros((1, 1), np.uint8)))
        self._tables.join(episodes)

    def check(self, folder: Path) -> Iterator[Problem]:
        return check_nuscenes(folder)

    def key_every(self, dt_s: float) -> int:
        """Return every how many frames of `dt_s` there is a key frame."""
        return max(round(self._key_frame_s / dt_s), 1)

    def exports(self, agent: str) -> bool:
        """Return whether an agent has scenes."""
        return self._agent in (None, agent)

    def _append(self, records: Records) -> None:
        for name, each in records.items():
            self._tables.append(f"{VERSION}/{name}", each)


LINKS: Mapping[str, Mapping[str, str]] = {
    "map": {"log_tokens": "log"},
    "scene": {"log_token": "log", "first_sample_token": "sample", "last_sample_token": "sample"},
    "calibrated_sensor": {"sensor_token": "sensor"},
    "sample": {"scene_token": "scene", "prev": "sample", "next": "sample"},
    "sample_data": {
        "sample_token": "sample",
        "ego_pose_token": "ego_pose",
        "calibrated_sensor_token": "calibrated_sensor",
        "prev": "sample_data",
        "next": "sample_data",
    },
    "sample_annotation": {
        "sample_token": "sample",
        "instance_token": "instance",
        "visibility_token": "visibility",
        "attribute_tokens": "attribute",
        "prev": "sample_annotation",
        "next": "sample_annotation",
    },
    "instance": {
        "category_token": "category",
        "first_annotation_token": "sample_annotation",
        "last_annotation_token": "sample_annotation",
    },
}
"""Fields that hold a token of another table, or a list of them."""

_MAY_BE_EMPTY = ("prev", "next")


TABLES = (*LINKS, "ego_pose", "category", "attribute", "visibility", "sensor", "log")


def check_nuscenes(folder: Path) -> Iterator[Problem]:
    """Yield what is wrong in a folder with tables in `v1.0-...`, `samples` and `sweeps`."""
    versions = sorted(path for path in folder.glob("v1.0-*") if path.is_dir())
    if not versions:
        yield Problem("", "", "there are no tables: DIR must hold a folder v1.0-...")
    for version in versions:
        yield from _check_version(folder, version.name)


def _check_version(folder: Path, version: str) -> Iterator[Problem]:
    tokens: dict[str, set[str]] = {}
    for name in TABLES:  # one table at a time: they may be large
        file, tokens[name] = f"{version}/{name}.json", set()
        try:
            records = _records(folder / file)
        except RecordingError as error:
            yield Problem(file, "", str(error).replace(f"{folder / file}", "the file"))
            continue
        for number, record in enumerate(records):
            token, filename = record.get("token"), record.get("filename")
            if not isinstance(token, str) or not token or token in tokens[name]:
                yield Problem(file, f"[{number}].token", f"must be a text that stands once, got {token!r}")
            tokens[name].add(str(token))
            if isinstance(filename, str) and filename:
                yield from _check_file(folder, filename)
    for name, links in LINKS.items():
        file = f"{version}/{name}.json"
        for number, record in enumerate(_records(folder / file) if tokens[name] else ()):
            for field, other in links.items():
                value = record.get(field)
                for each in value if isinstance(value, list) else [value]:
                    if str(each) not in tokens[other] and not (each == "" and field in _MAY_BE_EMPTY):
                        yield Problem(file, f"[{number}].{field}", f"must be a token of {other}.json, got {each!r}")


def _records(path: Path) -> list[Mapping[str, Any]]:
    records = read_json(path)
    if not (isinstance(records, list) and all(isinstance(each, Mapping) for each in records)):
        raise RecordingError(f"{path} must be a list of records")
    return records


def _check_file(folder: Path, name: str) -> Iterator[Problem]:
    path = folder / name
    try:
        if name.endswith(".bin"):
            read_float_points(path, 5)
        else:
            with opened_picture(path) as picture:
                picture.load()
    except RecordingError as error:
        yield Problem(name, "", str(error).removeprefix(f"{path}: ").replace(f"{path}", "the file"))
