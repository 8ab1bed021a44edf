"""Consistency: what the receiver sees free, nobody has seen occupied, and the reverse."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from coopsim.defenses.belief import SenderBeliefs
from coopsim.defenses.claim_memory import ClaimMemory
from coopsim.defenses.lidar_rays import LidarRays
from coopsim.geometry.boxes import covers
from coopsim.geometry.se3 import Floats
from coopsim.interfaces.defense import DEFENSES, LEAST_TRUST, Claim, Defense, Reception, Trust
from coopsim.support.checks import require_count, require_flag, require_positive
from coopsim.types import Detections, Mask

LIED, AGREED = 2.0, 0.8
"""Likelihood ratio, lying to honest, of a message with a sure object that lastingly contradicts, and of one without;
ours: five such messages condemn a sender, and one or two seconds of good ones clear it. Of honest detectors' messages
0 to 3 % have an object with so much against it (`late_fusion` in `crossing` and `roundabout`, seeds 500 and 501)."""


@DEFENSES.register("consistency", alias="cad")
@dataclass(kw_only=True, eq=False)
class Consistency(Defense):
    """Claims against the receiver's own points (Zhang et al., "On Data Fabrication in Collaborative Vehicular
    Perception", USENIX Security 2024, section 5: CAD, collaborative anomaly detection).

    An object is doubted where the receiver's rays go through it and none of its points is on it. It is left out at
    once. Detectors see ghosts, too, and some last, but few of those are sure: so a sender is condemned only for sure
    ones that last for a second. The reverse is for policies that fuse more than boxes: if what the receiver detects and
    has points on is lost in the fusion, the senders are believed less whose message loses it alone. In CAD, agents
    share maps of free and occupied space; here they share nothing more than their policy does, so only the receiver's
    own points judge.

    Attributes:
        rays: least rays through an object that say that it is not there.
        lasting: messages, the older the less they count, with which a contradiction lasts; nine in a row make 6.
        erased: judge also what is lost; costs a pass of the network in each frame, and one per sender at a loss.
        surest: least score of an object that counts against its sender, and of an own detection that must not be lost.
    """

    needs_lidar: ClassVar[bool] = True

    rays: int = 6
    lasting: float = 6.0
    erased: bool = True
    surest: float = 0.65

    def __post_init__(self) -> None:
        require_count(1, rays=self.rays)
        require_positive(lasting=self.lasting, surest=self.surest)
        require_flag(erased=self.erased)
        self._beliefs, self._memory, self._lasting = SenderBeliefs(), ClaimMemory(), ClaimMemory()

    def judge(self, reception: Reception) -> Trust:
        cast, now_ns = LidarRays(reception), reception.observation.time_ns
        lost_by = self._erasers(reception, cast) if self.erased and reception.fuses_maps else frozenset()
        objects: list[Floats] = []
        for claim in reception.claims:
            evidence = self._evidence(claim, cast)
            fresh = evidence if claim.is_new else 0 * evidence
            total = self._memory.add(claim.sender, claim.detections, reception.odom_SE3_base, now_ns, fresh)
            sure = fresh * (claim.detections.score >= self.surest)[:, None]
            lasting = self._lasting.add(claim.sender, claim.detections, reception.odom_SE3_base, now_ns, sure)
            bad = bool(((lasting[:, 1] >= self.lasting) & (total[:, 1] > total[:, 0])).any()) or claim.sender in lost_by
            if claim.is_new and (bad or evidence.any()):
                self._beliefs.update(claim.sender, LIED if bad else AGREED)
            objects.append((total[:, 0] + 0.5) / (total.sum(axis=1) + 0.5))
        return Trust({name: self._beliefs.trust(name) for name in reception.senders}, objects)

    def _evidence(self, claim: Claim, cast: LidarRays) -> Floats:
        """Return (N, 2): 1 for objects with points on them, and 1 against those that are seen through."""
        on, through = cast.of(claim)
        against = (on == 0) & (through >= self.rays)
        against &= ~covers(claim.detections.boxes, np.zeros(2))  # the receiver does not see itself
        return np.column_stack([on > 0, against]).astype(np.float64)

    def _erasers(self, reception: Reception, cast: LidarRays) -> frozenset[str]:
        """Return the senders that each make the fusion lose an object that the receiver detects and has points on."""
        own = reception.own
        on, _ = cast.count(own.boxes, np.zeros(len(own)))
        sure = own[(own.score >= self.surest) & (on >= self.rays)]
        believed = [name for name in reception.senders if self._beliefs.trust(name) >= LEAST_TRUST]
        if not len(sure) or not _lost(sure, reception.find(believed)).any():
            return frozenset()
        return frozenset(name for name in believed if _lost(sure, reception.find([name])).any())


def _lost(own: Detections, found: Detections, within_m: float = 2.0) -> Mask:
    """Return the mask (N,) of own detections that nothing found is near."""
    apart = np.linalg.norm(own.boxes.center[:, None, :2] - found.boxes.center[None, :, :2], axis=2)
    lost: Mask = apart.min(axis=1, initial=np.inf) > within_m
    return lost
