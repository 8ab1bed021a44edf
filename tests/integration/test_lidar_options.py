"""LiDARs as the environment's user asks for them: none, one, several, anywhere."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import coopsim
from coopsim.detection.detector import Detector
from coopsim.detection.simulated.simulated import SimulatedDetector
from coopsim.errors import InvalidValueError, UnknownNameError
from coopsim.sensors.lidar.lidar import LidarConfig
from coopsim.sensors.lidar.patterns import PATTERNS
from coopsim.sensors.weather import Weather
from coopsim.types import CameraImage, Detections, Observation, Odometry, PoseEstimate, Sweep

Make = Callable[..., Any]

ROOF = LidarConfig("VLP-16", columns=256)
BUMPER = LidarConfig("VLP-16", columns=128, x_m=2.9, above_m=-0.9)


def make(**options: Any) -> Any:
    return coopsim.parallel_env("crossing", **({"vehicles": 10, "max_cycles": 3} | options))


@pytest.fixture
def run() -> Make:
    """Observations and infos of two steps of an environment, checked against its spaces."""

    def run(**options: Any) -> tuple[Any, Any]:
        env = make(expose_ground_truth=True, **options)
        policy = coopsim.make_policy("late_fusion")
        observations, infos = env.reset(seed=5)
        policy.reset(env.agent_specs)
        for _ in range(2):
            observations, _, _, _, infos = env.step(policy.act(observations))
            for agent in env.agents:
                assert env.observation_space(agent).contains(observations[agent])
        return observations, infos

    return run


def test_every_lidar_has_its_sweep(run: Make) -> None:
    observations, infos = run(lidar={"roof": ROOF, "bumper": BUMPER})
    assert len(observations) > 1
    for agent, observation in observations.items():
        assert list(observation["sweeps"]) == list(infos[agent]["instances"]) == ["roof", "bumper"]
        assert all(len(points) > 100 for points in observation["sweeps"].values())
    alone, _ = run(lidar={"roof": ROOF})
    for agent in observations:  # another sensor does not shift this one's noise
        np.testing.assert_array_equal(alone[agent]["sweeps"]["roof"], observations[agent]["sweeps"]["roof"])


def test_beam_tables_may_stand_beside_each_other_by_name(run: Make) -> None:
    tables, _ = run(lidar={"roof": "VLP-16", "front": PATTERNS.get("HDL-32E")}, lidar_columns=256)
    configs, _ = run(lidar={"roof": ROOF, "front": LidarConfig(columns=256)})
    for agent, observation in tables.items():
        for name in ("roof", "front"):
            np.testing.assert_array_equal(observation["sweeps"][name], configs[agent]["sweeps"][name])
    with pytest.raises(UnknownNameError, match=r"unknown lidar 'roof' 'VLP-61'\. Did you mean 'VLP-16'"):
        make(lidar={"roof": "VLP-61"})


def test_lidars_and_weather_may_be_written_down_as_mappings(run: Make) -> None:
    plain: dict[str, Any] = {"pattern": "VLP-16", "columns": 128, "x_m": 2.9, "above_m": -0.9}
    objects, _ = run(lidar={"bumper": BUMPER}, weather=Weather(rain_mm_h=5.0))
    mappings, _ = run(lidar={"bumper": plain}, weather={"rain_mm_h": 5.0})
    for agent, observation in mappings.items():
        np.testing.assert_array_equal(observation["sweeps"]["bumper"], objects[agent]["sweeps"]["bumper"])
    assert list(run(lidar=plain)[0]["cav_0"]["sweeps"]) == ["lidar"]
    with pytest.raises(UnknownNameError, match=r"unknown lidar option 'colums'\. Did you mean 'columns'"):
        make(lidar={"pattern": "VLP-16", "colums": 128})


def test_one_config_is_the_only_lidar(run: Make, tmp_path: Path) -> None:
    table = tmp_path / "mine.csv"
    table.write_text("elevation_deg\n" + "\n".join(f"{2 * k - 15}" for k in range(15, -1, -1)))
    wanted, _ = run(lidar="VLP-16", lidar_columns=256)
    for lidar in (ROOF, {"lidar": ROOF}):
        same, _ = run(lidar=lidar)
        np.testing.assert_array_equal(same["cav_0"]["sweeps"]["lidar"], wanted["cav_0"]["sweeps"]["lidar"])
    for other in (PATTERNS.get("VLP-16"), str(table)):
        same, _ = run(lidar=other, lidar_columns=256)
        np.testing.assert_array_equal(same["cav_0"]["sweeps"]["lidar"], wanted["cav_0"]["sweeps"]["lidar"])


def test_without_a_lidar_there_are_detections_and_truth_but_no_points(run: Make) -> None:
    observations, infos = run(lidar=None, vehicles=25)
    for agent, observation in observations.items():
        assert observation["sweeps"] == {} and infos[agent]["instances"] == {}
    assert sum(len(each["detections"]["score"]) for each in observations.values()) > 4
    visible, everything = (
        {agent: info["ground_truth"]["counts"].sum() for agent, info in infos.items()}
        for infos in (infos, run(lidar=None, vehicles=25, ground_truth="all")[1])
    )
    assert all(0 < visible[agent] <= everything[agent] for agent in visible)
    assert visible != everything  # some are out of everybody's sight


def test_without_a_lidar_the_same_seed_gives_the_same_bits(run: Make) -> None:
    first, again = run(lidar=None), run(lidar=None)
    assert any(len(seen["detections"]["box"]) for seen in first[0].values())
    for agent in first[0]:
        np.testing.assert_array_equal(first[0][agent]["detections"]["box"], again[0][agent]["detections"]["box"])


def test_weather_is_everybodys() -> None:
    fog = Weather(fog_visibility_m=30.0)
    clear, foggy = (make(lidar={"roof": ROOF}, weather=weather).reset(seed=5)[0] for weather in (None, fog))
    assert len(clear) > 1
    for agent in clear:
        reach_m = [np.linalg.norm(seen[agent]["sweeps"]["roof"][:, :3], axis=1).max() for seen in (clear, foggy)]
        assert reach_m[1] < 35.0 < reach_m[0]


@pytest.mark.parametrize("name", ["crossing", "highway"])
def test_a_turn_takes_time_for_agents_that_drive(name: str) -> None:
    """Points of what stands still are where they are without the turn's time; of the others' sides, some are not."""
    sweeps = []
    for turn_s in (0.0, 0.1):
        lidar = replace(ROOF, turn_s=turn_s, range_noise_m=0.0, dropout_energy=0.0)
        env = coopsim.parallel_env(name, lidar=lidar, vehicles=10, expose_ground_truth=True, rsus=0)
        policy = coopsim.make_policy("no_fusion")
        observations, infos = env.reset(seed=5)
        policy.reset(env.agent_specs)
        for _ in range(3):
            observations, _, _, _, infos = env.step(policy.act(observations))
        points, instance = observations["cav_0"]["sweeps"]["lidar"], infos["cav_0"]["instances"]["lidar"]
        sweeps.append(points[instance == 0, :3])
    flat = [points[np.abs(points[:, 2]) < 0.05] for points in sweeps]
    assert len(flat[0]) > 500 and len(flat[1]) == pytest.approx(len(flat[0]), rel=0.05)
    assert not np.array_equal(flat[0][:100], flat[1][:100])


def test_mountings_in_the_specs_say_where_rays_start_and_point() -> None:
    exact = {"range_noise_m": 0.0, "dropout_energy": 0.0}
    lidars = {"roof": LidarConfig(columns=64, **exact), "bumper": LidarConfig("VLP-16", columns=32, x_m=2.9, **exact)}
    env = coopsim.parallel_env("crossing", vehicles=10, lidar=lidars, drones=1)
    observations, _ = env.reset(seed=3)
    for agent, spec in env.agent_specs.items():
        assert set(spec.lidars) == set(lidars)
        for name, mounting in spec.lidars.items():
            assert (mounting.columns, mounting.max_range_m) == (lidars[name].columns, lidars[name].max_range_m)
            points = observations[agent]["sweeps"][name]
            ray = mounting.base_SE3_lidar.inverse().apply(points[:, :3])
            length = np.linalg.norm(ray, axis=1)
            expected = mounting.elevation_rad[points[:, 4].astype(int)]
            np.testing.assert_allclose(np.arcsin(ray[:, 2] / length), expected, atol=2e-4)
            assert len(points) > 50 and length.max() <= mounting.max_range_m + 0.01
    heights = {spec.kind: spec.lidars["roof"].base_SE3_lidar.translation[2] for spec in env.agent_specs.values()}
    assert heights["cav"] < heights["rsu"] < heights["drone"]


def test_a_view_has_what_sensors_give_and_no_truth() -> None:
    env = coopsim.parallel_env("crossing", vehicles=10, lidar=ROOF)
    env.reset(seed=3)
    spec = env.agent_specs["cav_0"]
    sweep = Sweep(np.ones((2, 3)), np.ones(2), np.zeros(2), instance=np.array([4, 5]))
    image = CameraImage(depth=np.ones((2, 2)), instance=np.ones((2, 2), int), semantic=np.ones((2, 2), np.uint8))
    observation = Observation(
        5, PoseEstimate(np.zeros(4)), Odometry(np.ones(4)), Detections.empty(), {"lidar": sweep}, {"front": image}
    )
    view = observation.view(spec)
    assert (view.agent, view.time_ns, view.odometry) == ("cav_0", 5, observation.odometry)
    assert view.sweeps["lidar"].instance is None and view.images["front"].instance is None
    assert view.images["front"].semantic is None
    np.testing.assert_array_equal(view.sweeps["lidar"].points, sweep.points)
    assert view.lidars is spec.lidars and view.cameras is spec.cameras


class NeedsPoints(Detector):
    def detect(self, view, rng):  # type: ignore[no-untyped-def]
        return Detections.empty()


def test_a_detector_that_needs_sweeps_needs_a_lidar() -> None:
    with pytest.raises(InvalidValueError, match="detector must need no sweeps where lidar is None"):
        make(lidar=None, detector=NeedsPoints())
    make(lidar=None, detector=SimulatedDetector())
    make(detector=NeedsPoints())


@pytest.mark.parametrize(
    ("options", "match"),
    [
        ({"lidar": 3}, "^lidar must be a beam table, its name or path, a LidarConfig, a mapping .*, or None; got 3"),
        ({"lidar": {"pattern": "VLP-16", "columns": 0}}, r"^lidar: columns must be an integer in 1\.\.16384, got 0"),
        ({"lidar": {"roof": {"columns": 0}}}, "^lidar 'roof': columns must be"),
        ({"lidar": {}}, "lidar must name at least one LiDAR"),
        ({"lidar": {"roof": 16}}, "^lidar 'roof' must be a beam table, its name or path, a LidarConfig or .*; got 16"),
        ({"lidar": {"roof": None}}, "^lidar 'roof' must be .*; got None"),
        ({"lidar": {3: ROOF}}, "lidar must have a name for each, got 3"),
        ({"lidar": {"roof": ROOF, "front": "VLP-16"}, "lidar_columns": 64}, "lidar_columns must be left out"),
        ({"lidar_range_m": 1e5}, "^lidar_range_m must be > 1 and <= 10000, got 100000.0"),
        ({"lidar": ROOF, "lidar_columns": 64}, "lidar_columns must be left out where lidar is a LidarConfig"),
        ({"lidar": {"a": ROOF}, "lidar_range_m": 50.0}, "lidar_range_m must be left out"),
        ({"weather": 3}, "weather must be a Weather, a mapping of its fields, None or one of clear, rain, fog, got 3"),
        ({"weather": {"rain_mm_h": -1}}, "^weather: rain_mm_h must be"),
        ({"lidar": "nowhere.csv"}, "cannot read the beam table nowhere.csv"),
        ({"lidar": LidarConfig(above_m=-0.5)}, "lidar 'lidar' at x, y, z = .* is inside the body of"),
        ({"lidar": {"a": LidarConfig(above_m=-3.0)}}, "lidar 'a' is .* m under the ground"),
    ],
)
def test_bad_lidars_are_refused(options: dict[str, Any], match: str) -> None:
    with pytest.raises(InvalidValueError, match=match):
        make(**options)
