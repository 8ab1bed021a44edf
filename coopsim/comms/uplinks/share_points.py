"""The uplink `points`: each agent shares its sweeps, for early fusion."""

from __future__ import annotations

import numpy as np

from coopsim.comms.codecs.codec import Codec
from coopsim.comms.uplinks.uplink import UPLINKS, ContentUplink
from coopsim.support.checks import require_number, require_probability
from coopsim.types import Ints, Observation, PointCloud

_LOW_M = 0.2


@UPLINKS.register("points")
class SharePoints(ContentUplink[PointCloud]):
    """Points of all of an agent's sweeps in its base frame, with its estimate of its pose.

    An agent without a LiDAR sends an empty cloud.

    Args:
        keep: fraction of the points to send, evenly spaced in the order of firing, in (0, 1].
        codec: the spec of a codec for points, or one as an object.
        keep_low: fraction of points less than 0.2 m above the agent's ground, in [0, 1]: there is little but ground,
            and it is half of all points. None: `keep`.
    """

    content = "points"

    def __init__(
        self, keep: float = 1.0, codec: str | Codec[PointCloud] = "points", keep_low: float | None = None
    ) -> None:
        require_number("in (0, 1]", lambda value: 0 < value <= 1, keep=keep)
        if keep_low is not None:
            require_probability(keep_low=keep_low)
        super().__init__(codec)
        self._keep, self._keep_low = keep, keep_low

    def content_of(self, sender: str, observation: Observation) -> PointCloud:
        cloud = PointCloud.of(*observation.sweeps.values())
        if self._keep_low is None:
            return cloud[_evenly(len(cloud), self._keep)] if self._keep < 1 else cloud
        low = cloud.xyz[:, 2] < _LOW_M
        kept = np.zeros(len(cloud), np.bool_)
        for rows, share in ((np.flatnonzero(low), self._keep_low), (np.flatnonzero(~low), self._keep)):
            kept[rows[_evenly(len(rows), share)]] = True
        return cloud[kept]


def _evenly(count: int, share: float) -> Ints:
    """Return this share of the numbers below `count`, evenly spaced."""
    kept = round(share * count)
    return np.arange(kept) * count // max(kept, 1)
