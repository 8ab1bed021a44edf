"""Broken and half-downloaded data sets of one car: one line that names file and field."""

from __future__ import annotations

import io
import json
import re
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pytest
import tiny_single_car as single
from pyarrow import feather

from coopsim.errors import RecordingError
from coopsim.recordings.formats import open_folder
from coopsim.recordings.recorded_folder import ReadingOptions

Break = Callable[[Path], object]
LOG = "val/7fab2350-7eaf-3b7e-a39d-6937a4c1bede"


def removed(name: str) -> Break:
    return lambda folder: (folder / name).unlink()


def cut(name: str) -> Break:
    return lambda folder: (folder / name).write_bytes((folder / name).read_bytes()[:-7])


def in_columns(name: str, **changed: Any) -> Break:
    """Change columns of a table: another value in its first row, or None to leave the column out."""

    def change(folder: Path) -> None:
        columns = feather.read_table(str(folder / name)).to_pydict()
        for column, value in changed.items():
            rows = columns.pop(column)
            if value is not None:
                columns[column] = [value, *rows[1:]] if not isinstance(value, str) else [value] * len(rows)
        feather.write_feather(pa.table(columns), str(folder / name))

    return change


def in_table(table: str, number: int, **changed: Any) -> Break:
    """Change a record of a table; None leaves the field out."""

    def change(folder: Path) -> None:
        path = folder / f"v1.0-mini/{table}.json"
        records = json.loads(path.read_text())
        records[number] = {key: value for key, value in (records[number] | changed).items() if value is not None}
        path.write_text(json.dumps(records))

    return change


def in_text(name: str, old: str, new: str) -> Break:
    return lambda folder: (folder / name).write_text(re.sub(old, new, (folder / name).read_text()))


def in_array(**changed: Any) -> Break:
    return lambda folder: single.write_arrays(folder, **changed)


ARGOVERSE2: dict[str, tuple[Break, str]] = {
    "no labels": (removed(f"{LOG}/annotations.feather"), r"no file .*annotations\.feather$"),
    "no poses": (removed(f"{LOG}/city_SE3_egovehicle.feather"), r"no file .*city_SE3_egovehicle\.feather$"),
    "no calibration": (
        removed(f"{LOG}/calibration/egovehicle_SE3_sensor.feather"),
        r"no file .*egovehicle_SE3_sensor\.feather$",
    ),
    "a cut table": (cut(f"{LOG}/annotations.feather"), r"annotations\.feather is no Feather file, or is cut off$"),
    "a cut sweep": (
        lambda folder: next((folder / LOG / "sensors/lidar").iterdir()).write_bytes(b"ARROW1"),
        r"lidar/\d+\.feather is no Feather file, or is cut off$",
    ),
    "a missing column": (
        in_columns(f"{LOG}/annotations.feather", track_uuid=None),
        r"annotations\.feather: column track_uuid is missing; there are: timestamp_ns, ",
    ),
    "texts for numbers": (
        in_columns(f"{LOG}/annotations.feather", tx_m="far"),
        r"annotations\.feather: column tx_m must have finite numbers",
    ),
    "a number that is not finite": (
        in_columns(f"{LOG}/city_SE3_egovehicle.feather", ty_m=float("nan")),
        r"city_SE3_egovehicle\.feather: column ty_m must have finite numbers",
    ),
    "a size of nothing": (
        in_columns(f"{LOG}/annotations.feather", width_m=0.0),
        r"annotations\.feather: columns length_m, width_m, height_m must be > 0",
    ),
    "a quaternion that is none": (
        in_columns(f"{LOG}/annotations.feather", qw=7.0),
        r"annotations\.feather: columns qw, qx, qy, qz must be a quaternion",
    ),
    "an unknown category": (
        in_columns(f"{LOG}/annotations.feather", category="DRAGON"),
        r"annotations\.feather: column category must be the type of an object .*got 'DRAGON'",
    ),
    "no upper LiDAR": (
        in_columns(f"{LOG}/calibration/egovehicle_SE3_sensor.feather", sensor_name="down_lidar"),
        r"egovehicle_SE3_sensor\.feather: column sensor_name has no up_lidar",
    ),
    "a sweep without a pose": (
        lambda folder: next((folder / LOG / "sensors/lidar").iterdir()).rename(
            folder / LOG / "sensors/lidar/7.feather"
        ),
        r"city_SE3_egovehicle\.feather: no pose has the time stamp 7",
    ),
    "no sweep": (
        lambda folder: [path.unlink() for path in (folder / LOG / "sensors/lidar").iterdir()],
        r"sensors/lidar has no <time stamp>\.feather",
    ),
}

