"""Recordings with sweeps as environments: perception, channel, scores, and agents that differ between sequences."""

from __future__ import annotations

import json
import shutil
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import tiny_recordings as tiny
from pettingzoo.test import parallel_api_test

import coopsim
from coopsim.cli import main
from coopsim.data.export.export_format import make_export_format
from coopsim.data.export.export_frame import ExportFrame, ExportPlan, ExportSource
from coopsim.detection.detector import Detector, Rng
from coopsim.envs.frames import Frame
from coopsim.envs.parallel import CooperativeEnv
from coopsim.geometry.boxes import Boxes3D
from coopsim.types import Detections, SensorView

SIMULATED = {
    "vehicles": 8,
    "pedestrians": 3,
    "connected_cars": 2,
    "rsus": 1,
    "drones": 1,
    "lidar_columns": 180,
    "cameras": "front",
}


class BoxAtNearest(Detector):
    """Report a box at the nearest point, so that what is detected says what was seen."""

    def detect(self, view: SensorView, rng: Rng) -> Detections:
        (sweep,) = view.sweeps.values()
        nearest = sweep.points[np.argmin(np.linalg.norm(sweep.points, axis=1))]
        return Detections(Boxes3D.from_array([[*nearest, *tiny.SIZE, 0.0]]), np.ones(1), np.zeros(1, np.int64))


@pytest.fixture
def opv2v(tmp_path: Path) -> Path:
    return tiny.write_opv2v(tmp_path / "set")


@pytest.fixture
def varied(opv2v: Path) -> Path:
    """A second sequence, with the first car of the first one and a roadside unit."""
    shutil.copytree(opv2v / "train/s1/101", opv2v / "train/s2/101")
    shutil.copytree(opv2v / "train/s1/202", opv2v / "train/s2/-1")
    return opv2v


@pytest.mark.filterwarnings("ignore:reset option")
def test_the_environment_passes_the_api_test(opv2v: Path) -> None:
    env = coopsim.parallel_env("replay", path=opv2v, detector="simulated")
    parallel_api_test(env, num_cycles=8)


def test_observations_are_in_their_spaces_and_detectors_see_the_sweeps(opv2v: Path) -> None:
    env = coopsim.parallel_env("replay", path=opv2v, detector=BoxAtNearest(), expose_ground_truth=True)
    assert env.possible_agents == ["cav_0", "cav_1"]
    observations, infos = env.reset(seed=0)
    assert infos["cav_0"]["recorded_agents"] == {"cav_0": "101", "cav_1": "202"}
    policy = coopsim.make_policy("no_fusion")
    policy.reset(env.agent_specs)
    frame = 0
    while env.agents:
        for agent, world_SE3_base in zip(env.agents, tiny.WORLD_SE3_BASES, strict=True):
            assert env.observation_space(agent).contains(observations[agent])
            points, _ = tiny.cloud(frame, world_SE3_base)
            nearest = points[np.argmin(np.linalg.norm(points, axis=1))]
            np.testing.assert_allclose(observations[agent]["detections"]["box"][0, :3], nearest, atol=1e-3)
            truth = infos[agent]["ground_truth"]
            expected = tiny.boxes(frame).transform(world_SE3_base.inverse())
            np.testing.assert_allclose(truth["box"], expected.array, atol=1e-4)
            assert (truth["returns"] >= 4).all(), "the upper corners of both cars are in both clouds"
        observations, _, _, over, infos = env.step(policy.act(observations))
        frame += 1
    assert frame == tiny.FRAMES and all(over.values())


def test_every_second_frame(opv2v: Path) -> None:
    env = coopsim.parallel_env("replay", path=opv2v, detector="none", dt_s=0.2, expose_ground_truth=True)
    times = [frame.time_ns for frame in env.frames(seed=0) if not frame.last]
    assert times == [0, 200_000_000]


