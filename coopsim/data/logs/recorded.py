"""Labels of folders with recordings as logs: nuScenes, KITTI tracking, Argoverse 2, V2V4Real, OPV2V, V2X-Seq.

All formats of `coopsim.recordings.formats` are read, as `coopsim replay` does; sweeps and pictures are not opened.
The cars that recorded are road users, too: by their own labels where they have some, else as a car at their pose.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from coopsim.data.logs.filling import SIZES_M, Columns
from coopsim.errors import LogFileError
from coopsim.geometry import exact
from coopsim.recordings.formats import open_folder
from coopsim.recordings.recorded_folder import RecordedFrame, RecordedName
from coopsim.types.taxonomy import ObjectClass

_OWN_M = 1.5
"""Distance of a label's middle to an agent's base within which it is the agent's own."""


def recorded_columns(path: Path, sequence: str | None = None) -> tuple[str, Columns]:
    """Return the name of a sequence, and its columns.

    Args:
        path: a folder of recordings.
        sequence: name of one of its sequences; None: the first.

    Raises:
        LogFileError: a sequence has no objects.
        RecordingError: the folder has no known format, or a file is missing or broken.
    """
    folder = open_folder(path)
    opened = folder.open(folder.sequences[0] if sequence is None else sequence)
    cars = [name for name, agent in opened.agents.items() if agent.kind == "cav"]
    times: list[float] = []
    names: list[str] = []
    labels: list[int] = []
    rows: list[list[float]] = []
    for number in range(opened.frames):
        frame = opened.frame(number)
        found = _objects(frame)
        found += [_own_row(frame, name, opened.agents[name]) for name in cars if not _is_labelled(frame, name)]
        for name, label, row in found:
            times.append(frame.time_ns / 1e9)
            names.append(name)
            labels.append(label)
            rows.append(row)
    if not rows:
        raise LogFileError(f"{path}, sequence {opened.name}: there is no road user in it")
    table = np.array(rows)
    return opened.name, Columns(
        where=("label", 1),
        time_s=np.array(times),
        id=np.array(names, str),
        label=np.array(labels, np.int64),
        xy=table[:, :2],
        z_m=table[:, 2] - table[:, 5] / 2,
        heading=table[:, 6],
        size=table[:, 3:6],
        owner=opened.agents[cars[0]].recorded if cars else None,
    )


def _objects(frame: RecordedFrame) -> list[tuple[str, int, list[float]]]:
    own = {agent.object_id: name for name, agent in frame.agents.items() if agent.object_id is not None}
    objects = frame.objects
    return [
        (own.get(number, str(number)), label, row)
        for number, label, row in zip(
            objects.id.tolist(), objects.label.tolist(), objects.boxes.array.tolist(), strict=True
        )
    ]


def _is_labelled(frame: RecordedFrame, name: str) -> bool:
    agent = frame.agents[name]
    if agent.object_id is not None and (frame.objects.id == agent.object_id).any():
        return True
    away = frame.objects.boxes.center[:, :2] - agent.world_SE3_base.translation[:2]
    return bool((exact.norm(away) < _OWN_M).any())


def _own_row(frame: RecordedFrame, name: str, recorded: RecordedName) -> tuple[str, int, list[float]]:
    pose, size = frame.agents[name].world_SE3_base, SIZES_M[ObjectClass.CAR]
    x, y, z = pose.translation.tolist()
    return recorded.recorded, int(ObjectClass.CAR), [x, y, z + size[2] / 2, *size, float(pose.yaw)]
