"""Attacks on poses and times in envelopes: `pose_offset`, `pose_noise`, `pose_drift`, `stamp` and `replay`.

They hold for every content. Receivers place all objects by the sender's stated pose, and move them by its age, so one
number moves everything in the message. None costs a byte.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, replace

import numpy as np

from coopsim.errors import InvalidValueError
from coopsim.geometry.se3 import Floats, wrap_angle
from coopsim.interfaces.attack import ATTACKS, Attack, AttackerView
from coopsim.support.checks import require_between, require_choice, require_finite_number, require_non_negative
from coopsim.types import NS_PER_S, Message, PoseEstimate, seconds_to_ns


def _moved(message: Message, offset: Floats) -> Message:
    """Return a message that states a pose with this offset (3,) of x, y (m) and heading (rad) in the world frame."""
    pose = message.pose.xyz_yaw.copy()
    pose[[0, 1, 3]] += offset
    pose[3] = wrap_angle(pose[3])
    return replace(message, pose=PoseEstimate(pose, message.pose.covariance))


@ATTACKS.register("pose_offset")
@dataclass(kw_only=True)
class PoseOffset(Attack):
    """State a pose beside the own one, always by the same offset: F2MD's constant position offset.

    Attributes:
        x_m: offset along the world's x.
        y_m: offset along its y.
        heading_rad: offset of the heading.
    """

    x_m: float = 3.0
    y_m: float = 0.0
    heading_rad: float = 0.0

    def __post_init__(self) -> None:
        super().__post_init__()
        require_finite_number(x_m=self.x_m, y_m=self.y_m, heading_rad=self.heading_rad)

    def send(self, view: AttackerView, message: Message) -> Message:
        return _moved(message, np.array([self.x_m, self.y_m, self.heading_rad]))


@ATTACKS.register("pose_noise")
@dataclass(kw_only=True)
class PoseNoise(Attack):
    """State a pose with a new random offset in each message: F2MD's random position offset.

    Attributes:
        position_m: standard deviation of x and of y.
        heading_rad: standard deviation of the heading.
    """

    position_m: float = 2.0
    heading_rad: float = 0.0

    def __post_init__(self) -> None:
        super().__post_init__()
        require_non_negative(position_m=self.position_m, heading_rad=self.heading_rad)

    def send(self, view: AttackerView, message: Message) -> Message:
        spread = np.array([self.position_m, self.position_m, self.heading_rad])
        return _moved(message, spread * view.rng.standard_normal(3))


_UNNOTICED_M = 1.0
"""Offset at which an adaptive drift stays: half of the 2 m within which methods take two boxes for one object
(nuScenes' tracking benchmark matches within 2 m)."""


@ATTACKS.register("pose_drift")
@dataclass(kw_only=True)
class PoseDrift(Attack):
    """State a pose that drifts away slowly, so that no step stands out.

    Attributes:
        speed_m_s: speed of the drift. At 0.3 m/s a message moves by 3 cm a tenth of a second: less than the noise of a
            satellite receiver.
        direction_rad: direction of the drift in the world frame; None: drawn.
        most_m: offset at which it stays.
        knows: "nothing", or "agreement": the attacker knows that receivers compare objects, and so stays at 1 m, where
            they still match, and lets the pose's stated covariance cover the offset.
    """

    speed_m_s: float = 0.3
    direction_rad: float | None = None
    most_m: float = 5.0
    knows: str = "nothing"

    def __post_init__(self) -> None:
        super().__post_init__()
        require_non_negative(speed_m_s=self.speed_m_s, most_m=self.most_m)
        require_choice("knows", self.knows, ("nothing", "agreement"))
        if self.direction_rad is not None:
            require_finite_number(direction_rad=self.direction_rad)
        self._direction_rad = self.direction_rad

    def send(self, view: AttackerView, message: Message) -> Message:
        if self._direction_rad is None:
            self._direction_rad = float(view.rng.uniform(-np.pi, np.pi))
        most_m = min(self.most_m, _UNNOTICED_M) if self.knows == "agreement" else self.most_m
        moved_m = min(self.speed_m_s * (view.time_s - self.start_s), most_m)
        lie = _moved(message, moved_m * np.array([np.cos(self._direction_rad), np.sin(self._direction_rad), 0.0]))
        if self.knows == "nothing" or lie.pose.covariance is None:
            return lie
        covariance = lie.pose.covariance + np.diag([moved_m**2, moved_m**2, 0.0])
        return replace(lie, pose=PoseEstimate(lie.pose.xyz_yaw, covariance))


@ATTACKS.register("stamp")
@dataclass(kw_only=True)
class Stamp(Attack):
    """State another time of capture than the real one.

    Attributes:
        offset_s: time that is added; negative: the content seems older than it is.
    """

    offset_s: float = -0.5

    def __post_init__(self) -> None:
        super().__post_init__()
        require_between(-3600, 3600, offset_s=self.offset_s)

    def send(self, view: AttackerView, message: Message) -> Message:
        shift_ns = seconds_to_ns(abs(self.offset_s)) * (1 if self.offset_s > 0 else -1)
        return replace(message, captured_ns=max(message.captured_ns + shift_ns, 0))


_MOST_KEPT = 1000
"""Messages that a replaying attacker keeps."""


@ATTACKS.register("replay")
@dataclass(kw_only=True)
class Replay(Attack):
    """Send an old message of its own as if it were new: F2MD's data replay and eventual stop.

    Attributes:
        delay_s: age of the message that is sent.
        fresh: state the present time and pose; otherwise the message stays as it was.
    """

    delay_s: float = 1.0
    fresh: bool = True

    def __post_init__(self) -> None:
        super().__post_init__()
        require_between(0, 60, delay_s=self.delay_s)
        if not isinstance(self.fresh, bool):
            raise InvalidValueError(f"fresh must be True or False, got {self.fresh!r}")
        self._kept: deque[Message] = deque(maxlen=_MOST_KEPT)

    def send(self, view: AttackerView, message: Message) -> Message:
        self._kept.append(message)
        latest_ns = message.captured_ns - round(self.delay_s * NS_PER_S)
        while len(self._kept) > 1 and self._kept[1].captured_ns <= latest_ns:
            self._kept.popleft()
        old = self._kept[0]
        if old.captured_ns > latest_ns:  # nothing so old was sent yet
            return message
        return replace(old, captured_ns=message.captured_ns, pose=message.pose) if self.fresh else old
