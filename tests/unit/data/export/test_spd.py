"""V2X-Seq-SPD: both sides and the cooperative labels hold what was simulated."""

from __future__ import annotations

import json

import numpy as np
import pytest

from coopsim.data.export.export_format import make_export_format
from coopsim.data.export.spd_format import SPD_TYPES, SpdFormat
from coopsim.data.files.pcd import read_pcd
from coopsim.errors import InvalidValueError, UnknownNameError
from coopsim.geometry.se3 import SE3, wrap_angle
from coopsim.types import ObjectClass

SIDES = {"vehicle-side": 0, "infrastructure-side": 2}  # numbers of the agents


@pytest.fixture(scope="module")
def folder(short_episode, tmp_path_factory):
    folder = tmp_path_factory.mktemp("spd")
    short_episode.export(SpdFormat(), folder)
    return folder


@pytest.fixture
def own_folder(short_episode, tmp_path):
    """A folder that a test may damage."""
    short_episode.export(SpdFormat(), tmp_path)
    return tmp_path


def load(path):
    return json.loads(path.read_text())


def rigid(content) -> SE3:
    return SE3(np.array(content["rotation"]), np.array(content["translation"])[:, 0])


def world_SE3_lidar(folder, side: str, record) -> SE3:
    """Compose as the development kit does."""
    root = folder / side
    if side == "infrastructure-side":
        return rigid(load(root / record["calib_virtuallidar_to_world_path"]))
    novatel_SE3_lidar = rigid(load(root / record["calib_lidar_to_novatel_path"])["transform"])
    return rigid(load(root / record["calib_novatel_to_world_path"])).compose(novatel_SE3_lidar)


def assert_is(label, truth, row: int, world_SE3: SE3) -> None:
    place, size = label["3d_location"], label["3d_dimensions"]
    center = world_SE3.apply([place["x"], place["y"], place["z"]])
    assert center == pytest.approx(truth.boxes.center[row], abs=1e-5)
    assert [size["l"], size["w"], size["h"]] == pytest.approx(truth.boxes.size[row].tolist())
    assert abs(float(wrap_angle(label["rotation"] + world_SE3.yaw - truth.boxes.yaw[row]))) < 1e-5
    assert label["type"] == SPD_TYPES[ObjectClass(truth.label[row])]


@pytest.mark.parametrize("side", SIDES)
def test_each_side_labels_what_its_lidar_hit(short_episode, folder, side):
    records = load(folder / side / "data_info.json")
    assert [record["frame_id"] for record in records] == [f"{n:06d}" for n in range(len(short_episode.frames))]
    for frame, record in zip(short_episode.frames, records, strict=True):
        labels = load(folder / side / record["label_lidar_std_path"])
        hit = np.flatnonzero(frame.returns[:, SIDES[side]] > 0)
        assert [int(label["track_id"]) for label in labels] == frame.objects.id[hit].tolist()
        for row, label in zip(hit, labels, strict=True):
            assert_is(label, frame.objects, row, world_SE3_lidar(folder, side, record))
    assert len(labels) > 1


@pytest.mark.parametrize("side", SIDES)
def test_points_are_on_their_objects(short_episode, folder, side):
    frame, record = short_episode.frames[-1], load(folder / side / "data_info.json")[-1]
    cloud = read_pcd(folder / side / record["pointcloud_path"])
    scan = next(iter(frame.agents[SIDES[side]].lidars.values()))
    assert cloud.intensity == pytest.approx(scan.intensity * 255, abs=1e-3)
    world, checked = world_SE3_lidar(folder, side, record).apply(cloud.points), 0
    for n, number in enumerate(frame.objects.id):
        own = world[scan.instance == number]
        turn = SE3.from_xyz_yaw(np.zeros(3), frame.objects.boxes.yaw[n]).rotation
        assert (np.abs((own - frame.objects.boxes.center[n]) @ turn) <= frame.objects.boxes.size[n] / 2 + 0.15).all()
        checked += len(own)
    assert checked > 50