NUSCENES: dict[str, tuple[Break, str]] = {
    "no annotations": (removed("v1.0-mini/sample_annotation.json"), r"cannot read .*sample_annotation\.json"),
    "a cut table": (cut("v1.0-mini/sample_data.json"), r"sample_data\.json, line 1: this is no JSON"),
    "no list": (
        lambda folder: (folder / "v1.0-mini/ego_pose.json").write_text("{}"),
        r"ego_pose\.json must be a list of records, got dict",
    ),
    "a missing field": (
        in_table("sample_annotation", 0, translation=None),
        r"sample_annotation\.json: \[0\]\.translation is missing",
    ),
    "a link to nothing": (
        in_table("instance", 0, category_token="dragon"),
        r"instance\.json: \[0\]\.category_token must be a token of category\.json, got 'dragon'",
    ),
    "an unknown category": (
        in_table("category", 0, name="vehicle.dragon"),
        r"category\.json: \[0\]\.name must be the type of an object .*got 'vehicle\.dragon'",
    ),
    "a quaternion that is none": (
        in_table("ego_pose", 0, rotation=[1, 1, 0, 0]),
        r"ego_pose\.json: \[0\]\.rotation must be a quaternion",
    ),
    "a sweep that was not downloaded": (removed("samples/LIDAR_TOP/1.pcd.bin"), r"cannot read .*1\.pcd\.bin"),
    "a cut sweep": (cut("samples/LIDAR_TOP/1.pcd.bin"), r"1\.pcd\.bin: a row is 5 float32"),
    "no sweep of a sample": (
        in_table("sample_data", 0, is_key_frame=False),
        r"sample\.json: \[0\]\.token must have a key frame of LIDAR_TOP",
    ),
    "a path out of the folder": (
        in_table("sample_data", 0, filename="../secret.bin"),
        r"sample_data\.json: \[0\]\.filename must be a path in the folder",
    ),
    "two versions": (
        lambda folder: (
            (folder / "v1.0-test").mkdir(),
            (folder / "v1.0-test/scene.json").write_text("[]"),
        ),
        r"one folder of tables is needed, as v1\.0-mini; give one of: v1\.0-mini, v1\.0-test",
    ),
}

KITTI: dict[str, tuple[Break, str]] = {
    "no labels of a frame": (removed("training/label_2/000006.txt"), r"cannot read .*label_2/000006\.txt"),
    "no calibration": (removed("training/calib/000006.txt"), r"cannot read .*calib/000006\.txt"),
    "a cut cloud": (cut("training/velodyne/000006.bin"), r"000006\.bin: a row is 4 float32"),
    "a missing key": (
        in_text("training/calib/000006.txt", "Tr_velo_to_cam", "Tr"),
        r"calib/000006\.txt: Tr_velo_cam is missing",
    ),
    "a broken line": (
        in_text("training/label_2/000006.txt", "Car", "Dragon"),
        r"label_2/000006\.txt, line 1: unknown type 'Dragon'",
    ),
    "a line with too few fields": (
        in_text("training/label_2/000006.txt", "Car 0", "Car"),
        r"label_2/000006\.txt, line 1: 15 fields with spaces between them are needed, got 14",
    ),
    "a cloud without a number": (
        lambda folder: (folder / "training/velodyne/000006.bin").rename(folder / "training/velodyne/one.bin"),
        r"one\.bin: the name of a cloud must be the frame's number",
    ),
}


def huge_header() -> bytes:
    """Return the beginning of a .npy file of points, which has none."""
    content = io.BytesIO()
    np.lib.format.write_array_header_1_0(content, {"descr": "<f4", "fortran_order": False, "shape": (10**11, 4)})
    return content.getvalue()


