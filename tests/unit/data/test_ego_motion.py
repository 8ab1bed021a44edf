"""A replay knows how its car moved: from poses, or from the boxes of what stands."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import coopsim
from coopsim.data.ego_motion import EgoMotion
from coopsim.data.kitti import AXES, read_poses
from coopsim.envs.replay import Replay
from coopsim.errors import RecordingError, UnknownNameError
from coopsim.geometry.boxes import Boxes3D
from coopsim.geometry.se3 import SE3, Floats
from coopsim.types import Detections, Tracks
from coopsim.types.taxonomy import ObjectClass
from coopsim.wire.actions import pack_tracks

FRAMES, DT_S = 60, 0.1
SPEED_M_S, TURN_RAD_S = 8.0, 0.2
CAR, CYCLIST = [4.5, 1.9, 1.6], [1.8, 0.6, 1.7]


def driven() -> list[SE3]:
    """Poses of a car that drives a bend: straight for two seconds, then to the left."""
    poses = [SE3.identity()]
    for frame in range(1, FRAMES):
        turn = TURN_RAD_S * DT_S if frame > 20 else 0.0
        poses.append(poses[-1].compose(SE3.from_xyz_yaw([SPEED_M_S * DT_S, 0.0, 0.0], turn)))
    return poses


def scene(frame: int) -> tuple[Boxes3D, Floats]:
    """Boxes and labels in the world: parked cars on both sides, one that comes, and a cyclist on a circle."""
    parked = [[x, side * 6 + 0.3 * (x % 7), 0.0, *CAR, 0.1] for x in range(0, 80, 9) for side in (-1, 1)]
    coming = [90.0 - 12 * DT_S * frame, 2.0, 0.0, *CAR, np.pi]
    angle = 5.0 / 8.0 * DT_S * frame  # 5 m/s on a circle of 8 m
    cyclist = [30 + 8 * np.sin(angle), 12 - 8 * np.cos(angle), 0.0, *CYCLIST, angle]
    rows = np.array([*parked, coming, cyclist])
    labels = np.array([int(ObjectClass.CAR)] * (len(rows) - 1) + [int(ObjectClass.BICYCLE)])
    return Boxes3D.from_array(rows), labels


def seen(pose: SE3, frame: int, rng: np.random.Generator) -> Detections:
    boxes, label = scene(frame)
    boxes = boxes.transform(pose.inverse())
    near = (np.linalg.norm(boxes.center[:, :2], axis=1) < 45) & (rng.random(len(label)) > 0.1)
    noisy = boxes.array[near] + rng.normal(0, [0.1, 0.1, 0.05, 0, 0, 0, 0.03], (near.sum(), 7))
    return Detections(Boxes3D.from_array(noisy), np.ones(near.sum()), label[near])


def errors(estimated: Sequence[Floats], poses: Sequence[SE3]) -> Floats:
    """Errors (F, 2): speed in m/s, turn rate in rad/s."""
    true = [a.inverse().compose(b) for a, b in pairwise(poses)]
    pairs = zip(estimated[1:], true, strict=True)
    return np.array([(np.hypot(*(step[:2] - m.translation[:2])), abs(step[2] - m.yaw)) for step, m in pairs]) / DT_S


def test_a_drive_is_estimated_from_what_stands() -> None:
    rng, estimator, poses = np.random.default_rng(3), EgoMotion(DT_S), driven()
    steps = [estimator.step(seen(pose, frame, rng)) for frame, pose in enumerate(poses)]
    np.testing.assert_array_equal(steps[0], 0)
    speed, turn = errors(steps, poses)[5:].T
    assert np.sqrt(np.mean(speed**2)) < 0.4 and speed.max() < 1.2
    assert np.sqrt(np.mean(turn**2)) < 0.03


def test_the_past_is_not_changed_by_what_comes() -> None:
    poses = driven()
    frames = [seen(pose, frame, np.random.default_rng(frame)) for frame, pose in enumerate(poses)]
    whole, part = EgoMotion(DT_S), EgoMotion(DT_S)
    all_steps = [whole.step(each) for each in frames]
    np.testing.assert_array_equal([part.step(each) for each in frames[:30]], all_steps[:30])


def test_without_boxes_the_car_goes_on() -> None:
    rng, estimator, poses = np.random.default_rng(3), EgoMotion(DT_S), driven()
    for frame in range(20):
        last = estimator.step(seen(poses[frame], frame, rng))
    for _ in range(3):
        np.testing.assert_allclose(estimator.step(Detections.empty()), last)


def test_a_wrong_past_is_overruled_by_many_boxes() -> None:
    """A car that leads at the same speed looks like a world that stands, until parked cars come into view."""
    estimator = EgoMotion(DT_S)
    ahead = np.array([15.0, 0.0, 0.0, *CAR, 0.0])
    for frame in range(40):
        parked = [[60.0 - frame + 9 * k, y, 0.0, *CAR, 0.0] for k in range(3) for y in (-5.0, 5.0)]
        rows = np.array([ahead, *(parked if frame >= 20 else [])])
        step = estimator.step(Detections(Boxes3D.from_array(rows), np.ones(len(rows)), np.zeros(len(rows), int)))
        if frame == 19:
            assert np.hypot(*step[:2]) < 0.01
    assert step[0] / DT_S == pytest.approx(10, abs=0.5)


def test_empty_recordings_stand() -> None:
    estimator = EgoMotion(DT_S)
    for _ in range(3):
        np.testing.assert_array_equal(estimator.step(Detections.empty()), 0)


def line(box: Floats, axes: str) -> list[str]:
    """h, w, l, x, y, z, rot_y of a box in a set's axes."""
    x, y, z, length, width, height, yaw = box
    turn = -yaw - np.pi / 2 if axes == "kitti" else yaw
    at = (-y, height / 2 - z, x) if axes == "kitti" else (x, z, y)
    return [f"{value:.6f}" for value in (height, width, length, *at, turn)]


