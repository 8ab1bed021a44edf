"""Formats of folders with recordings, by name and by a look."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path

from coopsim.data.recordings.file_fields import read_tagged_yaml
from coopsim.data.recordings.opv2v_folder import Opv2vFolder
from coopsim.data.recordings.recorded_folder import ReadingOptions, RecordedFolder
from coopsim.data.recordings.spd_folder import SpdFolder
from coopsim.data.recordings.stamped_folders import find_scenarios
from coopsim.data.recordings.v2v4real_folder import V2v4realFolder
from coopsim.data.single_car.argoverse2_folder import Argoverse2Folder, find_logs
from coopsim.data.single_car.array_folder import POINTS, ArrayFolder
from coopsim.data.single_car.kitti_object_folder import KittiObjectFolder
from coopsim.data.single_car.kitti_tracking_folder import KittiTrackingFolder
from coopsim.data.single_car.nuscenes_folder import NuscenesFolder
from coopsim.data.single_car.nuscenes_tables import find_tables
from coopsim.errors import InvalidValueError, RecordingError
from coopsim.support.checks import require_choice

TEXT = "text"
"""The format without sweeps: `coopsim.data.recording_set`."""

AUTO = "auto"

FOLDERS: Mapping[str, Callable[[Path, ReadingOptions], RecordedFolder]] = {
    "opv2v": Opv2vFolder,
    "v2v4real": V2v4realFolder,
    "spd": SpdFolder,
    "kitti": KittiTrackingFolder,
    "kitti_object": KittiObjectFolder,
    "argoverse2": Argoverse2Folder,
    "nuscenes": NuscenesFolder,
    "arrays": ArrayFolder,
}
"""Formats with sweeps, by name."""

FORMATS = (AUTO, TEXT, *FOLDERS)

LAYOUTS = (
    "labels/<sequence>.txt with detections/<name>/ (text)",
    "<scenario>/<agent id>/<time stamp>.yaml with .pcd (OPV2V, V2XSet, V2V4Real)",
    "cooperative/data_info.json with vehicle-side/ and infrastructure-side/ (V2X-Seq-SPD)",
    "velodyne/<sequence>/<frame>.bin with label_02/ (KITTI tracking)",
    "velodyne/<frame>.bin with label_2/ and calib/ (KITTI object)",
    "<log>/sensors/lidar/<ns>.feather with annotations.feather (Argoverse 2)",
    "v1.0-<version>/scene.json with samples/ (nuScenes)",
    "<sequence>_<number>.npz, or points/<frame>.npy with labels/ (arrays)",
)
"""What is looked for, in words."""


def find_format(path: str | Path) -> str:
    """Return the name of a folder's format, found by the names in it and, for OPV2V's layout, by a look at one frame.

    Raises:
        InvalidValueError: `path` is no path.
        RecordingError: there is no such folder, or it has no known format; says what was looked for.
    """
    if not isinstance(path, (str, Path)):
        raise InvalidValueError(f"path must be the folder of a recording set, got {path!r}; one has {_any_layout()}")
    folder = Path(path)
    try:
        return _find(folder)
    except OSError as error:
        raise RecordingError(f"cannot read {path}: {error.strerror or error}") from error


def open_folder(path: str | Path, options: ReadingOptions | None = None, name: str = AUTO) -> RecordedFolder:
    """Return a folder with sweeps, as its format reads it; no frame is read but one to tell formats apart.

    Args:
        path: the folder.
        options: choices that its files leave open.
        name: name of the format; "auto" finds it.

    Raises:
        UnknownNameError: there is no such format.
        RecordingError: the folder is none of this format, or has no sequence.
    """
    require_choice("format", name, (AUTO, *FOLDERS))
    found = find_format(path) if name == AUTO else name
    if found == TEXT:
        raise RecordingError(f"{path} has detections in text files, and no sweeps; needed: {'; or '.join(LAYOUTS[1:])}")
    try:
        folder = FOLDERS[found](Path(path), options or ReadingOptions())
        sequences = folder.sequences
    except OSError as error:
        raise RecordingError(f"cannot read {path}: {error.strerror or error}") from error
    if not sequences:
        raise RecordingError(f"{path} has no recordings of format {found!r}; looked for: {_any_layout()}")
    return folder


def _find(path: Path) -> str:
    if not path.is_dir():
        raise RecordingError(f"no folder {path}: a recording set has {_any_layout()}")
    if (path / "cooperative" / "data_info.json").is_file():
        return "spd"
    for name, labels in (("kitti", "label_02"), ("kitti_object", "label_2")):
        places = (path / inner for inner in ("", "training"))
        if any((place / "velodyne").is_dir() and (place / labels).is_dir() for place in places):
            return name
    if find_tables(path):
        return "nuscenes"
    if (path / POINTS).is_dir():
        return "arrays"
    if (path / "labels").is_dir() or (path / "detections").is_dir():
        return TEXT
    scenarios = find_scenarios(path)
    if scenarios:
        frame = read_tagged_yaml(next(iter(scenarios.values())).first_frame())
        return "v2v4real" if frame.numbers("lidar_pose", (6,), (4, 4)).ndim == 2 else "opv2v"
    if next(path.glob("*.npz"), None) is not None:
        return "arrays"
    if next(find_logs(path), None) is not None:
        return "argoverse2"
    raise RecordingError(f"{path} has no recordings; looked for: {_any_layout()}")


def _any_layout() -> str:
    return "; or ".join(LAYOUTS)
