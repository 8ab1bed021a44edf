"""nuScenes' tables: what its schema promises, and boxes, points and times as simulated."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from coopsim.data.export.export_format import make_export_format
from coopsim.data.export.nuscenes_format import LINKS, TABLES, NuscenesFormat, check_nuscenes
from coopsim.data.export.nuscenes_records import CATEGORIES, VERSION
from coopsim.data.files.pcd import read_float_points
from coopsim.errors import InvalidValueError, UnknownNameError
from coopsim.geometry.se3 import SE3
from coopsim.types import ObjectClass

KEY_FRAMES = [0, 2, 4]  # of six frames, every 0.2 s


@pytest.fixture(scope="module")
def folder(short_episode, tmp_path_factory):
    folder = tmp_path_factory.mktemp("nuscenes")
    short_episode.export(NuscenesFormat(key_frame_s=0.2), folder)
    return folder


@pytest.fixture(scope="module")
def tables(folder):
    return {name: load(folder, name) for name in TABLES}


@pytest.fixture
def own_folder(short_episode, tmp_path):
    """A folder that a test may damage."""
    short_episode.export(NuscenesFormat(agent="cav_0", key_frame_s=0.2), tmp_path)
    return tmp_path


def load(folder, name: str):
    return json.loads((folder / VERSION / f"{name}.json").read_text())


def by_token(records):
    return {record["token"]: record for record in records}


def placed(record) -> SE3:
    w, x, y, z = record["rotation"]
    return SE3(Rotation.from_quat([x, y, z, w]).as_matrix(), np.array(record["translation"]))


def key_scans(tables, scene: str):
    """The sweeps of a scene's key frames, in order."""
    rows = [row for row in tables["sample_data"] if f"/LIDAR_TOP/{scene}__" in row["filename"]]
    return [row for row in rows if row["is_key_frame"]]


def test_the_tables_are_those_of_the_schema(folder, tables):
    assert list(check_nuscenes(folder)) == []
    assert {path.stem for path in (folder / VERSION).iterdir()} == {*TABLES, "splits"}
    assert set(LINKS) <= set(TABLES)
    assert json.loads((folder / VERSION / "splits.json").read_text()) == {"all": [s["name"] for s in tables["scene"]]}
    assert [scene["name"] for scene in tables["scene"]] == [
        f"crossing_0007-{name}" for name in ("cav_0", "cav_1", "rsu_0")
    ]


@pytest.mark.parametrize(("scene", "column"), [("crossing_0007-cav_1", 1), ("crossing_0007-rsu_0", 2)])
def test_annotations_are_all_objects_but_the_agent(short_episode, tables, scene, column):
    samples, poses = by_token(tables["sample"]), by_token(tables["ego_pose"])
    instances, categories = by_token(tables["instance"]), by_token(tables["category"])
    for index, scan in zip(KEY_FRAMES, key_scans(tables, scene), strict=True):
        frame = short_episode.frames[index]
        agent, objects = frame.agents[column], frame.objects
        assert samples[scan["sample_token"]]["timestamp"] == scan["timestamp"]
        assert placed(poses[scan["ego_pose_token"]]).translation == pytest.approx(
            agent.world_SE3_base.translation, abs=1e-6
        )
        rows = np.flatnonzero(objects.id != (agent.body.actor_id or -1))
        found = [row for row in tables["sample_annotation"] if row["sample_token"] == scan["sample_token"]]
        assert len(found) == len(rows)
        for row, record in zip(rows, found, strict=True):
            box = objects.boxes
            assert record["translation"] == pytest.approx(box.center[row].tolist(), abs=1e-6)
            assert record["size"] == pytest.approx(box.size[row][[1, 0, 2]].tolist())
            assert placed(record).rotation[:2, :2] == pytest.approx(
                SE3.from_xyz_yaw(np.zeros(3), box.yaw[row]).rotation[:2, :2]
            )
            assert record["num_lidar_pts"] == frame.returns[row].sum()
            assert record["num_own_lidar_pts"] == frame.returns[row, column]
            category = categories[instances[record["instance_token"]]["category_token"]]["name"]
            assert category == CATEGORIES[ObjectClass(objects.label[row])]


def test_points_are_on_their_objects(short_episode, folder, tables):
    scan, frame = key_scans(tables, "crossing_0007-rsu_0")[-1], short_episode.frames[KEY_FRAMES[-1]]
    source = next(iter(frame.agents[2].lidars.values()))
    rows = read_float_points(folder / scan["filename"], 5)
    assert rows[:, 3] == pytest.approx(source.intensity * 255, abs=1e-3)
    assert rows[:, 4].tolist() == source.beam.tolist()
    base = placed(by_token(tables["ego_pose"])[scan["ego_pose_token"]])
    sensor = placed(by_token(tables["calibrated_sensor"])[scan["calibrated_sensor_token"]])
    world, checked = base.compose(sensor).apply(rows[:, :3]), 0
    for n, number in enumerate(frame.objects.id):
        own = world[source.instance == number]
        turn = SE3.from_xyz_yaw(np.zeros(3), frame.objects.boxes.yaw[n]).rotation
        assert (np.abs((own - frame.objects.boxes.center[n]) @ turn) <= frame.objects.boxes.size[n] / 2 + 0.15).all()
        checked += len(own)
    assert checked > 50


