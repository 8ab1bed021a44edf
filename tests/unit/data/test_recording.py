"""Recordings come in with our axes, and broken ones are refused by file and line."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from coopsim.data.kitti import boxes_from_camera
from coopsim.data.recording import RecordingSet
from coopsim.errors import RecordingError, UnknownNameError
from coopsim.taxonomy import ObjectClass

LABEL = "0 7 Car 0 0 0 0 0 0 0 1.6 1.9 4.5 2.0 1.0 10.0 -1.5707963"
FOUND = "0,2,0,0,0,0,0.9,1.6,1.9,4.5,2.0,1.0,10.0,-1.5707963,0.0"


def test_camera_axes_become_ours() -> None:
    # 10 m ahead, 2 m to the right, bottom 1 m below the camera, pointing ahead.
    boxes = boxes_from_camera(np.array([[1.6, 1.9, 4.5]]), np.array([[2.0, 1.0, 10.0]]), np.array([-np.pi / 2]))
    np.testing.assert_allclose(boxes.array, [[10, -2, -0.2, 4.5, 1.9, 1.6, 0]], atol=1e-12)
    # rot_y = 0 points to the camera's right.
    right = boxes_from_camera(np.ones((1, 3)), np.zeros((1, 3)), np.array([0.0]))
    np.testing.assert_allclose(right.yaw, [-np.pi / 2])


@pytest.fixture
def make_set(tmp_path: Path) -> Callable[[str, str], RecordingSet]:
    def make(labels: str, found: str) -> RecordingSet:
        (tmp_path / "labels").mkdir()
        (tmp_path / "detections" / "ego").mkdir(parents=True)
        (tmp_path / "labels" / "0000.txt").write_text(labels)
        (tmp_path / "detections" / "ego" / "0000.txt").write_text(found)
        return RecordingSet(tmp_path)

    return make


def test_frames_are_all_from_zero_to_the_last_of_any_file(make_set: Callable[[str, str], RecordingSet]) -> None:
    recording = make_set(LABEL + "\n" + LABEL.replace("0 7", "3 8", 1), FOUND.replace("0,", "5,", 1) + "\n").load(
        "0000", ("ego",)
    )
    assert recording.frames == 6
    assert [len(truth) for truth in recording.truth] == [1, 0, 0, 1, 0, 0]
    assert [len(found) for found in recording.detections["ego"]] == [0, 0, 0, 0, 0, 1]
    np.testing.assert_allclose(recording.detections["ego"][5].score, [0.9])
    assert recording.truth[3].id.tolist() == [8]


def test_types(make_set: Callable[[str, str], RecordingSet]) -> None:
    kinds = ("Car", "Van", "Truck", "Pedestrian", "Cyclist", "DontCare", "Misc", "Tram")
    labels = "\n".join(LABEL.replace("0 7 Car", f"0 {k} {kind}") for k, kind in enumerate(kinds))
    found = "\n".join(FOUND.replace("0,2", f"0,{code}", 1) for code in (1, 2, 3))
    recording = make_set(labels, found).load("0000", ("ego",))
    expected = [ObjectClass.CAR, ObjectClass.VAN, ObjectClass.TRUCK, ObjectClass.PEDESTRIAN, ObjectClass.BICYCLE]
    assert recording.truth[0].label.tolist() == expected
    expected = [ObjectClass.PEDESTRIAN, ObjectClass.CAR, ObjectClass.BICYCLE]
    assert recording.detections["ego"][0].label.tolist() == expected


def test_empty_files_are_a_recording_without_frames(make_set: Callable[[str, str], RecordingSet]) -> None:
    assert make_set("", "").load("0000", ("ego",)).frames == 0


def edited(line: str, separator: str | None, field: int, value: str) -> str:
    parts = line.split(separator)
    parts[field] = value
    return (separator or " ").join(parts)


BAD_DETECTIONS = [
    (FOUND.rsplit(",", 1)[0], "line 2: 15 fields are needed, got 14"),
    (FOUND + ",1", "line 2: 15 fields are needed, got 16"),
    ("", "line 2: 15 fields are needed, got 1"),
    (edited(FOUND, ",", 10, "abc"), "line 2: 'abc' is not a finite number"),
    (edited(FOUND, ",", 6, "nan"), "line 2: all fields must be finite numbers"),
    (edited(FOUND, ",", 8, "-1.9"), "line 2: sizes h, w, l must be > 0"),
    (edited(FOUND, ",", 0, "-3"), "line 2: the frame must be an integer >= 0"),
    (edited(FOUND, ",", 0, "1.5"), "line 2: the frame must be an integer >= 0"),
    (edited(FOUND, ",", 1, "9"), "line 2: unknown type; accepted: 1 pedestrian, 2 car, 3 bicycle"),
]


@pytest.mark.parametrize(("line", "message"), BAD_DETECTIONS)
def test_broken_detections(make_set: Callable[[str, str], RecordingSet], line: str, message: str) -> None:
    with pytest.raises(RecordingError, match=message) as caught:
        make_set(LABEL, "\n".join([FOUND, line, FOUND])).load("0000", ("ego",))
    assert "detections/ego/0000.txt" in str(caught.value)


def test_a_file_in_which_all_lines_are_too_short(make_set: Callable[[str, str], RecordingSet]) -> None:
    short = "\n".join([FOUND.rsplit(",", 1)[0]] * 15)  # as many numbers as 14 whole lines
    with pytest.raises(RecordingError, match="line 1: 15 fields are needed, got 14"):
        make_set(LABEL, short).load("0000", ("ego",))


BAD_LABELS = [
    (LABEL.rsplit(" ", 1)[0], "line 2: 17 fields are needed, got 16"),
    (edited(LABEL, None, 2, "Lorry"), "line 2: unknown type 'Lorry'; accepted: Car, Van"),
    (edited(LABEL, None, 12, "0"), "line 2: sizes h, w, l must be > 0"),
    (edited(LABEL, None, 15, "inf"), "line 2: all fields must be finite numbers"),
    (edited(LABEL, None, 1, "1.5"), "line 2: the object id must be an integer"),
    (LABEL, "line 2: object 7 stands twice in frame 0"),
]


@pytest.mark.parametrize(("line", "message"), BAD_LABELS)
def test_broken_labels(make_set: Callable[[str, str], RecordingSet], line: str, message: str) -> None:
    with pytest.raises(RecordingError, match=message) as caught:
        make_set("\n".join([LABEL, line]), FOUND).load("0000", ("ego",))
    assert "labels/0000.txt" in str(caught.value)


def test_missing_folders_files_and_names(tmp_path: Path, recordings: Path) -> None:
    with pytest.raises(RecordingError, match=r"no folder .*nowhere: a recording set has labels/<sequence>.txt"):
        RecordingSet(tmp_path / "nowhere")
    whole = RecordingSet(recordings)
    with pytest.raises(UnknownNameError, match=r"unknown detections in .* 'eggo'. Did you mean 'ego'"):
        whole.load("0000", ("eggo",))
    with pytest.raises(UnknownNameError, match=r"unknown sequence in .* '000'"):
        whole.load("000", ("ego",))
    (recordings / "detections" / "1" / "0001.txt").unlink()
    with pytest.raises(RecordingError, match=r"cannot read .*1/0001.txt: No such file"):
        whole.load("0001", ("1",))
    (recordings / "labels" / "0000.txt").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(RecordingError, match=r"labels/0000.txt is not text"):
        whole.load("0000", ("ego",))
