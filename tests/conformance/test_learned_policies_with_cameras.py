"""Learned policies whose agents see with cameras, or with other sensors each; the networks are tiny and random."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

pytest.importorskip("torch")

from jobs_here import no_workers
from representatives import all_of
from tiny_networks import TINY, learned, save_pictures, tiny_picture_detector, weights_folder

import coopsim
from coopsim.bench.detect.detect import measure_detection
from coopsim.bench.detect.detect_plan import DetectPlan
from coopsim.errors import CoopsimError, InvalidValueError, PolicyMismatchError, UnknownNameError
from coopsim.learn.weights import make_network
from coopsim.sensors.camera.camera import Camera
from coopsim.sensors.camera.intrinsics import Intrinsics
from coopsim.testing import check_policy, check_uplink

WEIGHTS = {"weights": "fcooper", "detector_weights": "pillars", "picture_weights": "lift_splat"}
LENS = Intrinsics.from_fov(64, 40, np.radians(100.0))
CAMERAS = [Camera("ahead", LENS), Camera("behind", LENS, yaw_rad=np.pi)]
BENT = [Camera("ahead", Intrinsics(64, 40, 30.0, 30.0, 31.5, 19.5, distortion=(-0.2, 0.04, 0.001, -0.001, 0.0)))]
SMALL: dict[str, Any] = {
    "vehicles": 8,
    "lidar": "VLP-16",
    "lidar_columns": 256,
    "max_cycles": 3,
    "detector": "none",
    "renderer": "raycast",
}
MIXED: dict[str, Any] = SMALL | {"lidar_agents": ["cav"], "cameras": {"rsu": CAMERAS}}


def make(name: str = "attfuse", **settings: Any) -> Any:
    return coopsim.make_policy(name, **learned(name, **settings))


@pytest.mark.parametrize("name", all_of(["attfuse", "where2comm", "v2x_vit"], "attfuse"))
def test_policy_on_pictures(name: str) -> None:
    check_policy(lambda: make(name, sensors="pictures"), max_cycles=3, vehicles=6, cameras=CAMERAS, renderer="raycast")


@pytest.mark.parametrize("name", all_of(["fcooper", "where2comm"], "where2comm"))
def test_policy_on_what_each_agent_has(name: str) -> None:
    given = {**MIXED, "vehicles": 6, "rsus": 2, "cameras": {"rsu_0": CAMERAS}}  # rsu_1 has nothing
    check_policy(lambda: make(name, sensors="mixed"), **given)


@pytest.mark.parametrize("name", all_of(["attfuse", "dino_codt", "early"], "early"))
def test_policy_on_points_and_pictures(name: str) -> None:
    given: dict[str, Any] = {"max_cycles": 3, "vehicles": 6, "cameras": CAMERAS, "renderer": "raycast"}
    check_policy(lambda: make(name, sensors="both"), **given)


def test_pictures_add_to_what_points_show() -> None:
    def found(sensors: str) -> Any:
        policy = make("fcooper", sensors=sensors, least_score=0.05)
        coopsim.evaluate(policy, seed=1, **SMALL | {"cameras": CAMERAS})
        return policy.detections("cav_0")

    both, points = found("both"), found("points")
    assert len(both) and len(points) and not np.array_equal(both.score, points.score)


def test_their_uplinks() -> None:
    check_uplink(make(sensors="pictures"), cameras=CAMERAS, renderer="raycast", lidar=None)
    check_uplink(make(sensors="mixed"), cameras={"rsu": CAMERAS}, lidar_agents=["cav"], renderer="raycast")


@pytest.mark.parametrize(
    "cameras",
    [pytest.param("surround_6", marks=pytest.mark.long), "front", CAMERAS, BENT],
    ids=["surround_6", "front", "own", "bent"],
)
def test_any_rig_will_do(cameras: Any) -> None:
    policy = make(sensors="pictures")
    result = coopsim.evaluate(policy, seed=1, **SMALL | {"cameras": cameras, "max_cycles": 2})
    assert result.messages.delivered and not result.messages.rejected


def test_evaluate_turns_cameras_on_and_truth_stays_the_lidars() -> None:
    policy = make(sensors="pictures")
    env = coopsim.parallel_env("crossing", uplink=policy, cameras="surround", **SMALL)
    for agent, spec in env.agent_specs.items():
        assert set(spec.cameras) == {"front", "left", "rear", "right"} and spec.lidars, agent
    evaluated = coopsim.evaluate(policy, seed=1, **SMALL | {"max_cycles": 1})
    assert set(policy.specs["cav_0"].cameras) == {"front", "left", "rear", "right"}
    assert evaluated.messages.delivered and evaluated.score["GT"] > 0


def heard_and_alone(sensors: str, **options: Any) -> tuple[Any, Any]:
    """What the first car finds when it hears the others, and when it does not."""
    found = []
    for range_m in (300.0, 0.0):
        policy = make("fcooper", sensors=sensors, least_score=0.06)
        coopsim.evaluate(policy, seed=1, communication_range_m=range_m, **options)
        found.append(policy.detections("cav_0"))
    return found[0], found[1]


def test_agents_with_other_sensors_tell_each_other_what_they_see() -> None:
    together, alone = heard_and_alone("mixed", **MIXED)
    assert len(alone) and not np.array_equal(together.boxes.array, alone.boxes.array)
    blind = MIXED | {"lidar_agents": ["rsu"], "cameras": {"cav_1": CAMERAS}}
    together, alone = heard_and_alone("mixed", **blind)  # cav_0 has no sensor
    assert len(together) and not len(alone)


def test_results_are_the_same_for_any_number_of_threads() -> None:
    def tracks(threads: int) -> Any:
        policy = make("fcooper", sensors="mixed", threads=threads, least_score=0.05)
        coopsim.evaluate(policy, seed=1, **MIXED)
        return [policy.detections(agent) for agent in policy.specs]

    alone = tracks(1)
    assert any(len(one) for one in alone)
    for one, other in zip(alone, tracks(3), strict=True):
        np.testing.assert_array_equal(one.boxes.array, other.boxes.array)
        np.testing.assert_array_equal(one.score, other.score)


@pytest.mark.parametrize("policy", ["no_fusion", "late_fusion(merge=nms)"])
def test_policies_on_boxes_run_on_the_detector_of_pictures(policy: str) -> None:
    detector = tiny_picture_detector(least_score=0.05)
    result = coopsim.evaluate(policy, seed=1, **SMALL | {"detector": detector, "cameras": {"cav": "surround"}})
    assert result.score["TP"] + result.score["FP"] > 0


def test_detection_is_measured_by_the_same_truth() -> None:
    given = {name: value for name, value in SMALL.items() if name not in ("max_cycles", "detector")}
    folder = weights_folder()
    weights = ",".join(f"{name}={folder / file}.safetensors" for name, file in WEIGHTS.items())
    policies = (f"fcooper({weights},sensors=pictures)", f"fcooper({weights})", "no_fusion")
    options = given | {"cameras": "front"}
    plan = DetectPlan(policies, seeds=(0,), frames=2, detector=tiny_picture_detector(), options=options, within_m=40.0)
    with no_workers():
        rows = measure_detection(plan)
    assert [row["policy"] for row in rows] == list(policies)
    assert len({row["objects"] for row in rows}) == 1 and rows[0]["objects"] > 0
    assert all(row["bytes_per_message"] > 0 for row in rows[:2])


def test_who_needs_cameras_or_lidars_is_told_who_has_none() -> None:
    with pytest.raises(PolicyMismatchError, match=r"AttFusion needs cameras .* but rsu_0 has \[\]"):
        coopsim.evaluate(make(sensors="pictures"), seed=1, **SMALL | {"cameras": {"cav": CAMERAS}})
    with pytest.raises(PolicyMismatchError, match=r"needs a LiDAR, but rsu_0 has none: .*lidar_agents=None"):
        coopsim.evaluate(make(), seed=1, **MIXED)
    with pytest.raises(InvalidValueError, match="detector must need no images where cameras is False"):
        coopsim.parallel_env("crossing", **SMALL | {"detector": tiny_picture_detector()})


@pytest.mark.parametrize("given", [{"uplink": True}, {"detector": True}])
def test_pictures_without_colours_are_refused(given: dict[str, bool]) -> None:
    options = SMALL | {"cameras": CAMERAS, "camera_modes": ["depth"], "uplink": make(sensors="pictures")}
    if "detector" in given:
        options |= {"uplink": "detections", "detector": tiny_picture_detector()}
    env = coopsim.parallel_env("crossing", **options)
    with pytest.raises(InvalidValueError, match=r"camera 'ahead' of cav_0 has none: .* \"rgb\" among camera_modes"):
        env.reset(seed=1)


@pytest.mark.parametrize(
    ("settings", "error", "match"),
    [
        ({"sensors": "picture"}, UnknownNameError, "unknown sensors 'picture'. Did you mean 'pictures'"),
        ({"sensors": 3}, UnknownNameError, "Accepted: both, mixed, pictures, points"),
        ({"sensors": "mixed", "picture_weights": "nobodys"}, UnknownNameError, "unknown weights 'nobodys'"),
        (
            {"sensors": "both", "picture_weights": str(weights_folder() / "lift_splat.safetensors")},
            InvalidValueError,
            "must be weights of the kind 'points_and_pictures', is 'pictures'",
        ),
        (
            {"sensors": "pictures", "picture_weights": str(weights_folder() / "pillars.safetensors")},
            InvalidValueError,
            "must be weights of the kind 'pictures', is 'detector'",
        ),
    ],
)
def test_wrong_settings_are_refused(settings: dict[str, Any], error: type[CoopsimError], match: str) -> None:
    with pytest.raises(error, match=match):
        make(**settings)


def test_pictures_of_another_encoder_are_refused(tmp_path: Any) -> None:
    save_pictures(tmp_path / "other.safetensors", make_network("detector", TINY, seed=5))
    given = {"picture_weights": str(tmp_path / "other.safetensors")}
    with pytest.raises(InvalidValueError, match="was trained on another encoder"):
        make(sensors="pictures", **given)
    make(**given)  # nobody reads them


@pytest.mark.parametrize(
    ("given", "match"),
    [
        ("least_score=2", r"least_score must be in \[0, 1\]"),
        ("reach_m=3", r"reach_m must be"),
        ("threads=0", "threads"),
    ],
)
def test_wrong_settings_of_the_detector_are_refused(given: str, match: str) -> None:
    with pytest.raises(InvalidValueError, match=match):
        coopsim.parallel_env("crossing", detector=f"lift_splat({given})", cameras="front")
