"""Which cameras an agent carries, and what is no rig."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from coopsim.errors import CoopsimError, InvalidValueError, UnknownNameError
from coopsim.sensors.camera.camera import (
    DRONE_PITCH_RAD,
    RIG_NAMES,
    UNIT_PITCH_RAD,
    Camera,
    agent_rigs,
    check_rig,
    named_rig,
    rig,
)

KINDS = {"cav_0": "cav", "cav_1": "cav", "rsu_0": "rsu"}


@pytest.mark.parametrize("name", RIG_NAMES)
def test_a_named_rig_looks_evenly_around(name: str) -> None:
    headings = np.sort(np.mod([camera.yaw_rad for camera in named_rig(name)], 2 * np.pi))
    np.testing.assert_allclose(headings, np.arange(len(headings)) * 2 * np.pi / len(headings), atol=1e-12)


@pytest.mark.parametrize("name", ["surround", "surround_6"])
def test_surround_sees_in_every_direction(name: str) -> None:
    half = np.radians(50.0)
    headings = np.array([camera.yaw_rad for camera in named_rig(name)])
    around = np.linspace(-np.pi, np.pi, 721)
    off = np.abs(np.mod(around[:, None] - headings + np.pi, 2 * np.pi) - np.pi)
    assert (off.min(axis=1) <= half).all()


def test_rigs_by_agent() -> None:
    own = [Camera("tele"), Camera("wide")]
    rigs = agent_rigs({"cav_0": own, "rsu_0": "front"}, KINDS)
    assert rigs == {"cav_0": tuple(own), "cav_1": (), "rsu_0": named_rig("front", pitch_rad=UNIT_PITCH_RAD)}
    everywhere = agent_rigs(True, KINDS)
    assert everywhere["cav_0"] == everywhere["cav_1"] == named_rig("surround") == rig("surround")
    assert {camera.pitch_rad for camera in everywhere["rsu_0"]} == {UNIT_PITCH_RAD}
    assert not any(agent_rigs(False, KINDS).values())


@pytest.mark.parametrize(
    ("bad", "error", "match"),
    [
        ("surrond", UnknownNameError, "unknown cameras 'surrond'. Did you mean 'surround'"),
        ({"cav_0": "frnt"}, UnknownNameError, "Did you mean 'front'"),
        (1, InvalidValueError, "^cameras must be True, False, one of front, surround"),
        (None, InvalidValueError, "^cameras must be"),
        (Camera("front"), InvalidValueError, "a list of Camera objects"),
        (["front"], InvalidValueError, "a list of Camera objects"),
        ([Camera("a"), Camera("a")], InvalidValueError, "cameras must have names of their own"),
        (np.array([1.0]), InvalidValueError, "^cameras must be"),
    ],
)
def test_what_is_no_rig_is_refused(bad: Any, error: type[CoopsimError], match: str) -> None:
    with pytest.raises(error, match=match):
        check_rig(bad)
    with pytest.raises(error, match=match):
        agent_rigs(bad, KINDS)


def test_an_unknown_agent_is_named() -> None:
    with pytest.raises(UnknownNameError, match="unknown cameras of agent 'cav_7'"):
        agent_rigs({"cav_7": True}, KINDS)


def test_a_drones_cameras_look_down_all_around() -> None:
    assert {camera.pitch_rad for camera in agent_rigs(True, {"drone_0": "drone"})["drone_0"]} == {DRONE_PITCH_RAD}