MakeSet = Callable[..., Path]


@pytest.fixture
def make_set(tmp_path: Path) -> MakeSet:
    """Write the drive as a recording set; names of detections may be split by class."""

    def make(axes: str = "kitti", *, split: bool = False, poses: bool = False) -> Path:
        names = {"rcnn_Car": [0], "rcnn_Cyclist": [5]} if split else {"ego": [0, 5]}
        for folder in ("labels", "poses", *(f"detections/{name}" for name in names)):
            (tmp_path / folder).mkdir(parents=True)
        labels: list[str] = []
        found: dict[str, list[str]] = {name: [] for name in names}
        rng = np.random.default_rng(3)
        for frame, pose in enumerate(driven()):
            boxes, label = scene(frame)
            for number, box in enumerate(boxes.transform(pose.inverse()).array):
                kind = "Cyclist" if label[number] == ObjectClass.BICYCLE else "Car"
                labels.append(" ".join([str(frame), str(number), kind, *["0"] * 7, *line(box, axes)]))
            detections = seen(pose, frame, rng)
            for box, kind in zip(detections.boxes.array, detections.label, strict=True):
                name = next(name for name in names if kind in names[name])
                code = "3" if kind == ObjectClass.BICYCLE else "2"
                found[name].append(",".join([str(frame), code, "0,0,0,0,0.9", *line(box, axes), "0"]))
        (tmp_path / "labels" / "0000.txt").write_text("\n".join(labels))
        for name, lines in found.items():
            (tmp_path / "detections" / name / "0000.txt").write_text("\n".join(lines))
        if poses:
            (tmp_path / "poses" / "0000.txt").write_text(pose_file(driven(), axes))
        return tmp_path

    return make


def pose_file(poses: Sequence[SE3], axes: str = "kitti") -> str:
    turn = AXES[axes].base_from_file.T
    rows = [np.column_stack([turn @ p.rotation @ turn.T, turn @ p.translation]).ravel() for p in poses]
    return "\n".join(" ".join(f"{value:.9e}" for value in row) for row in rows) + "\n"


def odometry(path: Path, detections: str = "ego", **options: Any) -> Floats:
    """Steps (F, 3) that an agent is told: x, y, yaw."""
    env = coopsim.parallel_env("replay", path=path, detections=detections, uplink="none", **options)
    observations, _ = env.reset()
    steps = []
    while env.agents:
        steps.append(observations[detections]["odometry"][[0, 1, 3]])
        observations, *_ = env.step({detections: empty_action()})
    return np.array(steps)


def empty_action() -> dict[str, Any]:
    return {"tracks": pack_tracks(Tracks.empty())}


@pytest.mark.parametrize("axes", ["kitti", "v2v4real"])
def test_a_replay_moves_as_its_car_did(make_set: MakeSet, axes: str) -> None:
    speed, turn = errors(odometry(make_set(axes), axes=axes), driven())[5:].T
    assert np.sqrt(np.mean(speed**2)) < 0.4 and np.sqrt(np.mean(turn**2)) < 0.03


def test_all_classes_of_a_detector_show_the_motion(make_set: MakeSet) -> None:
    steps = odometry(make_set(split=True), "rcnn_Cyclist")
    assert np.median(errors(steps, driven())[5:, 0]) < 0.4