def in_archive(name: str, member: str, content: bytes) -> Break:
    """Replace a member of a .npz file."""

    def spoil(folder: Path) -> None:
        with zipfile.ZipFile(folder / name) as old:
            kept = {each: old.read(each) for each in old.namelist() if each != member}
        with zipfile.ZipFile(folder / name, "w", zipfile.ZIP_DEFLATED, compresslevel=1) as new:
            for each, value in {**kept, member: content}.items():
                new.writestr(each, value)

    return spoil


ARRAYS: dict[str, tuple[Break, str]] = {
    "a frame without labels": (in_array(boxes=None), r"queue_07\.npz: boxes is missing"),
    "no points": (in_array(points=None), r"queue_07\.npz: points is missing"),
    "fewer boxes than types": (in_array(boxes=np.zeros((1, 7))), r"queue_07\.npz: boxes must be 3 x 7 numbers"),
    "points of two numbers": (in_array(points=np.zeros((9, 2))), r"queue_07\.npz: points must be numbers \(N, 3"),
    "a point that is not finite": (
        in_array(points=np.full((9, 4), np.nan)),
        r"queue_07\.npz: all points must be finite",
    ),
    "boxes of no size": (in_array(boxes=np.zeros((3, 7))), r"queue_07\.npz: lengths, widths and heights of boxes"),
    "an unknown type": (in_array(names=np.array(["dragon"] * 3)), r"queue_07\.npz: a box's type must be .*'dragon'"),
    "ids that repeat": (in_array(ids=np.array([1, 1, 2])), r"queue_07\.npz: ids must be 3 different integers"),
    "pickles": (in_array(names=np.array(["car", None, "car"], object)), r"queue_07\.npz is no file of plain arrays"),
    "a cut file": (cut("queue_08.npz"), r"queue_08\.npz is no file of plain arrays"),
    "a header of too many points": (
        in_archive("queue_07.npz", "points.npy", huge_header()),
        r"queue_07\.npz is no file of plain arrays: an array announces 1600000000000 bytes of the shape .* and has 0",
    ),
}

OTHERS_ARRAYS: dict[str, tuple[Break, str]] = {
    "no labels of a frame": (removed("labels/000001.txt"), r"cannot read .*labels/000001\.txt"),
    "a broken line": (
        in_text("labels/000001.txt", "Truck", ""),
        r"labels/000001\.txt, line 2: x y z length width height heading type are needed",
    ),
    "a cut cloud": (cut("points/000001.npy"), r"points/000001\.npy is no file of a plain array"),
    "a header of too many points": (
        lambda folder: (folder / "points/000001.npy").write_bytes(huge_header()),
        r"points/000001\.npy is no file of a plain array: an array announces 1600000000000 bytes",
    ),
}

ALL = {
    "Argoverse 2": (single.write_argoverse2, ARGOVERSE2),
    "nuScenes": (single.write_nuscenes, NUSCENES),
    "KITTI object": (single.write_kitti_object, KITTI),
    "arrays": (single.write_arrays, ARRAYS),
    "arrays of others": (single.write_clouds_with_labels, OTHERS_ARRAYS),
}


def read_all(path: Path) -> None:
    folder = open_folder(path, ReadingOptions(points="all"))
    sequence = folder.open(folder.sequences[0])
    for number in range(sequence.frames):
        for agent in sequence.frame(number).agents.values():
            agent.read_sweep()


@pytest.mark.parametrize(
    ("of", "case"), [(of, case) for of, (_, cases) in ALL.items() for case in cases], ids=lambda each: str(each)
)
def test_an_error_of_one_line_names_the_file(of: str, case: str, tmp_path: Path) -> None:
    write, cases = ALL[of]
    spoil, problem = cases[case]
    write(tmp_path)
    spoil(tmp_path)
    with pytest.raises(RecordingError, match=problem) as caught:
        read_all(tmp_path)
    assert "\n" not in str(caught.value)


def test_a_half_downloaded_folder_says_what_is_looked_for(tmp_path: Path) -> None:
    (tmp_path / "training/velodyne").mkdir(parents=True)
    with pytest.raises(RecordingError, match=r"has no recordings; looked for: .*label_2/ and calib/ \(KITTI object\)"):
        open_folder(tmp_path)
