"""What an agent broadcasts: what it makes of its observations for others, and by which codec."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from functools import partial
from typing import Any, ClassVar, cast

from coopsim.comms.codecs.codec import codecs_of, decoder
from coopsim.comms.codecs.detection_codec import SharesDetections
from coopsim.comms.codecs.track_codec import TracksCodec, sendable
from coopsim.errors import InvalidValueError
from coopsim.support.checks import require_choice
from coopsim.support.registry import Registry
from coopsim.tracking.onboard import OnBoardTracker
from coopsim.types import Message, Observation


class Uplink(ABC):
    """Makes one agent's messages over one episode. It is asked once in each frame, in order, and may keep state.

    Attributes:
        codecs: the kind of content whose codecs the uplink can be made with, `ShareDetections(codec="cpm")`; None: the
            uplink has no choice.
        repeatable: it keeps no state: asked again in the same frame, it says the same.
    """

    codecs: ClassVar[str | None] = None
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
    """The agent's own detections, in its base frame, with its estimate of its pose.

    Detections that the codec cannot carry within its error bounds are left out.

    Args:
        codec: name of a codec for detections.
    """

    codecs = "detections"
    repeatable = True

    def __init__(self, codec: str = "detections") -> None:
        require_choice("codec", codec, codecs_of("detections"))
        self._name = codec
        self._codec = cast(SharesDetections[Any], decoder(codec))

    def message(self, sender: str, observation: Observation) -> Message | None:
        found, time_ns, pose = observation.detections, observation.time_ns, observation.pose
        if not (sent := self._codec.sendable(found)).all():
            found = found[sent]
        payload = self._codec.encode(self._codec.content_of(found, sender, time_ns, pose))
        return Message(sender, time_ns, pose, payload, self._name)


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


UPLINKS: Registry[Callable[..., Uplink]] = Registry("uplink")
"""What makes an uplink, without arguments; the environment makes one for each agent and episode."""


def uplink_maker(uplink: str, codec: str | None = None) -> Callable[[], Uplink]:
    """What makes the uplink called `uplink`, with a codec of that name; None: with its own.

    Raises:
        UnknownNameError: there is no such uplink, or no such codec for it.
        InvalidValueError: the uplink has no choice of codecs.
    """
    make = UPLINKS.get(uplink)
    if codec is None:
        return make
    content = getattr(make, "codecs", None)
    if content is None:
        raise InvalidValueError(
            f"codec must be None for uplink {uplink!r}, which has no choice of codecs, got {codec!r}"
        )
    require_choice("codec", codec, codecs_of(content))
    decoder(codec)  # a package that it needs and that is missing is named now, not at the first message
    return partial(make, codec=codec)


UPLINKS.register("none")(Silence)
UPLINKS.register("detections")(ShareDetections)
UPLINKS.register("tracks")(ShareTracks)