def test_chains_go_through_every_record_of_a_scene(short_episode, tables):
    annotations = by_token(tables["sample_annotation"])
    for instance in tables["instance"]:
        chain = [annotations[instance["first_annotation_token"]]]
        while chain[-1]["next"]:
            assert annotations[chain[-1]["next"]]["prev"] == chain[-1]["token"]
            chain.append(annotations[chain[-1]["next"]])
        assert len(chain) == instance["nbr_annotations"]
        assert chain[-1]["token"] == instance["last_annotation_token"]
        assert {record["instance_token"] for record in chain} == {instance["token"]}
    samples, data = by_token(tables["sample"]), by_token(tables["sample_data"])
    for scene in tables["scene"]:
        count, sample = 1, samples[scene["first_sample_token"]]
        while sample["next"]:
            count, sample = count + 1, samples[sample["next"]]
        assert (count, sample["token"]) == (scene["nbr_samples"], scene["last_sample_token"])
    first = [row for row in tables["sample_data"] if not row["prev"]]
    assert len(first) == 4  # three LiDARs and a camera
    for row in first:
        kinds = [row["is_key_frame"]]
        while row["next"]:
            row = data[row["next"]]
            kinds.append(row["is_key_frame"])
        assert kinds == [True, False] * 3


def test_an_object_that_comes_back_is_another_instance(short_episode, tmp_path):
    number = short_episode.frames[0].objects.id[-1]
    frames = list(short_episode.frames)
    there = frames[2].objects.id != number
    without = replace(
        frames[2].objects,
        **{name: getattr(frames[2].objects, name)[there] for name in ("id", "boxes", "label", "velocity", "returns")},
    )
    frames[2] = replace(frames[2], objects=without)
    replace(short_episode, frames=tuple(frames)).export(NuscenesFormat(agent="rsu_0", key_frame_s=0.2), tmp_path)
    assert list(check_nuscenes(tmp_path)) == []
    counts = [instance["nbr_annotations"] for instance in load(tmp_path, "instance")]
    assert sorted(counts) == [1, 1] + [3] * (len(there) - 1)


def test_only_the_own_points_on_request(short_episode, tmp_path):
    short_episode.export(NuscenesFormat(agent="cav_0", points="own"), tmp_path)
    records = load(tmp_path, "sample_annotation")
    assert all(record["num_lidar_pts"] == record["num_own_lidar_pts"] for record in records)
    assert any(record["num_lidar_pts"] == 0 for record in records)


def test_an_interrupted_episode_ends_in_the_same_bytes(short_episode, folder_bytes, folder, tmp_path):
    short_episode.export(NuscenesFormat(key_frame_s=0.2), tmp_path, frames=3, finish=False)
    short_episode.export(NuscenesFormat(key_frame_s=0.2), tmp_path)
    assert folder_bytes(tmp_path) == folder_bytes(folder)


def change(folder, name: str, edit) -> None:
    content = load(folder, name)
    edit(content)
    (folder / VERSION / f"{name}.json").write_text(json.dumps(content))


def remove_log(folder) -> None:
    (folder / VERSION / "log.json").unlink()


def unlink(folder) -> None:
    change(folder, "sample_annotation", lambda records: records[0].update(instance_token="x"))


def repeat(folder) -> None:
    change(folder, "sample", lambda records: records.append(records[0]))


def cut_off(folder) -> None:
    next((folder / "sweeps/LIDAR_TOP").iterdir()).write_bytes(b"12345")


@pytest.mark.parametrize(
    ("damage", "said"),
    [
        (remove_log, f"{VERSION}/log.json: cannot read the file"),
        (unlink, f"{VERSION}/sample_annotation.json: [0].instance_token: must be a token of instance.json, got 'x'"),
        (repeat, f"{VERSION}/sample.json: [3].token: must be a text that stands once"),
        (cut_off, "sweeps/LIDAR_TOP/crossing_0007-cav_0__LIDAR_TOP__"),
    ],
)
def test_a_check_names_file_and_field(own_folder, damage, said):
    damage(own_folder)
    assert any(str(problem).startswith(said) for problem in check_nuscenes(own_folder))


def test_refusals(short_episode):
    with pytest.raises(UnknownNameError, match="cav_9"):
        make_export_format("nuscenes(agent=cav_9)").require(short_episode.agents)
    with pytest.raises(InvalidValueError, match="key_frame_s"):
        make_export_format("nuscenes(key_frame_s=0)")
    with pytest.raises(UnknownNameError, match="some"):
        make_export_format("nuscenes(points=some)")