@pytest.mark.parametrize("axes", ["kitti", "v2v4real"])
def test_poses_are_read(make_set: MakeSet, axes: str) -> None:
    path = make_set(axes, poses=True)
    for source in ("auto", "poses"):
        np.testing.assert_allclose(errors(odometry(path, odometry=source, axes=axes), driven()), 0, atol=1e-5)
    assert errors(odometry(path, odometry="estimated", axes=axes), driven())[:, 0].max() > 1e-3


def test_the_car_stands_where_the_user_says_so(make_set: MakeSet) -> None:
    path = make_set(poses=True)
    stands, drives = odometry(path, odometry="none"), odometry(path)
    assert len(stands) == len(drives) == FRAMES and np.abs(drives).max() > 0.5
    np.testing.assert_array_equal(stands, 0)


def test_heading_models_need_the_motion(make_set: MakeSet) -> None:
    """A cyclist in a bend, seen from a car that drives, is tracked better in a frame that stands."""
    path = make_set(split=True)

    def score(source: str) -> float:
        result = coopsim.evaluate_recordings("dino_codt_tracking", path, "rcnn_Cyclist", odometry=source)
        return result.count.classes["bicycle"]["sAMOTA"]

    assert score("estimated") > score("none") + 20


def test_what_stands_keeps_its_place_in_the_world(make_set: MakeSet) -> None:
    replay = Replay("test", make_set(poses=True), "ego", DT_S)
    first = replay.start(0, {})
    for _ in range(30):
        frame = replay.advance({}, {})
    stands = slice(0, 10)
    np.testing.assert_allclose(frame.actors.boxes.array[stands], first.actors.boxes.array[stands], atol=1e-4)
    agent = frame.agents["ego"]
    np.testing.assert_allclose(agent.observation.pose.xyz_yaw[:3], agent.body.world_SE3_base.translation)
    assert agent.observation.pose.xyz_yaw[0] > 20


BROKEN_POSES = [
    (lambda text: text.split("\n", 1)[1], "a pose for each of 60 frames is needed, got 59 lines"),
    (lambda text: "1 2 3\n" + text, "line 1: 12 fields with spaces between them are needed, got 3"),
    (lambda text: text.replace("0.000000000e+00", "zero", 1), "line 1: 'zero' is not a number"),
    (lambda text: text.replace("1.000000000e+00", "nan", 1), "line 1: all fields must be finite numbers"),
    (lambda text: text.replace("1.000000000e+00", "2", 1), "line 1: the left 3x3 of a pose must be a rotation"),
]


@pytest.mark.parametrize(("edit", "message"), BROKEN_POSES)
def test_broken_poses(make_set: MakeSet, edit: Callable[[str], str], message: str) -> None:
    path = make_set(poses=True)
    file = path / "poses" / "0000.txt"
    file.write_text(edit(file.read_text()))
    with pytest.raises(RecordingError, match=f"poses/0000.txt.*{message}"):
        read_poses(file, FRAMES)
    env = coopsim.parallel_env("replay", path=path, detections="ego")
    with pytest.raises(RecordingError, match=message):
        env.reset()


def test_poses_of_frames_after_the_last_labels_are_left_out(make_set: MakeSet) -> None:
    path = make_set(poses=True)
    file = path / "poses" / "0000.txt"
    as_it_is = read_poses(file, FRAMES)
    expected = coopsim.evaluate_recordings("no_fusion", path, "ego").count["sAMOTA"]
    file.write_text(file.read_text() + "1 0 0 9 0 1 0 9 0 0 1 9\n" * 3)
    longer = read_poses(file, FRAMES)
    assert len(longer) == FRAMES
    for pose, same in zip(longer, as_it_is, strict=True):
        np.testing.assert_array_equal(pose.translation, same.translation)
    assert coopsim.evaluate_recordings("no_fusion", path, "ego").count["sAMOTA"] == expected


def test_poses_that_are_asked_for_must_be_there(make_set: MakeSet) -> None:
    env = coopsim.parallel_env("replay", path=make_set(), detections="ego", odometry="poses")
    with pytest.raises(RecordingError, match=r"cannot read .*poses/0000\.txt"):
        env.reset()


@pytest.mark.parametrize("option", ["odometry", "axes"])
def test_unknown_conventions(make_set: MakeSet, option: str) -> None:
    with pytest.raises(UnknownNameError, match=f"unknown {option} 'kiti'"):
        coopsim.parallel_env("replay", path=make_set(), detections="ego", **{option: "kiti"})
