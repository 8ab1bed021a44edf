"""The same scene, read from a folder of each data set of one car."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import tiny_recordings as tiny
import tiny_single_car as single
from PIL import Image

from coopsim.errors import RecordingError
from coopsim.geometry.se3 import SE3, wrap_angle
from coopsim.recordings.formats import find_format, open_folder
from coopsim.recordings.recorded_folder import ReadingOptions
from coopsim.recordings.recorded_scene import RecordedScenes, count_returns_in
from coopsim.types import ObjectClass

WRITERS: dict[str, Callable[[Path], Path]] = {
    "kitti_object": single.write_kitti_object,
    "argoverse2": single.write_argoverse2,
    "nuscenes": single.write_nuscenes,
    "arrays": single.write_arrays,
    "arrays of others": single.write_clouds_with_labels,
}
FILMS = ("argoverse2", "nuscenes", "arrays")
SECOND = {"argoverse2": ObjectClass.TRUCK, "nuscenes": ObjectClass.BUS, "arrays": ObjectClass.TRUCK}


@pytest.fixture(params=WRITERS)
def written(request: pytest.FixtureRequest, tmp_path: Path) -> tuple[str, Path]:
    return request.param, WRITERS[request.param](tmp_path / "set")


def test_the_format_is_found(written: tuple[str, Path]) -> None:
    name, path = written
    assert find_format(path) == name.split(" ")[0]


def test_poses_boxes_and_points_are_the_scene_s(written: tuple[str, Path]) -> None:
    """Float16 points of Argoverse 2 are exact to 16 mm at 30 m, and labels upright in a tilting frame to 0.001 rad."""
    name, path = written
    near_m = 0.02 if name == "argoverse2" else 1e-3
    folder = open_folder(path, ReadingOptions(points="all"))
    (sequence_name,) = folder.sequences
    sequence = folder.open(sequence_name)
    assert sequence.frames == tiny.FRAMES
    for number in range(tiny.FRAMES):
        frame = sequence.frame(number)
        step_s = tiny.STEP_S if name in FILMS else 0.5
        start_ns = sequence.frame(0).time_ns
        assert frame.time_ns - start_ns == pytest.approx(number * step_s * 1e9, abs=1e3)
        (agent,) = frame.agents.values()
        np.testing.assert_allclose(agent.world_SE3_base.translation, 0.0, atol=1e-6)
        np.testing.assert_allclose(agent.world_SE3_base.rotation, np.eye(3), atol=1e-6)
        found, true = frame.objects.boxes, tiny.boxes(number)
        np.testing.assert_allclose(found.array[:, :6], true.array[:, :6], atol=1e-3)
        np.testing.assert_allclose(wrap_angle(found.yaw - true.yaw), 0.0, atol=1e-3)
        sweep, (points, intensity) = agent.read_sweep(), tiny.cloud(number, SE3.identity())
        np.testing.assert_allclose(sweep.points, points, atol=near_m)
        np.testing.assert_allclose(sweep.intensity, intensity, atol=1 / 255)
        assert (count_returns_in(found, [sweep]) >= 4).all(), "the upper corners of both cars are in their boxes"


def test_the_lidar_is_where_the_calibration_says(written: tuple[str, Path]) -> None:
    name, path = written
    heights = {"kitti_object": 1.73, "argoverse2": single.AV2_HEIGHT_M, "nuscenes": 1.84}
    folder = open_folder(path)
    (agent,) = folder.open(folder.sequences[0]).frame(0).agents.values()
    np.testing.assert_allclose(agent.base_SE3_lidar.translation, [0, 0, heights.get(name, 1.8)], atol=1e-6)


@pytest.mark.parametrize("name", FILMS)
def test_films_have_identities_velocities_and_classes(name: str, tmp_path: Path) -> None:
    folder = open_folder(WRITERS[name](tmp_path / "set"))
    scenes = RecordedScenes(folder.open(folder.sequences[0]))
    for number in range(tiny.FRAMES):
        actors = scenes.actors(number)
        assert actors.id.tolist() == [1, 2]
        assert actors.label.tolist() == [ObjectClass.CAR, SECOND[name]]
        np.testing.assert_allclose(actors.velocity, [[tiny.SPEED_M_S, 0.0], [0.0, 0.0]], atol=2e-3)


@pytest.mark.parametrize("name", [name for name in WRITERS if name not in FILMS])
def test_unrelated_frames_share_no_object(name: str, tmp_path: Path) -> None:
    folder = open_folder(WRITERS[name](tmp_path / "set"))
    scenes = RecordedScenes(folder.open(folder.sequences[0]))
    ids = np.concatenate([scenes.actors(number).id for number in range(tiny.FRAMES)])
    assert len(set(ids.tolist())) == 2 * tiny.FRAMES
    assert not scenes.actors(1).velocity.any()


def test_pictures_of_kitti_are_found(tmp_path: Path) -> None:
    folder = open_folder(single.write_kitti_object(tmp_path))
    (tmp_path / "training/image_2").mkdir()
    Image.new("RGB", (1242, 375), (10, 200, 30)).save(tmp_path / "training/image_2/000005.png")
    first, second = (folder.open("training").frame(number).agents["cav_0"].find_pictures() for number in (0, 1))
    assert first["image_02"].rgb()[0, 0].tolist() == [10, 200, 30] and not second
    looks_along = first["image_02"].calibration.base_SE3_camera.rotate(np.array([[0.0, 0.0, 1.0]]))
    np.testing.assert_allclose(looks_along, [[1.0, 0.0, 0.0]], atol=1e-6)


def test_only_the_labelled_part_of_an_array_is_kept(tmp_path: Path) -> None:
    path = single.write_arrays(tmp_path, fov_deg=np.float64(90))
    kept, every = (
        open_folder(path, ReadingOptions(points=points)).open("queue").frame(0).agents["cav_0"].read_sweep()
        for points in ("picture", "all")
    )
    assert 0 < len(kept) < len(every)
    assert (np.abs(kept.points[:, 1]) <= kept.points[:, 0]).all()


def test_arrays_may_be_plain_rows_of_floats(tmp_path: Path) -> None:
    folder = open_folder(single.write_clouds_with_labels(tmp_path, ".bin"), ReadingOptions(lidar_height_m=1.8))
    sweep = folder.open("points").frame(2).agents["cav_0"].read_sweep()
    np.testing.assert_allclose(sweep.points, tiny.cloud(2, SE3.identity())[0], atol=1e-5)


def test_files_of_arrays_are_sequences_by_their_names(tmp_path: Path) -> None:
    single.write_arrays(tmp_path)
    for name in ("av2_7fab_1", "av2_7fab_0", "000003", "alone"):
        (tmp_path / "queue_07.npz").with_name(f"{name}.npz").write_bytes((tmp_path / "queue_07.npz").read_bytes())
    folder = open_folder(tmp_path)
    assert {name: folder.open(name).frames for name in folder.sequences} == {
        tmp_path.name: 1,
        "alone": 1,
        "av2_7fab": 2,
        "queue": 3,
    }


def test_a_rider_and_the_ridden_bicycle_are_one_object(tmp_path: Path) -> None:
    """The tiny set places all but the first track on the parked car: a bicycle without a rider there stays."""
    path = single.write_argoverse2(tmp_path / "ridden", {"rider": "BICYCLIST", "ridden": "BICYCLE"})
    frame = open_folder(path).open("7fab2350-7eaf-3b7e-a39d-6937a4c1bede").frame(0)
    assert frame.objects.label.tolist().count(ObjectClass.BICYCLE) == 1
    path = single.write_argoverse2(tmp_path / "parked", {"parked": "BICYCLE"})
    frame = open_folder(path).open("7fab2350-7eaf-3b7e-a39d-6937a4c1bede").frame(0)
    assert frame.objects.label.tolist().count(ObjectClass.BICYCLE) == 1


def test_tables_of_one_version_are_read_by_their_own_folder(tmp_path: Path) -> None:
    single.write_nuscenes(tmp_path)
    assert open_folder(tmp_path / "v1.0-mini").sequences == ("scene-0061",)


def test_arrays_tell_where_they_are_doubtful_and_need_no_labels_where_these_are_not_asked_for(tmp_path: Path) -> None:
    pose = np.array([[0.0, -1.0, 0.0, 5.0], [1.0, 0.0, 0.0, 7.0], [0.0, 0.0, 1.0, 0.0], [0.0, 0.0, 0.0, 1.0]])
    doubtful = np.array([[10.0, 1.0, 0.8, 4.0, 2.0, 1.6, 0.0]])
    frame = open_folder(single.write_arrays(tmp_path / "a", doubtful=doubtful, pose=pose)).open("queue").frame(0)
    np.testing.assert_allclose(frame.doubtful, [[4.0, 17.0, 0.8, 4.0, 2.0, 1.6, np.pi / 2]], atol=1e-9)
    bare = single.write_arrays(tmp_path / "b", boxes=None, names=None)
    frame = open_folder(bare, ReadingOptions(labelled=False)).open("queue").frame(0)
    assert not len(frame.objects) and not len(frame.doubtful)
    with pytest.raises(RecordingError, match="names is missing"):
        open_folder(bare).open("queue").frame(0)
    for wrong in (np.zeros((1, 7)), np.zeros((2, 6)), np.array(["x"])):
        with pytest.raises(RecordingError, match="doubtful"):
            open_folder(single.write_arrays(tmp_path / "c", doubtful=wrong)).open("queue").frame(0)