def test_an_agent_is_not_its_own_object(tmp_path: Path) -> None:
    folder = tiny.write_opv2v(tmp_path, agents=("7", "202"))
    env = coopsim.parallel_env("replay", path=folder, detector="none", expose_ground_truth=True)
    _, infos = env.reset(seed=0)
    assert infos["cav_0"]["actor_id"] == 7 and infos["cav_0"]["ground_truth"]["id"].tolist() == [8]
    assert infos["cav_1"]["actor_id"] is None and infos["cav_1"]["ground_truth"]["id"].tolist() == [7, 8]


def test_messages_are_delayed_by_the_channel(opv2v: Path) -> None:
    at_once = coopsim.evaluate("late_fusion", "replay", path=opv2v, detector=BoxAtNearest())
    late = coopsim.evaluate("late_fusion", "replay", path=opv2v, detector=BoxAtNearest(), latency_s=0.15)
    assert (at_once.messages.delivered, at_once.messages.pending) == (6, 0)
    assert late.messages.sent == 6 and 0 < late.messages.delivered < 6


def test_an_episode_has_the_agents_of_its_sequence(varied: Path) -> None:
    env = coopsim.parallel_env("replay", path=varied, detector=BoxAtNearest(), uplink="detections")
    assert env.possible_agents == ["cav_0", "cav_1", "rsu_0"]
    assert env.sequences == ("train/s1", "train/s2")
    for seed, agents in enumerate((["cav_0", "cav_1"], ["cav_0", "rsu_0"])):
        _, infos = env.reset(seed=seed)
        assert env.agents == agents and infos["cav_0"]["sequence"] == env.sequences[seed]
    result = coopsim.evaluate_recordings("late_fusion", varied, detector=BoxAtNearest())
    assert sorted(result.count.agents) == ["cav_0", "cav_1", "rsu_0"]
    assert result.frames == 2 * tiny.FRAMES


def test_poses_can_be_noisy(opv2v: Path) -> None:
    env = coopsim.parallel_env("replay", path=opv2v, detector="none", position_noise_m=1.0)
    observations, _ = env.reset(seed=0)
    off = [np.abs(seen["pose"][:2] - base.translation[:2]).max() for seen, base in
           zip(observations.values(), tiny.WORLD_SE3_BASES, strict=True)]  # fmt: skip
    assert min(off) > 0.01


def export(folder: Path, name: str) -> list[ExportFrame]:
    """Write three frames in a format; return them."""
    plan = ExportPlan(name, "crossing", (3,), 3, SIMULATED)
    target, source = make_export_format(name), ExportSource(plan, {})
    try:
        target.require(source.agents)
        target.begin(folder, plan)
        target.begin_episode(3)
        written = []
        for frame in source.episode(3):
            target.write(frame)
            written.append(frame)
        target.end_episode()
        target.end()
    finally:
        source.close()
    return written


def replayed(folder: Path, **options: Any) -> tuple[CooperativeEnv, list[Frame]]:
    env = coopsim.parallel_env(
        "replay", path=folder, detector="none", cameras=True, expose_ground_truth=True, **options
    )
    return env, [frame for frame in env.frames(seed=0) if not frame.last]


def test_an_export_as_opv2v_is_read_as_it_was_sensed(tmp_path: Path) -> None:
    written = export(tmp_path, "opv2v")
    env, frames = replayed(tmp_path)
    assert env.possible_agents == [agent.name for agent in written[0].agents]
    for true, frame in zip(written, frames, strict=True):
        assert frame.time_ns == true.time_ns
        for agent in true.agents:
            shown, (scan,) = frame.agents[agent.name], agent.lidars.values()
            body, pose = shown.body.world_SE3_base, agent.world_SE3_base
            np.testing.assert_allclose(body.translation, pose.translation, atol=1e-5)
            np.testing.assert_allclose(body.rotation, pose.rotation, atol=1e-7)
            points = scan.mounting.base_SE3_lidar.apply(scan.points)
            np.testing.assert_allclose(shown.observation.sweeps["lidar"].points, points, atol=1e-4)
            np.testing.assert_allclose(shown.observation.sweeps["lidar"].intensity, scan.intensity, atol=0.51 / 255)
            for camera, shot in agent.cameras.items():
                assert (shown.observation.cameras[camera].rgb == shot.image.rgb).all()
                calibration = env.agent_specs[agent.name].cameras[camera]
                np.testing.assert_allclose(calibration.matrix, shot.calibration.matrix, atol=1e-5)
                there, mine = shot.calibration.base_SE3_camera, calibration.base_SE3_camera
                np.testing.assert_allclose(mine.translation, there.translation, atol=1e-5)
                np.testing.assert_allclose(mine.rotation, there.rotation, atol=1e-6)
        seen = true.returns.sum(axis=1) > 0
        rows = np.argsort(frame.actors.id)
        assert (frame.actors.id[rows] == true.objects.id[seen] + 100_000).all()
        np.testing.assert_allclose(frame.actors.boxes.array[rows], true.objects.boxes.array[seen], atol=1e-5)
        assert (frame.actors.label[rows] == true.objects.label[seen]).all()


