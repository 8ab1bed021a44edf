"""The same scene, read from a folder of each format."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import tiny_recordings as tiny

from coopsim.errors import RecordingError
from coopsim.geometry.se3 import wrap_angle
from coopsim.recordings.formats import find_format, open_folder
from coopsim.recordings.recorded_folder import ReadingOptions
from coopsim.recordings.recorded_scene import RecordedScenes

WRITERS: dict[str, Callable[[Path], Path]] = {
    "opv2v": tiny.write_opv2v,
    "v2v4real": tiny.write_v2v4real,
    "spd": tiny.write_spd,
    "kitti": tiny.write_kitti,
}


@pytest.fixture(params=WRITERS)
def written(request: pytest.FixtureRequest, tmp_path: Path) -> tuple[str, Path]:
    return request.param, WRITERS[request.param](tmp_path / "set")


def test_the_format_is_found(written: tuple[str, Path]) -> None:
    name, path = written
    assert find_format(path) == name


def test_poses_boxes_and_points_are_the_scene_s(written: tuple[str, Path]) -> None:
    _, path = written
    folder = open_folder(path, ReadingOptions(points="all"))
    sequence = folder.open(folder.sequences[0])
    assert sequence.frames == tiny.FRAMES
    for number in range(tiny.FRAMES):
        frame = sequence.frame(number)
        assert frame.time_ns == pytest.approx(number * tiny.STEP_S * 1e9, abs=1)
        assert frame.objects.id.tolist() == list(tiny.IDS)
        found, true = frame.objects.boxes, tiny.boxes(number)
        # Boxes that are upright in a frame that tilts by 2 degrees turn by less than 0.001 where they are made upright.
        np.testing.assert_allclose(found.array[:, :6], true.array[:, :6], atol=1e-4)
        np.testing.assert_allclose(wrap_angle(found.yaw - true.yaw), 0.0, atol=1e-3)
        for agent, world_SE3_base in zip(frame.agents.values(), tiny.WORLD_SE3_BASES, strict=False):
            np.testing.assert_allclose(agent.world_SE3_base.translation, world_SE3_base.translation, atol=1e-4)
            np.testing.assert_allclose(agent.world_SE3_base.rotation, world_SE3_base.rotation, atol=1e-6)
            sweep = agent.read_sweep()
            points, intensity = tiny.cloud(number, world_SE3_base)
            np.testing.assert_allclose(sweep.points, points, atol=2e-4)
            np.testing.assert_allclose(sweep.intensity, intensity, atol=1 / 255)


def test_velocities_and_returns_are_computed(written: tuple[str, Path]) -> None:
    _, path = written
    folder = open_folder(path)
    scenes = RecordedScenes(folder.open(folder.sequences[0]))
    for number in range(tiny.FRAMES):
        actors = scenes.actors(number)
        assert actors.velocity[0] == pytest.approx([tiny.SPEED_M_S, 0.0], abs=1e-3)
        assert actors.velocity[1] == pytest.approx([0.0, 0.0], abs=1e-3)


def test_a_folder_without_recordings_says_what_was_looked_for(tmp_path: Path) -> None:
    with pytest.raises(RecordingError, match=r"has no recordings; looked for: labels/.*OPV2V"):
        find_format(tmp_path)
    with pytest.raises(RecordingError, match=r"no folder .*missing"):
        find_format(tmp_path / "missing")


def test_points_of_kitti_are_those_in_the_picture(tmp_path: Path) -> None:
    tiny.write_kitti(tmp_path)
    points, _ = tiny.cloud(0, tiny.WORLD_SE3_BASES[0])
    (kept,), (every,) = (
        [agent.read_sweep() for agent in open_folder(tmp_path, options).open("0002").frame(0).agents.values()]
        for options in (ReadingOptions(), ReadingOptions(points="all"))
    )
    assert len(every) == len(points) and 16 <= len(kept) < len(every)
    assert (kept.points[:, 0] > 0).all()


def test_a_kitti_car_can_be_taken_as_standing(tmp_path: Path) -> None:
    (tiny.write_kitti(tmp_path) / "training/oxts/0002.txt").unlink()
    with pytest.raises(RecordingError, match=r"oxts/0002\.txt.*odometry='none'"):
        open_folder(tmp_path).open("0002").frame(0)
    frame = open_folder(tmp_path, ReadingOptions(odometry="none")).open("0002").frame(1)
    assert (frame.agents["cav_0"].world_SE3_base.translation == 0).all()


def test_the_roadside_unit_of_spd_is_named_as_one(tmp_path: Path) -> None:
    folder = open_folder(tiny.write_spd(tmp_path))
    assert {name: agent.kind for name, agent in folder.agents("0003").items()} == {"cav_0": "cav", "rsu_0": "rsu"}
