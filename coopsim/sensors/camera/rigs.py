"""Rigs: the cameras that an agent carries, by name or as the user lists them."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

import numpy as np

from coopsim.errors import InvalidValueError, UnknownNameError
from coopsim.sensors.camera.camera import Camera
from coopsim.sensors.camera.rig_names import RIG_HEADINGS_RAD, RIG_NAMES, SURROUND
from coopsim.types.messages import AGENT_KINDS

Rig = tuple[Camera, ...]
RigOption = bool | str | Sequence[Camera] | Mapping[str, bool | str | Sequence[Camera]]
"""The option `cameras`: False, True (as "surround"), the name of a rig, cameras; or one of these by agent or kind
of agent."""

UNIT_PITCH_RAD = np.radians(20.0)
"""Downward pitch of the named rigs on a roadside unit; chosen by us, as the rigs are."""

DRONE_PITCH_RAD = np.radians(45.0)
"""The same for a drone."""

_PITCH_RAD = {"cav": 0.0, "rsu": UNIT_PITCH_RAD, "drone": DRONE_PITCH_RAD}


def named_rig(name: str, *, pitch_rad: float = 0.0) -> Rig:
    """Return the cameras of the rig called `name`: each of 320 x 180 pixels and 100 degrees, on the middle of the roof.

    Raises:
        UnknownNameError: there is no such rig.
    """
    if not (isinstance(name, str) and name in RIG_HEADINGS_RAD):
        raise UnknownNameError("cameras", name, RIG_NAMES)
    return tuple(
        Camera(camera, yaw_rad=float(heading), pitch_rad=float(pitch_rad))
        for camera, heading in RIG_HEADINGS_RAD[name].items()
    )


def agent_rigs(option: object, kinds: Mapping[str, str]) -> dict[str, Rig]:
    """Return the cameras of every agent.

    Args:
        option: a `RigOption`. In a mapping an agent's name goes before its kind.
        kinds: "cav", "rsu" or "drone", by agent.

    Raises:
        UnknownNameError: no rig, agent or kind is called that.
        InvalidValueError: not a list of cameras, or two of one name.
    """
    if not isinstance(option, Mapping):
        check_rig(option)
        return {agent: rig(option, kind) for agent, kind in kinds.items()}
    for agent in option:
        if agent not in kinds and agent not in AGENT_KINDS:
            raise UnknownNameError("cameras of agent", agent, (*kinds, *AGENT_KINDS))
    return {agent: rig(option.get(agent, option.get(kind, False)), kind) for agent, kind in kinds.items()}


def check_rig(option: object) -> None:
    """Validate the option `cameras`, except for the names of agents, which the environment checks later.

    Raises:
        UnknownNameError: no rig is called that.
        InvalidValueError: not a list of cameras, or two of one name.
    """
    for one in option.values() if isinstance(option, Mapping) else [option]:
        rig(one)


def rig(option: object, kind: str = "cav") -> Rig:
    """Return the cameras of an option on an agent of a kind ("cav", "rsu" or "drone").

    Raises:
        UnknownNameError: no rig is called that.
        InvalidValueError: not a list of cameras, or two of one name.
    """
    if option is False or option is True:
        option = SURROUND if option else ()
    if isinstance(option, str):
        return named_rig(option, pitch_rad=_PITCH_RAD[kind])
    accepted = f"True, False, one of {', '.join(RIG_NAMES)}, a list of Camera objects, or one of these by agent or kind"
    listed = tuple(option) if isinstance(option, Iterable) and not isinstance(option, np.ndarray) else (None,)
    if not all(isinstance(camera, Camera) for camera in listed):
        raise InvalidValueError(f"cameras must be {accepted}; got {option!r}")
    cameras = tuple(camera for camera in listed if isinstance(camera, Camera))
    names = [camera.name for camera in cameras]
    if len(set(names)) < len(names):
        raise InvalidValueError(f"cameras must have names of their own, got {names}")
    return cameras