@pytest.mark.parametrize(("name", "options"), [("v2x-seq", {}), ("kitti(agent=cav_0)", {"points": "all"})])
def test_an_export_is_read_as_it_was_sensed(name: str, options: dict[str, Any], tmp_path: Path) -> None:
    """Seen from the car, as the world's origin is its first position there; heights need the LiDAR's own."""
    written = export(tmp_path, name)
    heights = {
        agent.spec.kind: float(agent.lidars["lidar"].mounting.base_SE3_lidar.translation[2])
        for agent in reversed(written[0].agents)
    }
    env, frames = replayed(tmp_path, lidar_height_m=heights, **options)
    assert written
    for true, frame in zip(written, frames, strict=True):
        assert frame.time_ns == true.time_ns
        car = true.agents[0]
        base_SE3_world, mine_SE3_world = (
            each.inverse() for each in (car.world_SE3_base, frame.agents["cav_0"].body.world_SE3_base)
        )
        scan, seen = car.lidars["lidar"], frame.agents["cav_0"].observation
        points = scan.mounting.base_SE3_lidar.apply(scan.points)
        np.testing.assert_allclose(seen.sweeps["lidar"].points, points, atol=1e-4)
        np.testing.assert_allclose(seen.sweeps["lidar"].intensity, scan.intensity, atol=1e-6)
        (shot,), (calibration,) = car.cameras.values(), env.agent_specs["cav_0"].cameras.values()
        np.testing.assert_allclose(calibration.matrix, shot.calibration.matrix, atol=1e-5)
        np.testing.assert_allclose(
            calibration.base_SE3_camera.rotation, shot.calibration.base_SE3_camera.rotation, atol=1e-6
        )
        np.testing.assert_allclose(
            calibration.base_SE3_camera.translation, shot.calibration.base_SE3_camera.translation, atol=1e-5
        )
        there = true.objects.boxes.transform(base_SE3_world).array
        rows = {int(key): row for row, key in enumerate(true.objects.id)}
        for key, box in zip(frame.actors.id, frame.actors.boxes.transform(mine_SE3_world).array, strict=True):
            np.testing.assert_allclose(box, there[rows[int(key) - 1]], atol=1e-3)
        if "rsu_0" in frame.agents:
            mast = next(agent for agent in true.agents if agent.name == "rsu_0")
            expected = base_SE3_world.compose(mast.world_SE3_base)
            found = mine_SE3_world.compose(frame.agents["rsu_0"].body.world_SE3_base)
            np.testing.assert_allclose(found.translation, expected.translation, atol=1e-4)
            np.testing.assert_allclose(found.yaw, expected.yaw, atol=1e-6)


