"""The uplink `detections`: each agent shares its own detections."""

from __future__ import annotations

from typing import Any, cast

import numpy as np

from coopsim.comms.codecs.codec import Codec
from coopsim.comms.codecs.detection_codec import SharesDetections
from coopsim.comms.uplinks.uplink import UPLINKS, ContentUplink
from coopsim.support.checks import require_flag
from coopsim.tracking.ab3dmot_tracker import OnBoardTracker
from coopsim.types import AgentSpec, Observation


@UPLINKS.register("detections")
class ShareDetections(ContentUplink[Any]):
    """The agent's detections in its base frame, with its estimate of its pose.

    Detections that the codec cannot carry within its error bounds are left out.

    Args:
        codec: the spec of a codec for detections, or one as an object.
        velocities: send each box with the velocity of its track, by an on-board tracker of the sender. Receivers move
            late boxes by it.
    """

    content = "detections"

    def __init__(self, codec: str | Codec[Any] = "detections", velocities: bool = False) -> None:
        super().__init__(codec)
        require_flag(velocities=velocities)
        self._codec, self._velocities = cast(SharesDetections[Any], self.codec), velocities
        self._trackers: dict[str, OnBoardTracker] = {}

    def begin(self, spec: AgentSpec, rng: np.random.Generator) -> None:
        self._trackers[spec.name] = OnBoardTracker()

    def content_of(self, sender: str, observation: Observation) -> Any:
        found = observation.detections
        if not (sent := self._codec.sendable(found)).all():
            found = found[sent]
        if self._velocities and found.velocity is None:
            found = self._trackers[sender].with_velocities(observation, found)
        return self._codec.content_of(found, sender, observation.time_ns, observation.pose)