def test_cooperative_labels_are_the_union_in_the_vehicle_s_frame(short_episode, folder):
    records = load(folder / "vehicle-side/data_info.json")
    sides = set()
    for frame, record in zip(short_episode.frames, records, strict=True):
        truth, own = frame.objects, frame.agents[0].body.actor_id
        seen = {side: frame.returns[:, column] > 0 for side, column in (("veh", 0), ("inf", 2))}
        rows = np.flatnonzero((seen["veh"] | seen["inf"]) & (truth.id != own))
        labels = load(folder / f"cooperative/label/{record['frame_id']}.json")
        assert [int(label["track_id"]) for label in labels] == truth.id[rows].tolist()
        tokens = {
            side: {label["token"] for label in load(folder / name / f"label/{lidar}/{record['frame_id']}.json")}
            for side, name, lidar in (
                ("veh", "vehicle-side", "lidar"),
                ("inf", "infrastructure-side", "virtuallidar"),
            )
        }
        for row, label in zip(rows, labels, strict=True):
            assert_is(label, truth, row, world_SE3_lidar(folder, "vehicle-side", record))
            both = [side for side in seen if seen[side][row]]
            assert label["from_side"] == ("coop" if len(both) == 2 else both[0])
            for side in seen:
                assert (label[f"{side}_token"] in tokens[side]) == bool(seen[side][row])
                assert label[f"{side}_track_id"] == (label["track_id"] if seen[side][row] else "-1")
            sides.add(label["from_side"])
    assert sides == {"veh", "inf", "coop"}


def test_the_camera_that_looks_down_shows_its_labels(short_episode, folder):
    record = load(folder / "infrastructure-side/data_info.json")[0]
    root = folder / "infrastructure-side"
    camera_SE3_lidar = rigid(load(root / record["calib_virtuallidar_to_camera_path"]))
    lens = np.array(load(root / record["calib_camera_intrinsic_path"])["cam_K"]).reshape(3, 3)
    labels = load(root / record["label_camera_std_path"])
    for label in labels:
        place = camera_SE3_lidar.apply([label["3d_location"][axis] for axis in "xyz"])
        column, row, depth = lens @ place
        box = label["2d_box"]
        if label["truncated_state"] == 0:
            assert box["xmin"] < column / depth < box["xmax"]
            assert box["ymin"] < row / depth < box["ymax"]
    assert labels
    assert (root / record["image_path"]).is_file()
    vehicle = load(folder / "vehicle-side/data_info.json")[0]
    assert vehicle["image_path"] == ""  # it carries no camera in this episode
    assert "calib_camera_intrinsic_path" not in vehicle


def test_an_interrupted_episode_ends_in_the_same_bytes(short_episode, folder_bytes, folder, tmp_path):
    short_episode.export(SpdFormat(), tmp_path, frames=3, finish=False)
    short_episode.export(SpdFormat(), tmp_path)
    found = folder_bytes(tmp_path)
    assert found == folder_bytes(folder)
    assert not any(name.startswith(".parts") for name in found)


def test_a_whole_folder_has_no_problems(folder):
    assert list(SpdFormat().check(folder)) == []


def change(path, edit) -> None:
    content = load(path)
    edit(content)
    path.write_text(json.dumps(content))


@pytest.mark.parametrize(
    ("damage", "said"),
    [
        (lambda root: (root / "vehicle-side/velodyne/000002.pcd").unlink(), "vehicle-side/velodyne/000002.pcd: cannot"),
        (
            lambda root: (root / "infrastructure-side/data_info.json").write_text("{}"),
            "infrastructure-side/data_info.json: a list of frames is needed",
        ),
        (
            lambda root: change(root / "vehicle-side/data_info.json", lambda all_: all_[1].pop("frame_id")),
            "vehicle-side/data_info.json: [1].frame_id is missing",
        ),
        (
            lambda root: change(
                root / "cooperative/data_info.json", lambda all_: all_[0].update(infrastructure_frame="000099")
            ),
            "cooperative/data_info.json: [0].infrastructure_frame must be a frame",
        ),
    ],
)
def test_a_check_names_file_and_field(own_folder, damage, said):
    damage(own_folder)
    assert any(str(problem).startswith(said) for problem in SpdFormat().check(own_folder))


def test_a_second_car_can_be_the_vehicle(short_episode, tmp_path):
    short_episode.export(SpdFormat(vehicle="cav_1"), tmp_path)
    pose = rigid(load(tmp_path / "vehicle-side/calib/novatel_to_world/000000.json"))
    assert pose.translation == pytest.approx(short_episode.frames[0].agents[1].world_SE3_base.translation)


def test_refusals(short_episode):
    cars = {name: spec for name, spec in short_episode.agents.items() if spec.kind == "cav"}
    with pytest.raises(InvalidValueError, match="needs a roadside unit, agents are cav_0, cav_1"):
        SpdFormat().require(cars)
    units = {name: spec for name, spec in short_episode.agents.items() if spec.kind == "rsu"}
    with pytest.raises(InvalidValueError, match="needs a connected car, agents are rsu_0"):
        SpdFormat().require(units)
    with pytest.raises(UnknownNameError, match="rsu_0"):
        make_export_format("v2x-seq(vehicle=rsu_0)").require(short_episode.agents)