def test_an_export_as_nuscenes_is_read_as_it_was_sensed(tmp_path: Path) -> None:
    written = export(tmp_path, "nuscenes(agent=cav_0,key_frame_s=0.1)")
    env, frames = replayed(tmp_path)
    (shot,), (calibration,) = written[0].agents[0].cameras.values(), env.agent_specs["cav_0"].cameras.values()
    there, mine = shot.calibration.base_SE3_camera, calibration.base_SE3_camera
    above_m = written[0].agents[0].lidars["lidar"].mounting.base_SE3_lidar.translation * [1, 1, 0]
    np.testing.assert_allclose(calibration.matrix, shot.calibration.matrix, atol=1e-5)
    np.testing.assert_allclose(mine.rotation, there.rotation, atol=1e-6)
    np.testing.assert_allclose(mine.translation + above_m, there.translation, atol=1e-5)
    for true, frame in zip(written, frames, strict=True):
        assert frame.time_ns == true.time_ns
        car, shown = true.agents[0], frame.agents["cav_0"]
        scan, pose = car.lidars["lidar"], shown.body.world_SE3_base
        base_SE3_lidar = scan.mounting.base_SE3_lidar
        sweep = shown.observation.sweeps["lidar"]
        under_lidar = base_SE3_lidar.apply(scan.points) - base_SE3_lidar.translation * [1, 1, 0]
        np.testing.assert_allclose(sweep.points, under_lidar, atol=1e-4)
        np.testing.assert_allclose(sweep.intensity, scan.intensity, atol=1e-6)
        there = true.objects.boxes.transform(car.world_SE3_base.inverse()).array
        there = there[true.objects.id != car.body.actor_id]
        mine = frame.actors.boxes.transform(pose.inverse()).array
        np.testing.assert_allclose(mine[:, 3:6], there[:, 3:6], atol=1e-4)
        np.testing.assert_allclose(mine[:, :3] + base_SE3_lidar.translation * [1, 1, 0], there[:, :3], atol=1e-3)
        np.testing.assert_allclose(np.sin(mine[:, 6] - there[:, 6]), 0.0, atol=1e-4)


def test_the_command_replays_a_folder(varied: Path, capsys: pytest.CaptureFixture[str]) -> None:
    numbers = varied / "numbers.json"
    command = ["replay", str(varied), "--detector", "simulated", "--policy", "late_fusion", "--json", str(numbers)]
    assert main([*command, "--sequences", "train/s2", "--frames", "2", "--latency-ms", "100"]) == 0
    assert json.loads(numbers.read_text())["frames"] == 2
    capsys.readouterr()
    assert main([*command, "--sequences", "train/s3"]) == 2
    assert "unknown sequence 'train/s3'" in capsys.readouterr().err


def test_a_large_folder_opens_at_once(tmp_path: Path) -> None:
    """No frame is looked at before it is played but the first two of a sequence: here 10,000 frames of two agents."""
    tiny.write_opv2v(tmp_path)
    for agent in ("101", "202"):
        folder = tmp_path / "train/s1" / agent
        for frame in range(10_000):
            stem = f"{74 + 2 * frame:06d}"
            for name in (f"{stem}.yaml", f"{stem}.pcd", f"{stem}_camera0.png"):
                (folder / name).touch()
    coopsim.parallel_env("replay", path=tiny.write_opv2v(tmp_path / "other"), detector="none")  # loads code
    started = time.process_time()  # a busy machine is no failure
    env = coopsim.parallel_env("replay", path=tmp_path / "train", detector="none")
    env.reset(seed=0)
    assert time.process_time() - started < 2.0


@pytest.mark.usefixtures("jobs_here")
def test_detect_takes_a_folder_for_an_environment(varied: Path, capsys: pytest.CaptureFixture[str]) -> None:
    rows = varied / "rows.json"
    command = [
        "detect",
        "--environments",
        str(varied),
        "--policies",
        "no_fusion,late_fusion",
        "--detector",
        "simulated",
    ]
    assert main([*command, "--frames", "5", "--every-s", "0.1", "--json", str(rows)]) == 0
    measured = json.loads(rows.read_text())
    assert [row["policy"] for row in measured] == ["no_fusion", "late_fusion"]
    assert all(row["frames"] == 2 * (tiny.FRAMES - 1) for row in measured), "two sequences, without their first frames"


def test_evaluate_takes_a_folder_for_an_environment(opv2v: Path) -> None:
    by_path = coopsim.evaluate("late_fusion", str(opv2v), detector="simulated", seed=0)
    by_name = coopsim.evaluate("late_fusion", "replay", path=opv2v, detector="simulated", seed=0)
    assert by_path.score.all_tracks == by_name.score.all_tracks
