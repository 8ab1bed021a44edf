"""The uplink `points`: each agent shares its sweeps, for early fusion."""

from __future__ import annotations

import numpy as np

from coopsim.comms.codecs.codec import Codec
from coopsim.comms.uplinks.uplink import UPLINKS, ContentUplink
from coopsim.support.checks import require_number
from coopsim.types import Observation, PointCloud


@UPLINKS.register("points")
class SharePoints(ContentUplink[PointCloud]):
    """The points of all of an agent's sweeps in its base frame, with its estimate of its pose.

    An agent without a LiDAR sends an empty cloud.

    Args:
        keep: fraction of the points to send, evenly spaced in the order of firing, in (0, 1].
        codec: the spec of a codec for points, or one as an object.
    """

    content = "points"

    def __init__(self, keep: float = 1.0, codec: str | Codec[PointCloud] = "points") -> None:
        require_number("in (0, 1]", lambda value: 0 < value <= 1, keep=keep)
        super().__init__(codec)
        self._keep = keep

    def content_of(self, sender: str, observation: Observation) -> PointCloud:
        cloud = PointCloud.of(*observation.sweeps.values())
        if self._keep == 1:
            return cloud
        count = round(self._keep * len(cloud))
        return cloud[np.arange(count) * len(cloud) // max(count, 1)]
