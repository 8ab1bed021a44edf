"""Names of the camera rigs, and where their cameras look; light to import, so that policies can name a rig."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from coopsim.support.checks import require_choice

SURROUND = "surround"
"""The rig that `cameras=True` stands for."""

RIG_HEADINGS_RAD: Mapping[str, Mapping[str, float]] = {
    "front": {"front": 0.0},
    SURROUND: {"front": 0.0, "left": np.pi / 2, "rear": np.pi, "right": -np.pi / 2},
    "surround_6": {
        "front": 0.0,
        "front_left": np.pi / 3,
        "rear_left": 2 * np.pi / 3,
        "rear": np.pi,
        "rear_right": -2 * np.pi / 3,
        "front_right": -np.pi / 3,
    },
}
"""Headings of a rig's cameras in the agent's base frame, by rig and camera."""

RIG_NAMES = tuple(RIG_HEADINGS_RAD)


def rig_camera_names(cameras: bool | str) -> frozenset[str]:
    """Return the names of a rig's cameras: True is "surround", False is no camera.

    Raises:
        UnknownNameError: no rig has that name.
    """
    if cameras is False:
        return frozenset()
    name = SURROUND if cameras is True else cameras
    require_choice("cameras", name, RIG_NAMES)
    return frozenset(RIG_HEADINGS_RAD[name])
