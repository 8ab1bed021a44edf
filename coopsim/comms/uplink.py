"""What an agent broadcasts: the part of its observation that goes into a message, and by which codec."""

from __future__ import annotations

from abc import ABC, abstractmethod

from coopsim.comms.message import DetectionsCodec
from coopsim.registry import Registry
from coopsim.types import Message, Observation


class Uplink(ABC):
    """Makes an agent's message of one frame."""

    @abstractmethod
    def message(self, sender: str, observation: Observation) -> Message | None:
        """The message for what `sender` observed just now, or None to stay silent."""


class Silence(Uplink):
    """Nothing is sent."""

    def message(self, sender: str, observation: Observation) -> Message | None:
        return None


class ShareDetections(Uplink):
    """The agent's own detections, in its base frame, with its estimate of its pose."""

    def __init__(self) -> None:
        self._codec = DetectionsCodec()

    def message(self, sender: str, observation: Observation) -> Message | None:
        payload = self._codec.encode(observation.detections)
        return Message(sender, observation.time_ns, observation.pose, payload, "detections")


UPLINKS: Registry[Uplink] = Registry("uplink")
UPLINKS.register("none")(Silence())
UPLINKS.register("detections")(ShareDetections())
