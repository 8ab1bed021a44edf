"""Trust by agreement: tracks and senders that agree with what the receiver detects where it can see."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from coopsim.defenses.claim_memory import ClaimMemory
from coopsim.defenses.lidar_rays import LidarRays
from coopsim.geometry.boxes import covers
from coopsim.geometry.se3 import Floats
from coopsim.interfaces.defense import DEFENSES, Claim, Defense, Reception, Trust
from coopsim.interfaces.guard import MOST_SENDERS
from coopsim.support.checks import require_count, require_positive, require_probability


@DEFENSES.register("trust", alias="mate")
@dataclass(kw_only=True, eq=False)
class AgreementTrust(Defense):
    """Trust as a hidden state of each claimed object and each sender (Hallyburton and Pajic, "Security-Aware Sensor
    Fusion with MATE: the Multi-Agent Trust Estimator", 2025).

    Trust has a Beta distribution, which each frame first moves toward its prior and then updates by
    pseudomeasurements. That of an object in the receiver's view is 1 if the receiver detects it, too, and 0 if it does
    not and sees through it: a detector misses much of what has few points, so an object with any point on it that is
    not detected says nothing. That of a sender is the trust in each of its objects so judged. Each weighs by its
    score. The mean of the distribution is the trust. In MATE, agents share their fields of view, and are also tested on
    what they should see and do not say; here nothing more is sent, so only what they say is judged, in the receiver's
    view by its points.

    Attributes:
        gate_m: largest distance of a claimed object from a detection of the receiver that is the same.
        rays: least points on an object and rays through it with which it is in view.
        fading: share of the evidence that is left after a frame.
        doubt_weight: weight of a sender's objects with a trust below `low`, MATE's negativity bias; 1: none. Few
            honest detections are seen through, but with 4 some honest senders are condemned (`town`, seed 1006).
        low: trust below which an object counts as doubted.
    """

    needs_lidar: ClassVar[bool] = True

    gate_m: float = 2.0
    rays: int = 6
    fading: float = 0.9
    doubt_weight: float = 2.0
    low: float = 0.4

    def __post_init__(self) -> None:
        require_positive(gate_m=self.gate_m, doubt_weight=self.doubt_weight)
        require_count(1, rays=self.rays)
        require_probability(fading=self.fading, low=self.low)
        self._objects, self._senders = ClaimMemory(self.fading), dict[str, tuple[float, float]]()

    def judge(self, reception: Reception) -> Trust:
        cast, now_ns = LidarRays(reception), reception.observation.time_ns
        own, objects = reception.own.boxes.center[:, :2], []
        for claim in reception.claims:
            evidence = self._agreement(claim, own, cast) if claim.is_new else np.zeros((len(claim.detections), 2))
            total = self._objects.add(claim.sender, claim.detections, reception.odom_SE3_base, now_ns, evidence)
            trust = (total[:, 0] + 1.0) / (total.sum(axis=1) + 1.0 + _PRIOR_AGAINST)
            if claim.is_new:
                seen = evidence.any(axis=1)
                self._update(claim.sender, trust[seen], evidence[seen].sum(axis=1))
            objects.append(trust)
        return Trust({name: self._trust(name) for name in reception.senders}, objects)

    def _agreement(self, claim: Claim, own: Floats, cast: LidarRays) -> Floats:
        """Return (N, 2): 1 for objects in view that the receiver detects, and 1 against those that it sees through."""
        on, through = cast.of(claim)
        boxes = claim.detections.boxes
        in_view = (on + through >= self.rays) & ~covers(boxes, np.zeros(2))
        apart = np.linalg.norm(boxes.center[:, None, :2] - own[None], axis=2).min(axis=1, initial=np.inf)
        moved_m = 15.0 * min(max(claim.age_s, 0.0), 1.0)  # at a town's speed since capture
        agrees = apart <= self.gate_m + moved_m
        weight = np.clip(claim.detections.score, 0.05, 1.0)  # an unsure object is weak evidence, of either kind
        return np.column_stack([in_view & agrees, in_view & ~agrees & (on == 0)]) * weight[:, None]

    def _update(self, sender: str, trust: Floats, sureness: Floats) -> None:
        """Take in the trust in a sender's objects in view: propagate, then update by each pseudomeasurement."""
        before = self._senders.pop(sender, (0.0, 0.0))
        weight = sureness * np.where(trust < self.low, self.doubt_weight, 1.0)
        agree, doubt = float((weight * trust).sum()), float((weight * (1 - trust)).sum())
        self._senders[sender] = self.fading * before[0] + agree, self.fading * before[1] + doubt
        while len(self._senders) > MOST_SENDERS:
            self._senders.pop(next(iter(self._senders)))

    def _trust(self, sender: str) -> float:
        agree, doubt = self._senders.get(sender, (0.0, 0.0))
        return (agree + _PRIOR_FOR) / (agree + doubt + _PRIOR_FOR + _PRIOR_AGAINST)


_PRIOR_FOR, _PRIOR_AGAINST = 2.0, 0.5
"""Counts of the prior Beta distribution of a sender, (2, 0.5); that of an object has (1, 0.5). Ours: trust before any
evidence is 0.8 and 0.67, so that what cannot be seen is believed."""
