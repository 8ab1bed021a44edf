"""Broken files: one line that names the file and what is wrong in it."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path

import pytest
import tiny_recordings as tiny

import coopsim
from coopsim.errors import CoopsimError, RecordingError
from coopsim.recordings.formats import open_folder

FRAME = Path("train/s1/101/000070.yaml")


def play(path: Path) -> None:
    """Play all frames of the first sequence."""
    env = coopsim.parallel_env("replay", path=path, detector="none", expose_ground_truth=True)
    for _ in env.frames(seed=0):
        pass


def edited(change: Callable[[str], str], file: Path = FRAME) -> Callable[[Path], None]:
    return lambda folder: (folder / file).write_text(change((folder / file).read_text())) and None


def without(key: str) -> Callable[[str], str]:
    return lambda text: re.sub(rf"^{key}:.*?(?=^\w|\Z)", "", text, flags=re.DOTALL | re.MULTILINE)


def cut_cloud(folder: Path) -> None:
    cloud = folder / FRAME.with_suffix(".pcd")
    cloud.write_bytes(cloud.read_bytes()[:-100])


BROKEN: dict[str, tuple[Callable[[Path], object], str]] = {
    "a cut cloud": (cut_cloud, r"000070\.pcd: .*cut off"),
    "a cut file": (edited(lambda text: text[:40]), r"000070\.yaml"),
    "an empty file": (edited(lambda _: ""), r"000070\.yaml: the file must have keys and values"),
    "a missing key": (edited(without("lidar_pose")), r"000070\.yaml: lidar_pose is missing"),
    "a missing list": (edited(without("vehicles")), r"000070\.yaml: vehicles is missing"),
    "a missing cloud": (lambda folder: (folder / FRAME.with_suffix(".pcd")).unlink(), r"000070\.pcd"),
    "an id that is no number": (
        edited(lambda text: text.replace("  7:", "  seven:")),
        r"000070\.yaml: the id of vehicles must be an integer, got 'seven'",
    ),
    "an agent that is no number": (
        lambda folder: (folder / "train/s1/101").rename(folder / "train/s1/ego"),
        r"s1: the id of an agent must be an integer, got 'ego'",
    ),
    "an object of Python": (
        edited(lambda text: text + "extra: !!python/object/apply:os.system ['exit 1']\n"),
        r"000070\.yaml, line \d+: the tag python/object/apply:os\.system is refused",
    ),
    "a pose that is not finite": (
        edited(lambda text: re.sub(r"lidar_pose:\n- .*", "lidar_pose:\n- .nan", text)),
        r"000070\.yaml: lidar_pose must be finite",
    ),
    "a pose that is too short": (
        edited(lambda text: re.sub(r"lidar_pose:\n- .*\n", "lidar_pose:\n", text)),
        r"000070\.yaml: lidar_pose must be 6 numbers",
    ),
    "a box without a size": (
        edited(lambda text: re.sub(r"extent:\n    - .*", "extent:\n    - 0.0", text, count=1)),
        r"000070\.yaml: vehicles\.7\.extent must be > 0",
    ),
    "agents with different time stamps": (
        lambda folder: (folder / FRAME).unlink(),
        r"s1: agents must have the same time stamps, but 202 has 000070 and 101 has not",
    ),
    "a type that is not known": (
        edited(lambda text: text.replace("    speed: 0.0", "    obj_type: Dragon", 1)),
        r"000070\.yaml: vehicles\.\d\.obj_type must be the type of an object",
    ),
}


@pytest.mark.parametrize("broken", BROKEN)
def test_a_broken_file_is_named_in_one_line(broken: str, tmp_path: Path) -> None:
    folder = tiny.write_opv2v(tmp_path)
    play(folder)
    _expect(folder, *BROKEN[broken])


def in_json(file: str, old: str, new: str) -> Callable[[Path], object]:
    return lambda folder: (folder / file).write_text(re.sub(old, new, (folder / file).read_text(), count=1))


_TO_WORLD = "infrastructure-side/calib/virtuallidar_to_world/000501.json"

SPD_BROKEN: dict[str, tuple[Callable[[Path], object], str]] = {
    "a cut list": (in_json("cooperative/data_info.json", "}\\]", ""), r"data_info\.json, line 1: this is no JSON"),
    "a frame that is not there": (
        in_json("cooperative/data_info.json", '"000010"', '"000099"'),
        r"cooperative/data_info\.json: \[0\]\.vehicle_frame must be a frame in vehicle-side",
    ),
    "an identity that is no number": (
        in_json("cooperative/label/000011.json", '"000006"', '"six"'),
        r"000011\.json: the id of \[0\]\.track_id must be an integer, got 'six'",
    ),
    "a missing key": (
        in_json("vehicle-side/calib/novatel_to_world/000011.json", "translation", "transl"),
        r"novatel_to_world/000011\.json: translation is missing",
    ),
    "a pose that is not finite": (
        in_json(_TO_WORLD, r'"translation": \[\[[^]]*', '"translation": [[NaN'),
        r"virtuallidar_to_world/000501\.json: translation must be finite",
    ),
    "a turn that is none": (
        in_json(_TO_WORLD, r'"rotation": \[\[[^,]*', '"rotation": [[7.0'),
        r"virtuallidar_to_world/000501\.json: rotation must have a rotation",
    ),
    "a path out of the folder": (
        in_json("vehicle-side/data_info.json", "velodyne/000011.pcd", "../../secret.pcd"),
        r"vehicle-side/data_info\.json: pointcloud_path must be a path in the folder",
    ),
    "a missing label file": (lambda folder: (folder / "cooperative/label/000011.json").unlink(), r"000011\.json"),
}

KITTI_BROKEN: dict[str, tuple[Callable[[Path], object], str]] = {
    "a cut cloud": (
        lambda folder: (folder / "training/velodyne/0002/000001.bin").write_bytes(b"123"),
        r"000001\.bin: a row is 4 float32",
    ),
    "a missing key": (in_json("training/calib/0002.txt", "Tr_velo_cam", "Tr"), r"0002\.txt: Tr_velo_cam is missing"),
    "a broken calibration": (
        in_json("training/calib/0002.txt", "P2: 300.0", "P2: x"),
        r"0002\.txt: P2 must be 12 numbers",
    ),
    "a pose that is not finite": (in_json("training/oxts/0002.txt", "8.4", "nan"), r"oxts/0002\.txt, line 1: latitude"),
    "too few poses": (
        lambda folder: (folder / "training/oxts/0002.txt").write_text("49.0 8.4 110.0 0 0 0\n"),
        r"oxts/0002\.txt: a line for each of 3 frames is needed, got 1",
    ),
    "a label of another kind": (in_json("training/label_02/0002.txt", "Car", "Dragon"), r"label_02/0002\.txt, line 1"),
    "a cloud without a number": (
        lambda folder: (folder / "training/velodyne/0002/000001.bin").rename(folder / "training/velodyne/0002/one.bin"),
        r"one\.bin: the name of a cloud must be the frame's number",
    ),
}


@pytest.mark.parametrize("broken", SPD_BROKEN)
def test_a_broken_file_of_spd_is_named(broken: str, tmp_path: Path) -> None:
    _expect(tiny.write_spd(tmp_path), *SPD_BROKEN[broken])


@pytest.mark.parametrize("broken", KITTI_BROKEN)
def test_a_broken_file_of_kitti_is_named(broken: str, tmp_path: Path) -> None:
    _expect(tiny.write_kitti(tmp_path), *KITTI_BROKEN[broken])


def _expect(folder: Path, change: Callable[[Path], object], problem: str) -> None:
    change(folder)
    with pytest.raises(RecordingError, match=problem) as raised:
        play(folder)
    assert "\n" not in str(raised.value)


def test_nothing_is_imported_or_called_by_a_yaml_file(tmp_path: Path) -> None:
    folder, proof = tiny.write_v2v4real(tmp_path / "set"), tmp_path / "proof"
    frame = folder / "s1/0/000000.yaml"
    text = frame.read_text()
    for tag in (
        f"!!python/object/apply:pathlib.Path.touch [!!python/object/apply:pathlib.Path ['{proof}']]",
        "!!python/object/new:tuple [[1, 2]]",
        "!!python/name:os.system ''",
        "!!python/module:antigravity ''",
    ):
        frame.write_text(f"{text}extra: {tag}\n")
        with pytest.raises(RecordingError, match=r"000000\.yaml, line \d+: the tag python/.* is refused"):
            play(folder)
    assert not proof.exists()


def test_aliases_that_would_take_all_memory_are_refused_before_they_do(tmp_path: Path) -> None:
    folder = tiny.write_v2v4real(tmp_path / "set")
    frame = folder / "s1/0/000000.yaml"
    text = frame.read_text()
    levels = [f"{chr(98 + k)}: &{chr(98 + k)} [{', '.join([f'*{chr(97 + k)}'] * 10)}]" for k in range(9)]
    for field in ("extra", "true_ego_pos"):
        bomb = "\n".join(["a: &a [1]", *levels, f"{field}: *j"])
        kept = re.sub(rf"(?m)^{field}:(.*\n(?:[ -].*\n)*)", "", text)
        frame.write_text(f"{kept}{bomb}\n")
        with pytest.raises(RecordingError, match=r"000000\.yaml, line 1: aliases must stand for") as raised:
            play(folder)
        assert len(str(raised.value)) < 500


@pytest.mark.parametrize(
    ("old", "new", "problem"),
    [
        ("- f8", "- O8", "an array must be of plain numbers, got type 'O8'"),
        ("- f8", "- f16", "an array must be of plain numbers, got type 'f16'"),
        ("- 4\n    - 4", "- 4\n    - 5", "an array is broken"),
        ("- <", "- x", "the order of an array's bytes must be one of"),
    ],
)
def test_arrays_that_are_no_plain_numbers_are_refused(old: str, new: str, problem: str, tmp_path: Path) -> None:
    folder = tiny.write_v2v4real(tmp_path)
    frame = folder / "s1/0/000000.yaml"
    text = frame.read_text()
    assert old in text
    frame.write_text(text.replace(old, new))
    with pytest.raises(RecordingError, match=problem):
        play(folder)


@pytest.mark.parametrize(
    ("options", "problem"),
    [
        ({"dt_s": 0.25}, "dt_s must be a multiple of the recordings' 0.1 s"),
        ({"format": "waymo"}, "unknown format 'waymo'"),
        ({"odometry": "none"}, "odometry must be 'auto' or 'poses' here"),
        ({"odometry": "estimated"}, "unknown odometry 'estimated'"),
        ({"lidar_height_m": {"bus": 2.0}}, "lidar_height_m must be by kind"),
        ({"detections": ["ego"]}, "unknown option 'detections'"),
        ({"max_cycles": 0}, "max_cycles must be an integer >= 1"),
    ],
)
def test_wrong_options_are_named(options: dict[str, object], problem: str, tmp_path: Path) -> None:
    folder = tiny.write_opv2v(tmp_path)
    with pytest.raises(CoopsimError, match=problem):
        coopsim.parallel_env("replay", path=folder, **{"detector": "none", **options})


def test_detections_in_text_files_are_no_sweeps(recordings: Path) -> None:
    with pytest.raises(RecordingError, match="has detections in text files, and no sweeps"):
        open_folder(recordings)
