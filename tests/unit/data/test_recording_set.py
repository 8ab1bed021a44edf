"""Recordings come in with our axes, and broken ones are refused by file and line."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from coopsim.data.kitti import boxes_from_camera
from coopsim.data.recording_set import RecordingSet
from coopsim.errors import InvalidValueError, RecordingError, UnknownNameError
from coopsim.types.taxonomy import ObjectClass

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
        (tmp_path / "labels" / "0000.txt").write_bytes(labels.encode())
        (tmp_path / "detections" / "ego" / "0000.txt").write_bytes(found.encode())
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


def test_an_empty_detection_file_is_nothing_found(make_set: Callable[[str, str], RecordingSet]) -> None:
    recording = make_set(LABEL, "").load("0000", ("ego",))
    assert [len(found) for found in recording.detections["ego"]] == [0]


@pytest.mark.parametrize("labels", ["", "\n \n"])
def test_an_empty_label_file_is_named(make_set: Callable[[str, str], RecordingSet], labels: str) -> None:
    with pytest.raises(RecordingError, match=r"labels/0000.txt is empty: .* a line of type DontCare"):
        make_set(labels, FOUND).load("0000", ("ego",))


def test_a_sequence_without_objects_has_a_line_that_is_none(make_set: Callable[[str, str], RecordingSet]) -> None:
    whole = make_set("3 -1 DontCare" + " -1" * 14, FOUND)
    assert [len(truth) for truth in whole.load("0000", ("ego",)).truth] == [0, 0, 0, 0]
    assert whole.most_objects() == 0


@pytest.mark.parametrize("edit", [lambda text: "\ufeff" + text, lambda text: text + "\n \n\n"], ids=["mark", "blank"])
@pytest.mark.parametrize("newline", ["\n", "\r\n"], ids=["lf", "crlf"])
def test_what_editors_add_is_harmless(
    make_set: Callable[[str, str], RecordingSet], edit: Callable[[str], str], newline: str
) -> None:
    labels, found = (edit("\n".join([line, "1" + line[1:]])).replace("\n", newline) for line in (LABEL, FOUND))
    recording = make_set(labels, found).load("0000", ("ego",))
    assert [truth.id.tolist() for truth in recording.truth] == [[7], [7]]
    assert [part.score.tolist() for part in recording.detections["ego"]] == [[0.9], [0.9]]


def test_a_long_gap_costs_nothing(make_set: Callable[[str, str], RecordingSet]) -> None:
    recording = make_set(LABEL + "\n1000000" + LABEL[1:], FOUND).load("0000", ("ego",))
    assert recording.frames == 1_000_001
    assert recording.truth[1] is recording.truth[999_999]
    assert recording.truth[1_000_000].id.tolist() == [7]


def test_ids_are_whole_as_long_as_floats_are(make_set: Callable[[str, str], RecordingSet]) -> None:
    ids = [1 - 2**53, -1, 2**53 - 1]
    labels = "\n".join(edited(LABEL, None, 1, str(number)) for number in ids)
    assert make_set(labels, FOUND).load("0000", ()).truth[0].id.tolist() == ids


def edited(line: str, separator: str | None, field: int, value: str) -> str:
    parts = line.split(separator)
    parts[field] = value
    return (separator or " ").join(parts)


BLANK = "line 2 is blank; blank lines are accepted at the end only"
BAD_FRAME = "line 2: the frame must be an integer from 0 to 1000000"

BAD_DETECTIONS = [
    (FOUND.rsplit(",", 1)[0], "line 2: 15 fields with commas between them are needed, got 14"),
    (FOUND + ",1", "line 2: 15 fields with commas between them are needed, got 16"),
    (FOUND.replace(",", " "), "line 2: 15 fields with commas between them are needed, got 1"),
    ("", BLANK),
    (edited(FOUND, ",", 10, "abc"), "line 2: 'abc' is not a number"),
    (edited(FOUND, ",", 6, "nan"), "line 2: all fields must be finite numbers"),
    (edited(FOUND, ",", 8, "-1.9"), "line 2: sizes h, w, l must be > 0"),
    (edited(FOUND, ",", 10, "1e300"), r"line 2: .* x, y, z, rot_y must be in \[-1e\+09, 1e\+09\]"),
    *((edited(FOUND, ",", 0, frame), BAD_FRAME) for frame in ("-3", "1.5", "1000001", "1000000000", "1e300")),
    (edited(FOUND, ",", 1, "9"), "line 2: unknown type; accepted: 1 pedestrian, 2 car, 3 bicycle"),
]


@pytest.mark.parametrize(("line", "message"), BAD_DETECTIONS)
def test_broken_detections(make_set: Callable[[str, str], RecordingSet], line: str, message: str) -> None:
    with pytest.raises(RecordingError, match=message) as caught:
        make_set(LABEL, "\n".join([FOUND, line, FOUND])).load("0000", ("ego",))
    assert "detections/ego/0000.txt" in str(caught.value)


def test_a_file_in_which_all_lines_are_too_short(make_set: Callable[[str, str], RecordingSet]) -> None:
    short = "\n".join([FOUND.rsplit(",", 1)[0]] * 15)  # as many numbers as 14 whole lines
    with pytest.raises(RecordingError, match=r"line 1: 15 fields .* are needed, got 14"):
        make_set(LABEL, short).load("0000", ("ego",))


BAD_LABELS = [
    (LABEL.rsplit(" ", 1)[0], "line 2: 17 fields with spaces between them are needed, got 16"),
    (LABEL.replace(" ", ","), "line 2: 17 fields with spaces between them are needed, got 1"),
    ("\n" + LABEL, BLANK),
    (edited(LABEL, None, 2, "Lorry"), "line 2: unknown type 'Lorry'; accepted: Car, Van"),
    (edited(LABEL, None, 12, "0"), "line 2: sizes h, w, l must be > 0"),
    (edited(LABEL, None, 15, "inf"), "line 2: all fields must be finite numbers"),
    (edited(LABEL, None, 16, "1e300"), "line 2: .* rot_y must be in"),
    (edited(LABEL, None, 1, "1.5"), "line 2: the object id must be an integer"),
    *(
        (edited(LABEL, None, 1, number), "line 2: the object id must be between -9007199254740992 and 9007199254740992")
        for number in ("1e300", "-1e300", str(2**53), str(2**63), str(2**64))
    ),
    *((edited(LABEL, None, 0, frame), BAD_FRAME) for frame in ("1000000000", "1e300")),
    ("1000000000 -1 DontCare" + " -1" * 14, BAD_FRAME),
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
    with pytest.raises(RecordingError, match=r"cannot read .*: File name too long"):
        RecordingSet("x" * 5000)
    whole = RecordingSet(recordings)
    with pytest.raises(UnknownNameError, match=r"unknown detections 'eggo' in .* Did you mean 'ego'"):
        whole.load("0000", ("eggo",))
    with pytest.raises(UnknownNameError, match=r"unknown sequence '000' in"):
        whole.load("000", ("ego",))
    (recordings / "detections" / "1" / "0001.txt").unlink()
    with pytest.raises(RecordingError, match=r"cannot read .*1/0001.txt: No such file"):
        whole.load("0001", ("1",))
    (recordings / "labels" / "0000.txt").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(RecordingError, match=r"labels/0000.txt is not text"):
        whole.load("0000", ("ego",))


@pytest.mark.parametrize("path", [None, 3, b"set"])
def test_what_is_no_path(path: Any) -> None:
    with pytest.raises(InvalidValueError, match=r"path must be the folder of a recording set, got .*; .*labels/<seq"):
        RecordingSet(path)


def test_one_name_is_one_name(recordings: Path) -> None:
    assert list(RecordingSet(recordings).load("0000", "ego").detections) == ["ego"]


def test_most_objects_is_of_all_sequences(recordings: Path) -> None:
    with (recordings / "labels" / "0001.txt").open("a") as file:
        file.write(edited(LABEL, None, 1, "8"))
    assert RecordingSet(recordings).most_objects() == 2
