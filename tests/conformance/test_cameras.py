"""Cameras in an environment: drawn for who asks, observed without truth, described by their calibration."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from pettingzoo.test import parallel_api_test
from test_environments import Make, assert_same, play

import coopsim
from coopsim.errors import CoopsimError, InvalidValueError, PolicyMismatchError, UnknownNameError
from coopsim.geometry.boxes import Boxes3D
from coopsim.sensors.camera.camera import Camera
from coopsim.sensors.camera.intrinsics import Intrinsics
from coopsim.sensors.camera.picture import CameraRig
from coopsim.sensors.weather import Weather
from coopsim.types import Observation, Tracks

TINY = Camera("front", Intrinsics.from_fov(32, 18))
ALL = {"camera_modes": ("rgb", "depth", "instance", "semantic"), "expose_ground_truth": True}
RAYS = {"renderer": "raycast"}


class Blind(coopsim.Policy):
    """Reports nothing, looks at nothing."""

    needs = coopsim.Needs(uplink="none")

    def track(self, agent: str, observation: Observation) -> Tracks:
        return Tracks.empty()


class Looking(Blind):
    """Needs one camera, and says so."""

    needs = coopsim.Needs(uplink="none", cameras="front")

    def track(self, agent: str, observation: Observation) -> Tracks:
        image, calibration = observation.cameras["front"], self.specs[agent].cameras["front"]
        assert image.rgb is not None and image.rgb.shape[:2] == calibration.size
        assert image.instance is None and image.semantic is None
        return Tracks.empty()


@pytest.mark.filterwarnings("ignore:reset option 'options' is ignored")
def test_the_parallel_api_holds_with_cameras(make_small: Make) -> None:
    parallel_api_test(make_small("crossing", cameras={"cav_0": [TINY]}, **RAYS), num_cycles=5)


def test_the_same_seed_gives_the_same_pictures(make_small: Make) -> None:
    first, second = (
        play(make_small("crossing", cameras=[TINY], max_cycles=3, **ALL, **RAYS), seed=4) for _ in range(2)
    )
    for one, other in zip(first, second, strict=True):
        assert_same(one[0], other[0])
        assert_same(one[-1], other[-1])


def test_cameras_change_nothing_but_the_pictures(make_small: Make) -> None:
    """Not the spaces of who has none, nor anything else that is observed."""
    plain, seeing = (make_small("crossing", cameras=rig, max_cycles=2, **RAYS) for rig in (False, {"cav_0": [TINY]}))
    for agent in plain.possible_agents:
        if agent != "cav_0":
            assert plain.observation_space(agent) == seeing.observation_space(agent)
    before, after = (play(env, seed=1) for env in (plain, seeing))
    for first, second in zip(before, after, strict=True):
        for agent, observation in second[0].items():
            assert seeing.observation_space(agent).contains(observation)
            assert bool(observation["cameras"]) == (agent == "cav_0")
            assert_same(first[0][agent] | {"cameras": {}}, observation | {"cameras": {}})


def test_truth_is_in_infos_and_never_observed(make_small: Make) -> None:
    env = make_small("crossing", cameras=[TINY], **ALL, **RAYS)
    observations, infos = env.reset(seed=2)
    assert len(env.agents) > 1
    for agent in env.agents:
        assert observations[agent]["cameras"]["front"].keys() == {"rgb", "depth"}
        labelled = infos[agent]["segmentation"]["front"]
        assert labelled.keys() == {"instance", "semantic"}
        assert ((labelled["instance"] == 0) == (labelled["semantic"] == 255)).all()


def test_a_calibration_leads_from_a_box_to_its_pixels(make_small: Make) -> None:
    """Truth boxes, projected by what a policy knows of its camera, hold all pixels of their instance, and no others'.

    A model fills its box, so its pixels reach close to the projected corners, where nothing hides it.
    """
    lens = Intrinsics.from_fov(320, 180, 1.4, (-0.1, 0.02, 0.001, 0.0, 0.0))
    rig = [Camera("rear", lens, x_m=-0.5, y_m=0.3, yaw_rad=2.8, pitch_rad=0.1, roll_rad=0.05), Camera("front", lens)]
    env = make_small("crossing", cameras=rig, ground_truth="all", region_x_m=300.0, region_y_m=300.0, **ALL, **RAYS)
    _, infos = env.reset(seed=3)
    met = 0
    for agent, spec in env.agent_specs.items():
        truth = infos[agent]["ground_truth"]
        boxes = Boxes3D.from_array(truth["box"])
        for name, calibration in spec.cameras.items():
            instance = infos[agent]["segmentation"][name]["instance"]
            inside = calibration.base_SE3_camera.inverse().apply(boxes.corners)
            for k in np.flatnonzero((inside[..., 2] > 0.5).all(axis=1)):
                rows, columns = np.nonzero(instance == truth["id"][k])
                if len(rows):
                    seen = lens.project(inside[k])
                    assert (columns >= seen[:, 0].min() - 1).all() and (columns <= seen[:, 0].max() + 1).all()
                    assert (rows >= seen[:, 1].min() - 1).all() and (rows <= seen[:, 1].max() + 1).all()
                    met += 1
        assert set(np.unique(instance)) - {0} <= set(truth["id"].tolist())  # never its own
    assert met >= 8


def test_calibrations_are_of_the_running_episode(make_small: Make) -> None:
    """Cars of other episodes are of other heights, and the cameras are on their roofs."""
    env = make_small("crossing", cameras="front", **RAYS)
    heights = set()
    for seed in range(6):
        env.reset(seed=seed)
        height_m = float(env.agent_specs["cav_0"].cameras["front"].base_SE3_camera.translation[2])
        assert height_m == pytest.approx(env.episode.frame.agents["cav_0"].body.height_m + 0.15)
        heights.add(height_m)
    assert len(heights) > 1


def test_nothing_is_drawn_for_who_does_not_look(monkeypatch: pytest.MonkeyPatch) -> None:
    def draw(*arguments: Any) -> Any:
        raise AssertionError("drawn")

    monkeypatch.setattr(CameraRig, "render", draw)
    coopsim.evaluate(Blind(), vehicles=4, max_cycles=2)
    with pytest.raises(AssertionError, match="drawn"):
        coopsim.evaluate(Looking(), vehicles=4, max_cycles=2)


def test_a_policy_gets_the_cameras_that_it_states() -> None:
    assert coopsim.evaluate(Looking(), vehicles=4, max_cycles=2, **RAYS).frames == 2
    assert coopsim.evaluate(Looking(), vehicles=4, max_cycles=1, cameras="surround", **RAYS).frames == 1


def test_a_policy_refuses_cameras_that_it_cannot_use(recordings: Any) -> None:
    with pytest.raises(PolicyMismatchError, match=r"Looking needs cameras \['front'\], but cav_0 has \['tele'\]"):
        coopsim.evaluate(Looking(), cameras=[Camera("tele")], **RAYS)
    with pytest.raises(PolicyMismatchError, match="make the environment with cameras='front'"):
        Looking().reset(coopsim.parallel_env("crossing").agent_specs)
    with pytest.raises(PolicyMismatchError, match="Looking needs cameras 'front', and 'replay' has none"):
        coopsim.evaluate_recordings(Looking(), recordings, ["ego"])


@pytest.mark.parametrize("hour", ["day", "dusk", "night"])
def test_hour_and_weather_reach_the_pictures(make_small: Make, hour: str) -> None:
    pictures = []
    for weather in (None, Weather(fog_visibility_m=30.0)):
        env = make_small("crossing", cameras=[TINY], time_of_day=hour, weather=weather, **RAYS)
        pictures.append(env.reset(seed=1)[0]["cav_0"]["cameras"]["front"])
    clear, foggy = pictures
    np.testing.assert_array_equal(clear["depth"], foggy["depth"])
    assert clear["rgb"].std() > 1.5 * foggy["rgb"].std()


@pytest.mark.parametrize(
    ("option", "error", "match"),
    [
        ({"cameras": "surond"}, UnknownNameError, "unknown cameras 'surond'. Did you mean 'surround'"),
        ({"cameras": {"cav_9": "front"}}, UnknownNameError, "unknown cameras of agent 'cav_9'"),
        ({"cameras": [TINY, TINY]}, InvalidValueError, "cameras must have names of their own"),
        (
            {"cameras": {"rsu_0": [Camera("low", above_m=-5.5)]}},
            InvalidValueError,
            "camera 'low' of rsu_0 is 0.5 m under the ground: above_m = -5.5 counts from the top of a body that is 5 m",
        ),
        ({"cameras": [Camera("low", above_m=-1.5)]}, InvalidValueError, "camera 'low' of cav_0 is .* under the ground"),
        ({"camera_modes": ("rgb", "deph")}, UnknownNameError, "unknown camera_modes 'deph'. Did you mean 'depth'"),
        ({"camera_modes": "rgb"}, InvalidValueError, "camera_modes must be different names"),
        ({"camera_modes": ("semantic",)}, InvalidValueError, "'semantic' are ground truth.*expose_ground_truth=True"),
        ({"camera_mode": ("rgb",)}, UnknownNameError, "unknown option 'camera_mode'. Did you mean 'camera_modes'"),
        ({"time_of_day": "dsk"}, UnknownNameError, "unknown time_of_day 'dsk'. Did you mean 'dusk'"),
        ({"time_of_day": 12.0}, UnknownNameError, "unknown time_of_day 12.0"),
        ({"weather": "fogg"}, UnknownNameError, "unknown weather 'fogg'. Did you mean 'fog'"),
        ({"renderer": "opngl"}, UnknownNameError, "unknown renderer 'opngl'. Did you mean 'opengl'"),
    ],
)
def test_bad_camera_options(option: dict[str, Any], error: type[CoopsimError], match: str) -> None:
    with pytest.raises(error, match=match):
        coopsim.parallel_env("crossing", **option)
