"""AB3DMOT (Weng et al., IROS 2020): the baseline tracker of the field, on the agent's own detections."""

from __future__ import annotations

from coopsim.agents.policy import Needs
from coopsim.agents.tracking_policy import TrackingPolicy
from coopsim.catalog import POLICIES
from coopsim.tracking.ab3dmot_tracker import ab3dmot
from coopsim.tracking.tracker import Tracker


class AB3DMOTBased(TrackingPolicy):
    """A policy whose tracker is AB3DMOT's.

    Args:
        gate: smallest 3D GIoU of a match, in [-1, 1].
        hits: frames with a detection until a track is reported.
        age: frames without a detection until a track is dropped.
        late: what to do with messages that come late, see `TrackingPolicy`.
        align: correct poses by objects that several agents see, see `TrackingPolicy`.
    """

    def __init__(
        self, gate: float = -0.2, hits: int = 3, age: int = 2, late: str = "as_current", align: bool = False
    ) -> None:
        self._settings = (gate, hits, age)
        super().__init__(late, align)

    def make_tracker(self) -> Tracker:
        return ab3dmot(*self._settings)


@POLICIES.register("ab3dmot")
class AB3DMOT(AB3DMOTBased):
    """AB3DMOT on the agent's own detections; reads no message."""

    needs = Needs(uplink="none")
