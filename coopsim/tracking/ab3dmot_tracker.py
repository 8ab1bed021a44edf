"""AB3DMOT (Weng et al., IROS 2020), the baseline tracker of the field, composed of our parts."""

from __future__ import annotations

from coopsim.geometry.assignment import hungarian
from coopsim.support.checks import require_between
from coopsim.tracking.affinity import giou_3d
from coopsim.tracking.cascade import Cascade, Stage
from coopsim.tracking.lifecycle import HitsAndAge
from coopsim.tracking.motion.constant_velocity import ConstantVelocity, Motion
from coopsim.tracking.tracker import AssociationRound, Tracker


def ab3dmot(
    gate: float = -0.2,
    hits: int = 3,
    age: int = 2,
    later: AssociationRound | None = None,
    motion: Motion | None = None,
) -> Tracker:
    """Return the tracker: constant-velocity Kalman filter, 3D GIoU, Hungarian, confirmed by hits, ended by age.

    Args:
        gate: smallest 3D GIoU of a match, in [-1, 1].
        hits: frames with a detection, consecutive or not, until a track is reported.
        age: frames without a detection until a track is dropped.
        later: association of groups of detections after the first, see `Tracker`; None: as the first.
        motion: another motion model than AB3DMOT's.
    """
    require_between(-1, 1, gate=gate)
    stages = Cascade([Stage(giou_3d, hungarian, gate=gate)])
    return Tracker(motion or ConstantVelocity(), stages, HitsAndAge(hits, age), later=later)
