"""Captions: text in the corner of a picture, which stays as it was elsewhere."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import coopsim
from coopsim.envs.ego_step import EgoStep
from coopsim.types.driving import CarState, Route
from coopsim.viz.caption import with_caption

ROUTE = Route(np.array([[0.0, 0.0], [1.0, 0.0]]), 1.0, np.full(2, 10.0), np.zeros(2, int))
DRIVER: dict[str, Any] = {"reward": "safe_progress", "tracker": "no_fusion", "lidar": None, "render_mode": "rgb_array"}


def test_a_caption_is_in_the_upper_right_corner_alone() -> None:
    picture = np.full((60, 200, 3), 90, np.uint8)
    captioned = with_caption(picture, ["one line"])
    rows, columns = np.nonzero((captioned != picture).any(axis=2))
    assert 10 <= rows.min() <= rows.max() < 35 and columns.max() < 190 and columns.min() > 90
    assert (picture == 90).all() and len(np.unique(captioned)) > 3
    assert (with_caption(picture, ["two", "lines"]) != captioned).any()


def test_a_caption_is_cut_where_a_picture_is_small() -> None:
    picture = np.zeros((12, 20, 3), np.uint8)
    assert with_caption(picture, ["a long line of text", "another"]).shape == picture.shape


@pytest.mark.parametrize(
    ("step", "lines"),
    [
        (EgoStep("rsu_0", None), ["rsu_0"]),
        (EgoStep("cav_0", CarState(10.0, 0.0, 4.5, 1.8, False, ROUTE)), ["cav_0: 10.0 m/s (36 km/h)"]),
        (
            EgoStep("cav_0", CarState(0.0, 0.0, 4.5, 1.8, True, ROUTE), -2.0, -5.0),
            ["cav_0: 0.0 m/s (0 km/h), crashed", "action -2.0 m/s²", "reward -5.000"],
        ),
        (EgoStep("cav_1", None, 3, 0.1), ["cav_1", "action faster", "reward +0.100"]),
    ],
)
def test_the_lines_say_what_is_known(step: EgoStep, lines: list[str]) -> None:
    assert step.lines == lines


@pytest.mark.parametrize(("control", "action"), [("acceleration", np.float32([1.0])), ("policy", 3)])
def test_a_picture_of_one_agent_says_what_it_did_in_the_frame_that_is_shown(control: str, action: Any) -> None:
    env = coopsim.single_env("crossing", control=control, vehicles=2, connected_cars=1, pedestrians=0, **DRIVER)
    env.reset(seed=1)
    before, first = env.parallel.cars["cav_0"].speed_m_s, env.render()
    assert first is not None and (first != env.parallel.render()).any()
    _, reward, *_ = env.step(action)
    said = {"acceleration": "action +1.0 m/s²", "policy": "action faster"}[control]
    assert env._shown.lines[1:] == [said, f"reward {reward:+.3f}"] and f"{before:.1f} m/s" in env._shown.lines[0]
    assert (env.render() != first).any()
