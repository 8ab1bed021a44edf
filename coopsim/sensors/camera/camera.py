"""Cameras, their mounting, and the rigs that agents carry: by name, or as the user lists them."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from coopsim.errors import InvalidValueError, UnknownNameError
from coopsim.geometry.se3 import SE3
from coopsim.sensors import FARTHEST_M, FARTHEST_MOUNT_M, NEAREST_M
from coopsim.sensors.camera.intrinsics import Intrinsics
from coopsim.support.checks import require_between, require_choice, require_finite_number
from coopsim.types import CameraCalibration
from coopsim.types.messages import AGENT_KINDS


@dataclass(frozen=True, slots=True)
class Camera:
    """A camera and its mounting on an agent.

    Attributes:
        name: unique in its rig.
        intrinsics: its lens and chip.
        x_m: distance ahead of the agent's middle. This and the next two are in [-100, 100].
        y_m: distance to the left of it.
        above_m: height over the agent's body; negative below its top.
        yaw_rad: to the left.
        pitch_rad: downwards.
        roll_rad: clockwise, seen from behind.
        near_m: depth along the optical axis below which nothing is drawn; at least 0.001.
        far_m: depth beyond which nothing is drawn; at most 10 km.

    Raises:
        InvalidValueError: a number out of its range, or a name that is no word.
    """

    name: str
    intrinsics: Intrinsics = field(default_factory=Intrinsics.from_fov)
    x_m: float = 0.0
    y_m: float = 0.0
    above_m: float = 0.15
    yaw_rad: float = 0.0
    pitch_rad: float = 0.0
    roll_rad: float = 0.0
    near_m: float = 0.2
    far_m: float = 300.0

    def __post_init__(self) -> None:
        if not (isinstance(self.name, str) and self.name.isidentifier()):
            raise InvalidValueError(f"name of a camera must be a word, as 'front_left', got {self.name!r}")
        if not isinstance(self.intrinsics, Intrinsics):
            raise InvalidValueError(
                f"intrinsics of camera {self.name!r} must be Intrinsics, as Intrinsics.from_fov(320, 180), "
                f"got {self.intrinsics!r}"
            )
        of = f"of camera {self.name!r}"
        for offset in ("x_m", "y_m", "above_m"):
            require_between(-FARTHEST_MOUNT_M, FARTHEST_MOUNT_M, **{f"{offset} {of}": getattr(self, offset)})
        for angle in ("yaw_rad", "pitch_rad", "roll_rad"):
            require_finite_number(**{f"{angle} {of}": getattr(self, angle)})
        require_between(NEAREST_M, FARTHEST_M, **{f"near_m {of}": self.near_m, f"far_m {of}": self.far_m})
        if self.near_m >= self.far_m:
            raise InvalidValueError(f"near_m must be less than far_m {of}, got {self.near_m!r} and {self.far_m!r}")

    def base_SE3_camera(self, body_height_m: float) -> SE3:
        """Return the pose on an agent of this height; camera axes are OpenCV's (x right, y down, z forward)."""
        cos, sin = np.cos(self.pitch_rad), np.sin(self.pitch_rad)
        mount = SE3.from_xyz_yaw([self.x_m, self.y_m, body_height_m + self.above_m], self.yaw_rad)
        # Columns: the camera's x, y, z in the axes of a body that looks ahead with x forward, y left, z up.
        pitched = np.array([[0.0, -sin, cos], [-1.0, 0.0, 0.0], [0.0, -cos, -sin]])
        cos, sin = np.cos(self.roll_rad), np.sin(self.roll_rad)
        rolled = np.array([[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]])
        return mount.compose(SE3(pitched @ rolled, np.zeros(3)))

    def calibration(self, body_height_m: float) -> CameraCalibration:
        """Return what a policy may know of the camera, on an agent of this height."""
        lens = self.intrinsics
        return CameraCalibration(lens.size, lens.matrix, np.array(lens.distortion), self.base_SE3_camera(body_height_m))


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
    """Return the names of a rig's cameras: True is "surround", False is no camera."""
    if cameras is False:
        return frozenset()
    name = SURROUND if cameras is True else cameras
    require_choice("cameras", name, RIG_NAMES)
    return frozenset(RIG_HEADINGS_RAD[name])


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
    """Return the cameras of the rig `name`: each of 320 x 180 pixels and 100 degrees, on the middle of the roof."""
    if not (isinstance(name, str) and name in RIG_HEADINGS_RAD):
        raise UnknownNameError("cameras", name, RIG_NAMES)
    return tuple(
        Camera(camera, yaw_rad=float(heading), pitch_rad=float(pitch_rad))
        for camera, heading in RIG_HEADINGS_RAD[name].items()
    )


def agent_rigs(option: object, kinds: Mapping[str, str]) -> dict[str, Rig]:
    """Return the cameras of every agent, by a `RigOption`, in which an agent's name goes before its kind.

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
    """Validate the option `cameras` as `rig` does, but for names of agents, which the environment checks later."""
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
