"""Witness: own eyes first, then free space, then how bodies can move. Senders that disagree are no evidence."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from coopsim.defenses.belief import SenderBeliefs
from coopsim.defenses.claim_memory import ClaimMemory
from coopsim.defenses.claimed_paths import ClaimedPaths
from coopsim.defenses.consistency import LIED
from coopsim.defenses.lidar_rays import LidarRays
from coopsim.defenses.seen_twice import SeenTwice
from coopsim.geometry.boxes import Boxes3D, covers
from coopsim.geometry.se3 import Floats
from coopsim.interfaces.defense import DEFENSES, Claim, Defense, Reception, Trust
from coopsim.support.checks import require_count, require_positive
from coopsim.tracking.ab3dmot_tracker import ab3dmot
from coopsim.types import Ints, Mask


@DEFENSES.register("witness")
@dataclass(kw_only=True, eq=False)
class Witness(Defense):
    """Believe of each object the one who sees it best: oneself, then those whom nothing contradicts.

    1. An object that the receiver itself detects within `own_m` needs no other witness: what others say of it is left
       out. So a small shift of a real object has no effect where the receiver looks. Of one that the receiver has
       detected in the last two seconds and has points on, words are left out that put it elsewhere than its own track.
    2. An object that the receiver's rays go through is left out, as in CAD (Zhang et al., USENIX Security 2024).
    3. A vehicle that a sender's messages move sideways faster than `sideways_m_s` is left out: wheels do not go there.
       So is any object that leaps by `leap_m` from where its speed led, and gets faster: no engine or leg is so strong.
    4. Of several senders who tell of one object in different places, those are left out whom a majority contradicts.

    A sender is condemned for sure objects that lastingly are not there or leap. It is also condemned for vehicles that
    it places off where the receiver detects them, see `SeenTwice`: the track agreement of MATE (Hallyburton and Pajic,
    2025), by places, as small shifts (PosePert, arXiv 2605.01301) agree by any gate. No other agent can bring these
    about. Disagreement of senders expels nobody, so that liars cannot make a receiver expel honest agents, as TrustFlip
    (arXiv 2605.22122) does.

    Attributes:
        own_m: largest distance of a claimed object from the receiver's detection of it.
        rays: least rays through an object that say that it is not there.
        lasting: messages, the older the less they count, with which a contradiction condemns; nine in a row make 6.
        surest: least score of an object that counts against its sender.
        sideways_m_s: speed of a vehicle across its heading that is not possible.
        leap_m: distance from where its speed led, within half a second, that is not possible for what gets faster.
        agree_m: largest distance of one object as two honest senders tell of it.
        track_m: largest distance of an object from the receiver's own track of it.
    """

    needs_lidar: ClassVar[bool] = True

    own_m: float = 2.0
    rays: int = 6
    lasting: float = 6.0
    surest: float = 0.65
    sideways_m_s: float = 1.5
    leap_m: float = 0.8
    agree_m: float = 1.0
    track_m: float = 0.6

    def __post_init__(self) -> None:
        require_count(1, rays=self.rays)
        names = ("own_m", "lasting", "surest", "sideways_m_s", "leap_m", "agree_m", "track_m")
        require_positive(**{name: getattr(self, name) for name in names})
        self._beliefs, self._lasting = SenderBeliefs(), ClaimMemory()
        self._paths, self._seen_twice = ClaimedPaths(), SeenTwice()
        self._tracker = ab3dmot(hits=1, age=_REMEMBERED)

    def judge(self, reception: Reception) -> Trust:
        cast, own = LidarRays(reception), reception.own.boxes.center[:, :2]
        remembered = self._remembered(reception)
        believed = []
        for number, claim in enumerate(reception.claims):
            found, (on, through) = claim.detections, cast.of(claim)
            # The receiver does not see itself.
            free = (on == 0) & (through >= self.rays) & ~covers(found.boxes, np.zeros(2))
            slides, leaps = self._paths.add(claim, reception.odom_SE3_base, reception.observation.time_ns)
            impossible = (slides > self.sideways_m_s) | (leaps > self.leap_m)
            self._weigh(claim, free | impossible, reception)
            known = self._is_known(found.boxes, own, remembered, on)
            believed.append(~(free | known | impossible | self._is_outvoted(number, reception)))
        objects = [each.astype(np.float64) for each in believed]
        return Trust({name: self._beliefs.trust(name) for name in reception.senders}, objects)

    def _remembered(self, reception: Reception) -> Floats:
        """Return the places (N, 2) of what the receiver detects or has detected lately, by its own tracks."""
        odom_SE3_base = reception.odom_SE3_base
        self._tracker.step(reception.own.transform(odom_SE3_base), reception.observation.time_ns)
        tracks = self._tracker.state.tracked.boxes[:, :3]
        return odom_SE3_base.inverse().apply(tracks)[:, :2]

    def _is_known(self, boxes: Boxes3D, own: Floats, remembered: Floats, on: Ints) -> Mask:
        """Return the mask (N,) of boxes of which the receiver knows better, with so many points `on` (N,) each."""
        detected = _nearest_m(boxes, own) <= self.own_m
        off_m = _nearest_m(boxes, remembered)
        known: Mask = detected | ((on >= self.rays) & (off_m > self.track_m) & (off_m <= self.own_m))
        return known

    def _weigh(self, claim: Claim, wrong: Mask, reception: Reception) -> None:
        """Take in what a new message says of its sender: sure objects that are lastingly wrong."""
        sure = wrong & (claim.detections.score >= self.surest) & claim.is_new
        evidence = np.column_stack([np.zeros(len(sure)), sure])
        now_ns = reception.observation.time_ns
        lasting = self._lasting.add(claim.sender, claim.detections, reception.odom_SE3_base, now_ns, evidence)
        if claim.is_new:
            ratio = self._seen_twice.ratio(claim, reception.own.boxes, reception.odom_SE3_base)
            lied = (lasting[:, 1] >= self.lasting).any()
            self._beliefs.update(claim.sender, max(ratio, LIED) if lied else ratio)

    def _is_outvoted(self, number: int, reception: Reception) -> Mask:
        """Return the mask (N,) of a claim's objects that more senders put elsewhere than there."""
        claim = reception.claims[number]
        boxes = claim.detections.boxes
        there, elsewhere = np.zeros((2, len(boxes)))
        for other in reception.claims:
            if other.sender != claim.sender:
                near = _nearest_m(boxes, other.detections.boxes.center[:, :2])
                there += near <= self.agree_m
                elsewhere += (near > self.agree_m) & (near <= self.own_m)
        return elsewhere > there + 1  # the sender itself has a voice


_REMEMBERED = 20
"""Frames without a detection for which the receiver remembers an object: two seconds."""


def _nearest_m(boxes: Boxes3D, places: Floats) -> Floats:
    """Return the distance (N,) from each box to the nearest of places (M, 2); infinite if there is none."""
    apart = np.linalg.norm(boxes.center[:, None, :2] - places[None], axis=2)
    nearest: Floats = apart.min(axis=1, initial=np.inf)
    return nearest
