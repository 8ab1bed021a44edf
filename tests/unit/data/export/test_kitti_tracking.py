"""KITTI's tracking layout: what is read back by KITTI's own rules is what was simulated."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from coopsim.data.export.export_format import make_export_format
from coopsim.data.export.kitti_format import EARTH_M, OXTS_FIELDS, KittiFormat
from coopsim.data.files.pcd import read_float_points
from coopsim.data.kitti import read_labels
from coopsim.errors import InvalidValueError, UnknownNameError
from coopsim.geometry.se3 import SE3, wrap_angle
from coopsim.sensors.camera.projection import project
from coopsim.types import ObjectClass

AXES = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])  # from a camera's axes to ours


@pytest.fixture(scope="module")
def folder(short_episode, tmp_path_factory):
    folder = tmp_path_factory.mktemp("kitti")
    short_episode.export(KittiFormat(), folder)
    return folder


@pytest.fixture
def own_folder(short_episode, tmp_path):
    """A folder that a test may damage."""
    short_episode.export(KittiFormat(agent="cav_0"), tmp_path)
    return tmp_path


def calibration(folder, sequence: str) -> dict[str, np.ndarray]:
    lines = (folder / f"training/calib/{sequence}.txt").read_text().splitlines()
    return {name.rstrip(":"): np.array(rest, float) for name, *rest in map(str.split, lines)}


def rect_SE3_lidar(folder, sequence: str) -> SE3:
    given = calibration(folder, sequence)
    matrix = given["Tr_velo_cam"].reshape(3, 4)
    turn = given["R_rect"].reshape(3, 3)
    return SE3(turn @ matrix[:, :3], turn @ matrix[:, 3])


def world_SE3_rect(folder, sequence: str, frame) -> SE3:
    column = int(sequence)
    scan = next(iter(frame.agents[column].lidars.values()))
    world_SE3_lidar = frame.agents[column].world_SE3_base.compose(scan.mounting.base_SE3_lidar)
    return world_SE3_lidar.compose(rect_SE3_lidar(folder, sequence).inverse())


@pytest.mark.parametrize("sequence", ["0000", "0001", "0002"])
def test_labels_are_the_objects_that_the_agent_hit(short_episode, folder, sequence):
    frame_of, ids, boxes, label, _ = read_labels(folder / f"training/label_02/{sequence}.txt")
    merged = {ObjectClass.BUS: ObjectClass.TRUCK, ObjectClass.CHILD: ObjectClass.PEDESTRIAN}
    unlabelled = {ObjectClass.MOTORCYCLE, ObjectClass.SCOOTER}  # "Misc", which is no class of ours
    for frame in short_episode.frames:
        # Labels are read in our axes; the frame of the camera turned into them is level.
        level = world_SE3_rect(folder, sequence, frame).compose(SE3(AXES.T, np.zeros(3)))
        rows = np.flatnonzero(frame_of == frame.index)
        truth = frame.objects
        hit = frame.returns[:, int(sequence)] > 0
        expected = {int(truth.id[n]): n for n in np.flatnonzero(hit) if ObjectClass(truth.label[n]) not in unlabelled}
        assert set(ids[rows].tolist()) == set(expected)
        at = [expected[int(number)] for number in ids[rows]]
        placed = boxes[rows].transform(level)
        assert placed.center == pytest.approx(truth.boxes.center[at], abs=1e-4)
        assert placed.size == pytest.approx(truth.boxes.size[at], abs=1e-6)
        assert np.abs(wrap_angle(placed.yaw - truth.boxes.yaw[at])).max() < 1e-5
        want = [merged.get(ObjectClass(number), ObjectClass(number)) for number in truth.label[at]]
        assert label[rows].tolist() == [int(each) for each in want]
    assert len(frame_of)


@pytest.mark.parametrize("sequence", ["0000", "0002"])
def test_points_are_on_the_labelled_objects(short_episode, folder, sequence):
    frame = short_episode.frames[-1]
    rows = read_float_points(folder / f"training/velodyne/{sequence}/{frame.index:06d}.bin", 4)
    scan = next(iter(frame.agents[int(sequence)].lidars.values()))
    assert rows[:, 3] == pytest.approx(scan.intensity)
    level = world_SE3_rect(folder, sequence, frame)
    world = level.apply(rect_SE3_lidar(folder, sequence).apply(rows[:, :3]))
    checked = 0
    for n, number in enumerate(frame.objects.id):
        own = world[scan.instance == number]
        yaw, half = frame.objects.boxes.yaw[n], frame.objects.boxes.size[n] / 2
        local = (own - frame.objects.boxes.center[n]) @ SE3.from_xyz_yaw(np.zeros(3), yaw).rotation
        assert (np.abs(local) <= half + 0.15).all()  # the range's noise
        checked += len(own)
    assert checked > 100


@pytest.mark.parametrize("sequence", ["0000", "0002"])
def test_oxts_give_the_poses_by_the_kit_s_formula(short_episode, folder, sequence):
    lines = (folder / f"training/oxts/{sequence}.txt").read_text().splitlines()
    rows = np.array([line.split() for line in lines], float)
    assert rows.shape == (len(short_episode.frames), len(OXTS_FIELDS))
    lat, lon, alt, yaw = rows[:, 0], rows[:, 1], rows[:, 2], rows[:, 5]
    scale = np.cos(np.radians(lat[0]))
    x = scale * np.radians(lon) * EARTH_M
    y = scale * EARTH_M * np.log(np.tan(np.pi * (90 + lat) / 360))
    poses = [frame.agents[int(sequence)].world_SE3_base for frame in short_episode.frames]
    assert np.column_stack([x, y, alt]) == pytest.approx(np.array([pose.translation for pose in poses]), abs=1e-5)
    assert np.abs(wrap_angle(yaw - [pose.yaw for pose in poses])).max() < 1e-9


def test_oxts_speed_is_the_car_s(short_episode, folder):
    rows = np.loadtxt(folder / "training/oxts/0000.txt")
    speed = [frame.agents[0].speed_m_s for frame in short_episode.frames]
    assert np.hypot(rows[:, OXTS_FIELDS.index("vf")], rows[:, OXTS_FIELDS.index("vl")]) == pytest.approx(speed)
    assert max(speed) > 1
    assert rows[:, OXTS_FIELDS.index("az")] == pytest.approx(9.81)


def test_a_camera_that_looks_down_projects_as_ours(short_episode, folder):
    frame = short_episode.frames[0]
    shot = frame.agents[2].cameras["front"]
    places = np.random.default_rng(0).uniform([5, -10, 0], [30, 10, 2], (50, 3))  # in the unit's base frame
    rect = world_SE3_rect(folder, "0002", frame).inverse().compose(frame.agents[2].world_SE3_base).apply(places)
    pixels = calibration(folder, "0002")["P2"].reshape(3, 4) @ np.column_stack([rect, np.ones(50)]).T
    ours = project(shot.calibration, places)
    assert ours.inside.sum() > 10
    assert (pixels[:2] / pixels[2]).T[ours.inside] == pytest.approx(ours.place_px[ours.inside], abs=1e-6)
    assert (folder / "training/image_02/0002/000000.png").is_file()
    assert not (folder / "training/image_02/0000").exists()


def test_only_labels_in_the_picture(short_episode, folder, tmp_path):
    short_episode.export(KittiFormat(agent="rsu_0", labels="picture"), tmp_path)
    around = (folder / "training/label_02/0002.txt").read_text().splitlines()
    inside = (tmp_path / "training/label_02/0000.txt").read_text().splitlines()
    assert 0 < len(inside) < len(around)
    assert inside == [line for line in around if " -1.000000 -1.000000 -1.000000 -1.000000 " not in line]


def test_every_agent_is_a_sequence(folder):
    listed = (folder / "training/sequences.csv").read_text().splitlines()
    assert listed == [
        "sequence,episode,agent,kind",
        "0000,crossing_0007,cav_0,cav",
        "0001,crossing_0007,cav_1,cav",
        "0002,crossing_0007,rsu_0,rsu",
    ]
    seqmap = (folder / "training/evaluate_tracking.seqmap.training").read_text().splitlines()
    assert seqmap[0] == "0000 empty 000000 000006"


def test_a_sequence_without_objects_says_how_long_it_is(short_episode, tmp_path):
    unseen = [
        replace(frame, objects=replace(frame.objects, returns=np.zeros_like(frame.returns)))
        for frame in short_episode.frames
    ]
    replace(short_episode, frames=tuple(unseen)).export(KittiFormat(agent="cav_0"), tmp_path)
    ids, *_, last = read_labels(tmp_path / "training/label_02/0000.txt")
    assert (len(ids), last) == (0, len(unseen) - 1)


def test_an_interrupted_episode_ends_in_the_same_bytes(short_episode, folder_bytes, folder, tmp_path):
    short_episode.export(KittiFormat(), tmp_path, frames=3, finish=False)
    short_episode.export(KittiFormat(), tmp_path)
    assert folder_bytes(tmp_path) == folder_bytes(folder)


def test_a_whole_folder_has_no_problems(folder):
    assert list(KittiFormat().check(folder)) == []


def broken_line(path, line: int, old: str, new: str) -> None:
    lines = path.read_text().splitlines()
    assert old in lines[line]
    lines[line] = lines[line].replace(old, new, 1)
    path.write_text("\n".join(lines) + "\n")


@pytest.mark.parametrize(
    ("damage", "said"),
    [
        (lambda root: (root / "velodyne/0000/000001.bin").write_bytes(b"123"), "velodyne/0000/000001.bin: a row is 4"),
        (lambda root: (root / "calib/0000.txt").unlink(), "calib/0000.txt: cannot read: No such file"),
        (
            lambda root: broken_line(root / "calib/0000.txt", 4, "R_rect 1", "R_rect 3"),
            "calib/0000.txt: R_rect must have a rotation",
        ),
        (lambda root: broken_line(root / "calib/0000.txt", 2, "P2", "P7"), "calib/0000.txt: P2 is missing"),
        (lambda root: broken_line(root / "oxts/0000.txt", 3, "0.0", "nan"), "oxts/0000.txt: line 4: "),
        (lambda root: broken_line(root / "label_02/0000.txt", 0, " ", " x"), "label_02/0000.txt: line 1: 'x"),
    ],
)
def test_a_check_names_file_and_field(own_folder, damage, said):
    damage(own_folder / "training")
    (problem,) = KittiFormat().check(own_folder)
    assert str(problem).startswith(f"training/{said}")


def test_refusals(short_episode, tmp_path):
    with pytest.raises(UnknownNameError, match="cav_9"):
        short_episode.export(make_export_format("kitti(agent=cav_9)"), tmp_path)
    with pytest.raises(UnknownNameError, match="roof"):
        short_episode.export(make_export_format("kitti(lidar=roof)"), tmp_path)
    with pytest.raises(UnknownNameError, match="labels"):
        make_export_format("kitti(labels=all)")
    with pytest.raises(UnknownNameError, match="front"):  # the cars have no cameras
        short_episode.export(make_export_format("kitti(camera=front)"), tmp_path)
    blind = {name: spec.__class__(spec.name, spec.kind, spec.dt_s) for name, spec in short_episode.agents.items()}
    with pytest.raises(InvalidValueError, match="needs a LiDAR"):
        KittiFormat().require(blind)
    assert not any(tmp_path.iterdir())
