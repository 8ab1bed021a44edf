"""AB3DMOT's composition (Weng et al., IROS 2020): the baseline tracker of the field, out of our parts."""

from __future__ import annotations

from coopsim.geometry.assignment import hungarian
from coopsim.support.checks import require_between
from coopsim.tracking.affinity.affinity import giou_3d
from coopsim.tracking.cascade import Cascade, Stage
from coopsim.tracking.lifecycle import HitsAndAge
from coopsim.tracking.motion.constant_velocity import ConstantVelocity
from coopsim.tracking.tracker import Tracker, Turn


def ab3dmot(gate: float = -0.2, hits: int = 3, age: int = 2, later: Turn | None = None) -> Tracker:
    """The tracker: constant velocity Kalman filter, 3D GIoU, Hungarian, births by hits, deaths by age.

    Args:
        gate: smallest 3D GIoU of a match, in [-1, 1].
        hits: frames with a detection until a track is reported.
        age: frames without a detection until a track is dropped.
        later: how groups after the first are taken, see `Tracker`; None: as the first.
    """
    require_between(-1, 1, gate=gate)
    stages = Cascade([Stage(giou_3d, hungarian, gate=gate)])
    return Tracker(ConstantVelocity(), stages, HitsAndAge(hits, age), later=later)
