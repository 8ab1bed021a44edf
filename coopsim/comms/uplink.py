"""What an agent broadcasts: what it makes of its observations for others, and by which codec."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from typing import ClassVar

from coopsim.comms.message import DetectionsCodec
from coopsim.comms.track_codec import TracksCodec, sendable
from coopsim.registry import Registry
from coopsim.tracking.onboard import OnBoardTracker
from coopsim.types import Message, Observation


class Uplink(ABC):
    """Makes one agent's messages over one episode. It is asked once in each frame, in order, and may keep state.

    Attributes:
        repeatable: it keeps none: asked again in the same frame, it says the same.
    """

    repeatable: ClassVar[bool] = False

    @abstractmethod
    def message(self, sender: str, observation: Observation) -> Message | None:
        """The message for what `sender` observed just now, or None to stay silent."""

    def hear(self, observation: Observation) -> None:
        """What arrived in this frame, in the observation's inbox; called after `message`."""


class Silence(Uplink):
    """Nothing is sent."""

    repeatable = True

    def message(self, sender: str, observation: Observation) -> Message | None:
        return None


class ShareDetections(Uplink):
    """The agent's own detections, in its base frame, with its estimate of its pose."""

    repeatable = True

    def __init__(self) -> None:
        self._codec = DetectionsCodec()

    def message(self, sender: str, observation: Observation) -> Message | None:
        payload = self._codec.encode(observation.detections)
        return Message(sender, observation.time_ns, observation.pose, payload, "detections")


class ShareTracks(Uplink):
    """What the agent tracks by itself (`OnBoardTracker`), in its base frame, with its estimate of its pose.

    Nothing of what others said is in it, so nobody hears an echo of himself.
    """

    def __init__(self) -> None:
        self._tracker, self._codec = OnBoardTracker(), TracksCodec()

    def message(self, sender: str, observation: Observation) -> Message | None:
        estimates = self._tracker.step(observation).transform(self._tracker.frame.odom_SE3_base.inverse())
        payload = self._codec.encode(estimates[sendable(estimates)])
        return Message(sender, observation.time_ns, observation.pose, payload, "tracks")


UPLINKS: Registry[Callable[[], Uplink]] = Registry("uplink")
"""What makes an uplink; the environment makes one for each agent and episode."""

UPLINKS.register("none")(Silence)
UPLINKS.register("detections")(ShareDetections)
UPLINKS.register("tracks")(ShareTracks)
