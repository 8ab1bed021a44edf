"""Label files of KITTI tracking and V2V4Real as logs: `labels/<sequence>.txt`, and at will `poses/<sequence>.txt`.

With poses the log's plane is that of the car's first frame; its tilt is left out. Without them it is the car's own in
each frame: the car stands at the origin, and what stands in the world moves.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from coopsim.data.kitti import read_labels, read_poses
from coopsim.data.logs.filling import SIZES_M, Columns
from coopsim.errors import LogFileError
from coopsim.geometry.se3 import SE3, wrap_angle
from coopsim.types.taxonomy import ObjectClass

FRAME_S = 0.1
"""Time between two frames of both data sets."""

_OWNER = "ego"


def is_text_folder(folder: Path) -> bool:
    """Return whether a folder has label files of sequences, and not of single clouds."""
    return (folder / "labels").is_dir() and not (folder / "points").is_dir()


def text_columns(folder: Path, sequence: str | None = None) -> tuple[str, Columns]:
    """Return the name of a sequence, and its columns; the car that recorded is a road user at the files' origin.

    Args:
        folder: the folder above `labels`.
        sequence: name of a file there; None: the first.

    Raises:
        LogFileError: there is no such file, or no object in it.
        RecordingError: a file is broken; names the line.
    """
    names = sorted(file.stem for file in (folder / "labels").glob("*.txt"))
    name = names[0] if sequence is None and names else sequence
    if name not in names:
        there = ", ".join(names[:20]) or "none"
        raise LogFileError(f"{folder}/labels has no sequence {name!r}; accepted: {there}")
    path = folder / "labels" / f"{name}.txt"
    frame, number, boxes, label, last = read_labels(path, _axes_of(path))
    if not len(frame):
        raise LogFileError(f"{path}: there is no road user in it")
    pose_file = folder / "poses" / f"{name}.txt"
    poses = [SE3.identity()] * (last + 1)
    if pose_file.is_file():
        poses = read_poses(pose_file, last + 1, _axes_of(path))
    rotation, moved = (np.stack([getattr(pose, part) for pose in poses]) for part in ("rotation", "translation"))
    yaw = np.array([pose.yaw for pose in poses])
    bottom = boxes.center - [0.0, 0.0, 0.5] * boxes.size
    place = np.concatenate([np.einsum("nij,nj->ni", rotation[frame], bottom) + moved[frame], moved])
    size = np.concatenate([boxes.size, np.tile(SIZES_M[ObjectClass.CAR], (last + 1, 1))])
    return name, Columns(
        where=("label", 1),
        time_s=FRAME_S * np.append(frame, np.arange(last + 1)),
        id=np.append(number.astype(str), np.repeat(_OWNER, last + 1)),
        label=np.append(label, np.repeat(int(ObjectClass.CAR), last + 1)),
        xy=place[:, :2],
        z_m=place[:, 2],
        heading=wrap_angle(np.append(boxes.yaw + yaw[frame], yaw)),
        size=size,
        step_s=FRAME_S,
        owner=_OWNER,
    )


def _axes_of(path: Path) -> str:
    """Return the convention of a label file's axes: V2V4Real has no pictures, and 0 for boxes in them."""
    with path.open(encoding="utf-8-sig", errors="replace") as file:
        picture = file.readline().split()[6:10]
    return "v2v4real" if picture and all(part.strip("0.") == "" for part in picture) else "kitti"
