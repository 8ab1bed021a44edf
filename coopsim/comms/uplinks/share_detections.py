"""The uplink `detections`: each agent shares its own detections."""

from __future__ import annotations

from typing import Any, cast

from coopsim.comms.codecs.codec import Codec
from coopsim.comms.codecs.detection_codec import SharesDetections
from coopsim.comms.uplinks.uplink import UPLINKS, ContentUplink
from coopsim.types import Observation


@UPLINKS.register("detections")
class ShareDetections(ContentUplink[Any]):
    """The agent's detections in its base frame, with its estimate of its pose.

    Detections that the codec cannot carry within its error bounds are left out.

    Args:
        codec: the spec of a codec for detections, or one as an object.
    """

    content = "detections"

    def __init__(self, codec: str | Codec[Any] = "detections") -> None:
        super().__init__(codec)
        self._codec = cast(SharesDetections[Any], self.codec)

    def content_of(self, sender: str, observation: Observation) -> Any:
        found = observation.detections
        if not (sent := self._codec.sendable(found)).all():
            found = found[sent]
        return self._codec.content_of(found, sender, observation.time_ns, observation.pose)
