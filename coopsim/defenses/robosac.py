"""ROBOSAC: sample teammates until the result agrees with the receiver's own."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from coopsim.geometry.assignment import greedy
from coopsim.geometry.iou import iou_bev
from coopsim.interfaces.defense import DEFENSES, Defense, Reception, Trust
from coopsim.support.checks import require_count, require_probability
from coopsim.types import Detections


@DEFENSES.register("robosac")
@dataclass(kw_only=True, eq=False)
class Robosac(Defense):
    """Random sample consensus over teammates (Li et al., "Among Us: Adversarially Robust Collaborative Perception by
    Consensus", ICCV 2023: ROBOSAC).

    A set of senders is in consensus if what is found with it agrees with what the receiver finds alone. The set of all
    is tried first, then last frame's consensus, and then random sets, each size as often as
    the budget allows, from large to small, as A2CP does. If none is in consensus, nobody is believed.

    The paper's agreement is the Jaccard index of matched boxes. Cooperation finds more than the receiver alone, which
    lowers it where nobody lies; so here only boxes within `near_m` count, and boxes found in addition weigh `added`.

    Attributes:
        budget: most sets that are tried in a frame; each costs a pass.
        agreement: least agreement of a consensus; the paper's 0.3.
        near_m: distance from the receiver within which boxes count.
        added: weight in [0, 1] of boxes found in addition to the receiver's own; the paper's is 1.
        match_iou: least BEV IoU of boxes that match.
    """

    budget: int = 5
    agreement: float = 0.3
    near_m: float = 50.0
    added: float = 1.0
    match_iou: float = 0.1

    def __post_init__(self) -> None:
        require_count(1, budget=self.budget)
        require_probability(agreement=self.agreement, added=self.added, match_iou=self.match_iou)
        self._consensus: tuple[str, ...] = ()

    def judge(self, reception: Reception) -> Trust:
        senders = reception.senders
        if not senders:
            return Trust({})
        own, believed = self._near(reception.own), frozenset[str]()
        for among in self._sets(senders, reception.rng):
            if self._agree(own, self._near(reception.find(among))) >= self.agreement:
                believed = frozenset(among)
                break
        self._consensus = tuple(sorted(believed))
        return Trust({name: float(name in believed) for name in senders})

    def _sets(self, senders: tuple[str, ...], rng: np.random.Generator) -> list[tuple[str, ...]]:
        """Return the sets to try: all, last frame's consensus, and random ones from large to small, each once."""
        sets = [senders, tuple(name for name in self._consensus if name in senders)]
        sizes = range(len(senders) - 1, 0, -1)
        for k in range(10 * self.budget if len(senders) > 1 else 0):
            size = sizes[min(k // max(self.budget * 10 // len(sizes), 1), len(sizes) - 1)]
            sets.append(tuple(sorted(rng.choice(senders, size, replace=False).tolist())))
        return [each for each in dict.fromkeys(sets) if each][: self.budget]

    def _near(self, found: Detections) -> Detections:
        return found[np.hypot(*found.boxes.center[:, :2].T) <= self.near_m]

    def _agree(self, own: Detections, found: Detections) -> float:
        """Return the Jaccard index of two sets of boxes; 1 if both are empty."""
        if not len(own) or not len(found):
            return float(len(own) == len(found))
        matched = len(greedy(iou_bev(own.boxes.array, found.boxes.array), self.match_iou)[0])
        return matched / (len(own) + self.added * (len(found) - matched))
