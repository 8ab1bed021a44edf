"""OPV2V's folders hold what the environment showed: points, poses, boxes, who sees what, pictures; no OpenCOOD."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from opv2v_reader import BODY_FROM_CAMERA, apply, boxes, load, matrix
from PIL import Image

import coopsim
from coopsim.data.export.opv2v_format import OBJECT_NUMBER
from coopsim.errors import InvalidValueError, UnknownNameError
from coopsim.types import ObjectClass

SEED, FRAMES = 3, 2
OPTIONS = {
    "vehicles": 12, "pedestrians": 4, "rsus": 2, "drones": 1, "position_noise_m": 0.5,
    "lidar": "VLP-16", "lidar_columns": 256, "cameras": "surround", "renderer": "raycast",
}  # fmt: skip
MIRROR = np.array([1.0, -1.0, 1.0])


@pytest.fixture(scope="module")
def exported(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("opv2v") / "out"
    coopsim.export("opv2v", "crossing", folder, seeds=(SEED,), frames=FRAMES, **OPTIONS)
    return folder / f"crossing_{SEED:04d}"


@pytest.fixture(scope="module")
def frames():
    env = coopsim.parallel_env("crossing", expose_ground_truth=True, uplink="none", detector="none", **OPTIONS)
    shown = [frame for frame, _ in zip(env.frames(SEED), range(FRAMES), strict=False)]
    assert len(shown) == FRAMES
    yield env, shown
    env.close()


def _numbered(frame):
    """The agents with the names of their folders."""
    assert len(frame.agents) > 1
    return {_folder(name, agent.body.actor_id): agent for name, agent in frame.agents.items()}


def _folder(name, actor_id):
    special = {"rsu_0": "-1", "rsu_1": "900004", "drone_0": "900005"}
    return special[name] if actor_id is None else str(OBJECT_NUMBER + actor_id)


def test_the_folder_is_well_formed(exported):
    assert list(coopsim.check_export(exported.parent)) == []


def test_readers_take_a_car_for_the_ego_and_a_unit_by_its_sign(exported, frames):
    names = sorted(path.name for path in exported.iterdir())
    assert names == sorted(_numbered(frames[1][0]))
    assert [name for name in names if int(name) < 0] == ["-1"]
    assert int(names[1]) - OBJECT_NUMBER in frames[1][0].actors.id  # the first after the unit is moved to the end


def test_points_are_in_the_sensor_frame_with_intensity_in_steps_of_a_colour(exported, frames):
    for index, frame in enumerate(frames[1]):
        for number, agent in _numbered(frame).items():
            parameters, points, intensity = load(exported, number, f"{2 * index:06d}")
            (sweep,) = agent.observation.sweeps.values()
            world = agent.body.world_SE3_base.apply(sweep.points) * MIRROR
            np.testing.assert_allclose(apply(matrix(parameters["lidar_pose"]), points), world, atol=1e-3)
            np.testing.assert_allclose(intensity, sweep.intensity, atol=0.5 / 255 + 1e-6)


def test_the_sensor_stands_over_the_true_pose_and_the_estimate_is_apart(exported, frames):
    for number, agent in _numbered(frames[1][1]).items():
        parameters, _, _ = load(exported, number, "000002")
        body = agent.body
        truth = [*(body.world_SE3_base.translation * MIRROR), 0, -np.degrees(body.world_SE3_base.yaw), 0]
        np.testing.assert_allclose(parameters["true_ego_pos"], truth, atol=1e-5)
        believed = agent.observation.pose.xyz_yaw[:3] * MIRROR
        np.testing.assert_allclose(parameters["predicted_ego_pos"][:3], believed, atol=1e-5)
        assert parameters["lidar_pose"][:2] == pytest.approx(truth[:2], abs=1e-5)
        assert parameters["lidar_pose"][2] == pytest.approx(body.world_SE3_base.translation[2] + body.height_m + 0.35)


def test_a_drone_looks_down(exported):
    parameters, _, _ = load(exported, "900005", "000000")
    assert parameters["lidar_pose"][5] == pytest.approx(-45.0)


def test_objects_are_those_that_the_agent_hits_with_half_their_sizes(exported, frames):
    for index, frame in enumerate(frames[1]):
        actors = frame.actors
        for number, agent in _numbered(frame).items():
            parameters, _, _ = load(exported, number, f"{2 * index:06d}")
            hit = set(np.unique(agent.instances["lidar"])) - {0, -1}
            listed = {**boxes(parameters["vehicles"]), **boxes(parameters["others"])}
            assert hit and {each - OBJECT_NUMBER for each in listed} == hit
            for each, box in listed.items():
                (row,) = np.flatnonzero(actors.id == each - OBJECT_NUMBER)
                np.testing.assert_allclose(box[:3], actors.boxes.center[row] * MIRROR, atol=1e-3)
                np.testing.assert_allclose(box[3:6], actors.boxes.size[row], atol=1e-3)
                assert np.cos(box[6] + actors.boxes.yaw[row]) == pytest.approx(1.0)


def test_people_and_riders_are_not_among_the_vehicles(exported, frames):
    actors = frames[1][0].actors
    label = dict(zip((actors.id + OBJECT_NUMBER).tolist(), actors.label.tolist(), strict=True))
    vehicles, others = set(), set()
    for folder in exported.iterdir():
        parameters, _, _ = load(exported, folder.name, "000000")
        vehicles |= {label[each] for each in parameters["vehicles"]}
        others |= {label[each] for each in parameters["others"]}
        for each, content in parameters["vehicles"].items():
            assert content["obj_type"] == ObjectClass(label[each]).title
    assert vehicles <= {ObjectClass.CAR, ObjectClass.VAN, ObjectClass.TRUCK, ObjectClass.BUS}
    assert ObjectClass.PEDESTRIAN in others


def test_speeds_are_in_km_an_hour(exported, frames):
    actors = frames[1][0].actors
    for number, agent in _numbered(frames[1][0]).items():
        parameters, _, _ = load(exported, number, "000000")
        own = np.linalg.norm(actors.velocity[actors.id == agent.body.actor_id], axis=1) * 3.6
        assert parameters["ego_speed"] == pytest.approx(own[0] if len(own) else 0.0, abs=1e-5)
        for each, content in parameters["vehicles"].items():
            (row,) = np.flatnonzero(actors.id == each - OBJECT_NUMBER)
            assert content["speed"] == pytest.approx(np.linalg.norm(actors.velocity[row]) * 3.6, abs=1e-5)


def test_pictures_stand_in_the_order_front_right_left_rear(exported, frames):
    env, (frame, _) = frames
    for number, agent in _numbered(frame).items():
        for camera, name in enumerate(("front", "right", "left", "rear")):
            with Image.open(exported / number / f"000000_camera{camera}.png") as picture:
                np.testing.assert_array_equal(np.asarray(picture), agent.observation.cameras[name].rgb)
    assert set(env.agent_specs["cav_0"].cameras) == {"front", "right", "left", "rear"}


def test_calibrations_take_points_to_the_pixels_that_the_environment_says(exported, frames):
    env, (frame, _) = frames
    for number, agent in _numbered(frame).items():
        parameters, points, _ = load(exported, number, "000000")
        (sweep,) = agent.observation.sweeps.values()
        for camera, name in enumerate(("front", "right", "left", "rear")):
            there, ours = parameters[f"camera{camera}"], env.agent_specs[agent.body.name].cameras[name]
            extrinsic, intrinsic = np.array(there["extrinsic"]), np.array(there["intrinsic"])
            from_poses = np.linalg.inv(matrix(parameters["lidar_pose"])) @ matrix(there["cords"])
            np.testing.assert_allclose(extrinsic, from_poses, atol=1e-4)
            seen = apply(np.linalg.inv(extrinsic), points) @ BODY_FROM_CAMERA
            wanted = ours.base_SE3_camera.inverse().apply(sweep.points)
            np.testing.assert_allclose(seen, wanted, atol=2e-3)
            ahead = wanted[:, 2] > 1.0
            pixels, right = (each[ahead] @ m.T for each, m in ((seen, intrinsic), (wanted, ours.matrix)))
            np.testing.assert_allclose(pixels[:, :2] / pixels[:, 2:], right[:, :2] / right[:, 2:], atol=1.0)


def test_another_lidar_can_be_chosen(tmp_path):
    lidars = {"roof": {"pattern": "VLP-16", "columns": 64}, "low": {"pattern": "VLP-16", "columns": 90, "above_m": 1.0}}
    coopsim.export("opv2v(lidar=low)", "crossing", tmp_path, frames=1, vehicles=4, lidar=lidars)
    (scenario,) = (path for path in tmp_path.iterdir() if path.is_dir())
    agent = sorted(path.name for path in scenario.iterdir())[0]
    parameters, _, _ = load(scenario, agent, "000000")
    assert parameters["lidar_pose"][2] - parameters["true_ego_pos"][2] > 2.0
    with pytest.raises(UnknownNameError, match="roof"):
        coopsim.export("opv2v(lidar=rof)", "crossing", tmp_path / "b", frames=1, vehicles=4, lidar=lidars)


@pytest.mark.parametrize("options", [{"lidar": None}, {"lidar_agents": ["cav_0"]}])
def test_agents_without_a_lidar_are_refused_before_anything_is_written(options, tmp_path):
    with pytest.raises(InvalidValueError, match="every agent needs a LiDAR"):
        coopsim.export("opv2v", "crossing", tmp_path / "out", frames=1, vehicles=4, **options)
    assert not (tmp_path / "out").exists()
