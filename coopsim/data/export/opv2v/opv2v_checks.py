"""Checks of OPV2V's folders: what its readers need, file by file."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import yaml

from coopsim.config.yaml_file import load_bounded
from coopsim.data.export.json_checks import is_number
from coopsim.data.export.picture_checks import check_picture
from coopsim.data.export.problem import Problem
from coopsim.data.files.pcd import read_pcd
from coopsim.errors import RecordingError

POSES = ("lidar_pose", "true_ego_pos", "predicted_ego_pos")
OBJECT_VECTORS = ("angle", "center", "extent", "location")

_LOADER = getattr(yaml, "CSafeLoader", yaml.SafeLoader)  # the quick one, where PyYAML was built with it


def check_opv2v(folder: Path) -> Iterator[Problem]:
    """Yield what is wrong in a folder of scenarios."""
    scenarios = sorted(path for path in folder.iterdir() if path.is_dir())
    if not scenarios:
        yield Problem("", "", "there is no scenario: DIR must hold <scenario>/<agent>/<frame>.yaml")
    for scenario in scenarios:
        for problem in _check_scenario(scenario):
            yield Problem((Path(scenario.name) / problem.file).as_posix(), problem.field, problem.reason)


def _check_scenario(scenario: Path) -> Iterator[Problem]:
    agents = sorted(path.name for path in scenario.iterdir() if path.is_dir())
    wrong = [name for name in agents if not name.removeprefix("-").isdecimal()]
    for name in wrong:
        yield Problem(name, "", "the name of an agent's folder must be an integer, negative for a roadside unit")
    agents = [name for name in agents if name not in wrong]
    if not agents:
        yield Problem("", "", "there is no agent: a scenario must hold <agent>/<frame>.yaml")
    if len({len(name) for name in agents if not name.startswith("-")}) > 1:
        yield Problem("", "", f"agents must have numbers of one length, as they are sorted as texts, got {agents}")
    if sum(name.startswith("-") for name in agents) > 1:
        yield Problem("", "", f"only one agent may have a negative number, or a roadside unit is the ego, got {agents}")
    frames = {name: sorted(path.stem for path in (scenario / name).glob("*.yaml")) for name in agents}
    everywhere = sorted(set().union(*frames.values()))
    for name, own in frames.items():
        for stem in everywhere:
            file = f"{name}/{stem}"
            if stem not in own:
                yield Problem(f"{file}.yaml", "", "is missing: every agent must have every frame")
            else:
                yield from _check_frame(scenario, file)


def _check_frame(scenario: Path, file: str) -> Iterator[Problem]:
    try:
        read_pcd(scenario / f"{file}.pcd")
    except RecordingError as error:
        yield Problem(f"{file}.pcd", "", str(error).removeprefix(f"{scenario / file}.pcd: "))
    try:
        content = load_bounded(_LOADER((scenario / f"{file}.yaml").read_text(encoding="utf-8")))
    except (OSError, ValueError, RecursionError, yaml.YAMLError) as error:
        yield Problem(f"{file}.yaml", "", f"cannot be read: {' '.join(str(error).split())}")
        return
    if not isinstance(content, Mapping):
        yield Problem(f"{file}.yaml", "", "must be a mapping")
        return
    for field, reason in _wrong_fields(content):
        yield Problem(f"{file}.yaml", field, reason)
    for key in content:
        if isinstance(key, str) and key.startswith("camera") and key[6:].isdecimal():
            picture = f"{file}_{key}.png"
            yield from check_picture(scenario / picture, picture)


def _wrong_fields(content: Mapping[Any, Any]) -> Iterator[tuple[str, str]]:
    """Yield the fields of an agent's frame that are wrong, and what is accepted."""
    for pose in POSES:
        if not _are_numbers(content.get(pose), 6):
            yield pose, f"must be x, y, z (m), roll, yaw, pitch (degrees), got {content.get(pose)!r}"
    if not is_number(content.get("ego_speed")):
        yield "ego_speed", f"must be a number of km/h, got {content.get('ego_speed')!r}"
    for key in ("vehicles", "others") if "others" in content else ("vehicles",):
        objects = content.get(key)
        if not isinstance(objects, Mapping):
            yield key, f"must be objects by number, got {objects!r}"
            continue
        for number, each in objects.items():
            yield from ((f"{key}.{number}{field}", reason) for field, reason in _wrong_object(number, each))
    for key, camera in content.items():
        if isinstance(key, str) and key.startswith("camera") and key[6:].isdecimal():
            yield from ((f"{key}.{field}", reason) for field, reason in _wrong_camera(camera))


def _wrong_object(number: object, content: object) -> Iterator[tuple[str, str]]:
    if isinstance(number, bool) or not isinstance(number, int):
        yield "", f"the number of an object must be an integer, got {number!r}"
    if not isinstance(content, Mapping):
        yield "", f"must be a mapping with {', '.join(OBJECT_VECTORS)} and speed, got {content!r}"
        return
    for field in OBJECT_VECTORS:
        if not _are_numbers(content.get(field), 3):
            yield f".{field}", f"must be three numbers, got {content.get(field)!r}"
        elif field == "extent" and min(content[field]) <= 0:
            yield ".extent", f"half length, width and height must be > 0 m, got {content[field]!r}"
    if not is_number(content.get("speed")):
        yield ".speed", f"must be a number of km/h, got {content.get('speed')!r}"


def _wrong_camera(camera: object) -> Iterator[tuple[str, str]]:
    given = camera if isinstance(camera, Mapping) else {}
    if not _are_numbers(given.get("cords"), 6):
        yield "cords", "must be x, y, z (m), roll, yaw, pitch (degrees)"
    for field, size in (("intrinsic", 3), ("extrinsic", 4)):
        rows = given.get(field)
        if not (isinstance(rows, Sequence) and len(rows) == size and all(_are_numbers(row, size) for row in rows)):
            yield field, f"must be a matrix of {size} x {size} numbers"


def _are_numbers(value: object, count: int) -> bool:
    if isinstance(value, str) or not isinstance(value, Sequence):
        return False
    return len(value) == count and all(is_number(each) for each in value)
