"""The uplink `intents`: each agent shares its own detections, and cars their planned ways and hard brakes beside."""

from __future__ import annotations

from typing import Any

from coopsim.comms.codecs.codec import Codec
from coopsim.comms.codecs.maneuvers import DENM, MCM, require_maneuvers
from coopsim.comms.uplinks.share_detections import ShareDetections
from coopsim.comms.uplinks.uplink import UPLINKS
from coopsim.support.checks import require_flag


@UPLINKS.register("intents")
class ShareIntents(ShareDetections):
    """Detections as by `ShareDetections`, an MCM with the planned way of a car, and a DENM while it brakes hard.

    Args:
        codec: the spec of a codec for detections, or one as an object.
        velocities: send each box with the velocity of its track.
        hard_brakes: send DENM.

    Raises:
        MissingDependencyError: asn1tools is not installed.
    """

    def __init__(
        self, codec: str | Codec[Any] = "detections", velocities: bool = False, hard_brakes: bool = True
    ) -> None:
        super().__init__(codec, velocities)
        require_flag(hard_brakes=hard_brakes)
        require_maneuvers()  # refused now, not when the first message is made
        self.beside = (MCM, DENM) if hard_brakes else (MCM,)
