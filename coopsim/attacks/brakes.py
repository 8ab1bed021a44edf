"""Attacks that aim at the brakes: `shift_into_path`, `hide_conflict`, `phantom_stop`, and `trust_poison`.

Cars that are told small lies about real objects brake in half of the cases by predictors on recordings (PosePert,
arXiv 2605.01301). Here the lies are chosen in each frame on a copy of the planner, and are driven.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from coopsim.attacks.aimed import AimedAttack
from coopsim.attacks.ghost import SIZES_M
from coopsim.attacks.victim_plan import VictimPlan
from coopsim.geometry.boxes import Boxes3D
from coopsim.geometry.se3 import Floats
from coopsim.interfaces.attack import ATTACKS
from coopsim.support.checks import require_choice, require_count, require_number, require_positive, require_probability
from coopsim.types import Ints
from coopsim.types.taxonomy import ObjectClass

HARD_M_S2 = -3.0
"""Braking that an attacker is after: what is counted as hard."""

_REACH_S, _REACH_M, _ASIDE_M = 2.5, 8.0, 8.0
"""Part of the way ahead, as time and a distance more, and distance to its sides, in which an object may matter soon."""


def _candidates(victim: VictimPlan, most: int) -> Ints:
    """Return rows of the nearest objects beside or on the way ahead, at most so many; few others heard of come first.

    An object of which others tell, too, moves less in their mean.
    """
    reach_m = _REACH_S * victim.speed_m_s + _REACH_M
    ahead = (victim.along_m > 0) & (victim.along_m < reach_m) & (np.abs(victim.aside_m) < _ASIDE_M) & (victim.id >= 0)
    rows = np.flatnonzero(ahead)
    return rows[np.lexsort((victim.along_m[rows], victim.heard[rows]))][:most]


def _fused(victim: VictimPlan, row: int, by_m: Floats) -> Boxes3D:
    """Return the box (1) that the victim has of a moved object: the mean of what it and others say."""
    box = victim.objects.boxes[np.array([row])]
    shift = np.append(by_m, 0.0) / (1 + victim.heard[row])
    return Boxes3D(box.center + shift, box.size, box.yaw)


@ATTACKS.register("shift_into_path")
@dataclass(kw_only=True)
class ShiftIntoPath(AimedAttack):
    """Move real objects by less than a metre so that they seem to come into the victim's way, after PosePert.

    An object is first moved away from the way, slowly. Once a copy of the planner would brake hard for it, it is moved
    towards the way: in a second it seems to walk or drive there, and no box is ever farther off than `most_m`.

    Attributes:
        most_m: largest distance of an object from its place; 2 m is the gate of most matching.
        speed_m_s: speed with which it seems to come.
        back_m_s: speed with which it is moved away before; a slow one is hard to tell from standing.
        objects: most objects that are prepared at a time.
        score: confidence that is stated of them: the surer, the more it weighs in a mean.
    """

    most_m: float = 0.9
    speed_m_s: float = 3.0
    back_m_s: float = 1.5
    objects: int = 3
    score: float = 0.99

    def __post_init__(self) -> None:
        super().__post_init__()
        require_number("in (0, 2]", lambda far: 0 < far <= 2, most_m=self.most_m)
        require_positive(speed_m_s=self.speed_m_s, back_m_s=self.back_m_s)
        require_probability(score=self.score)
        require_count(1, 20, objects=self.objects)
        self._offset_m: dict[int, float] = {}
        self._pushed: set[int] = set()

    def plan(self, victim: VictimPlan) -> None:
        for row in _candidates(victim, self.objects).tolist():
            number, toward = int(victim.id[row]), victim.toward[row]
            offset_m = self._offset_m.get(number, 0.0)
            if number not in self._pushed and self._brakes(victim, row, offset_m):
                self._pushed.add(number)
            elif number in self._pushed and offset_m >= self.most_m:
                self._pushed.discard(number)
            offset_m += victim.dt_s * (self.speed_m_s if number in self._pushed else -self.back_m_s)
            offset_m = min(max(offset_m, -self.most_m), self.most_m)
            speed = (offset_m - self._offset_m.get(number, 0.0)) / victim.dt_s
            self._offset_m[number] = offset_m
            victim.move(row, offset_m * toward, speed * toward, self.score)

    def _brakes(self, victim: VictimPlan, row: int, offset_m: float) -> bool:
        """Return whether the planner would brake hard if the object came on from an offset."""
        toward, share = victim.toward[row], 1 / (1 + victim.heard[row])
        velocity = victim.velocity[row] + self.speed_m_s * share * toward
        believed = _fused(victim, row, offset_m * toward)
        return victim.answer(believed, velocity[None], victim.objects.label[[row]]) <= HARD_M_S2


@ATTACKS.register("hide_conflict")
@dataclass(kw_only=True)
class HideConflict(AimedAttack):
    """Move a real object for which the victim would brake out of its way, so that it drives on.

    Of eight directions that one is taken, and kept, for which a copy of the planner brakes least.

    Attributes:
        most_m: distance by which it is moved; from 2 m on most receivers take it for another object.
        objects: most objects that are moved at a time.
    """

    most_m: float = 2.5
    objects: int = 2

    def __post_init__(self) -> None:
        super().__post_init__()
        require_positive(most_m=self.most_m)
        require_count(1, 20, objects=self.objects)
        self._by_m: dict[int, Floats] = {}

    def plan(self, victim: VictimPlan) -> None:
        for row in _candidates(victim, self.objects).tolist():
            number = int(victim.id[row])
            if number not in self._by_m and self._answer(victim, row, np.zeros(2)) < _BRAKES_M_S2:
                # In the axes of the world, in which the object stays where it was put while the victim turns.
                self._by_m[number] = victim.world_SE3_base.rotate_planar(self._best(victim, row))
            if number in self._by_m:
                victim.move(row, victim.world_SE3_base.inverse().rotate_planar(self._by_m[number]))

    def _best(self, victim: VictimPlan, row: int) -> Floats:
        angles = np.arange(8) * math.pi / 4
        choices = self.most_m * np.column_stack([np.cos(angles), np.sin(angles)])
        answers = [self._answer(victim, row, by_m) for by_m in choices]
        best: Floats = choices[int(np.argmax(answers))]
        return best

    def _answer(self, victim: VictimPlan, row: int, by_m: Floats) -> float:
        box = victim.objects.boxes[np.array([row])]
        moved = Boxes3D(box.center + np.append(by_m, 0.0), box.size, box.yaw)
        return victim.answer(moved, victim.velocity[[row]], victim.objects.label[[row]])


_BRAKES_M_S2 = -1.0
"""Braking from which an object is in the way: comfortable braking is 1.5 m/s²."""


@ATTACKS.register("phantom_stop")
@dataclass(kw_only=True)
class PhantomStop(AimedAttack):
    """Claim an object on the victim's way, as near as it takes for a copy of the planner to brake as hard as it can.

    It is gone once the victim stands or is past it, and comes again when that has sped up: F2MD's sudden appearance,
    placed by the planner.

    Attributes:
        label: class of the object: "car", "truck", "pedestrian", "child" or "bicycle".
        score: its confidence.
        from_m_s: speed of the victim from which it appears.
    """

    label: str = "car"
    score: float = 0.9
    from_m_s: float = 5.0

    def __post_init__(self) -> None:
        super().__post_init__()
        require_choice("label", self.label, SIZES_M)
        require_probability(score=self.score)
        require_positive(from_m_s=self.from_m_s)
        self._place: Floats | None = None
        self._number = 0

    def plan(self, victim: VictimPlan) -> None:
        if self._place is not None:
            ahead = victim.world_SE3_base.inverse().apply(self._place[:3])[0]
            if victim.speed_m_s < 1.0 or ahead < 0:
                self._place, self._number = None, self._number + 1
        elif victim.speed_m_s >= self.from_m_s:
            self._place = self._best(victim)
        if self._place is not None:
            box = Boxes3D.from_array(self._place[None]).transform(victim.world_SE3_base.inverse())
            victim.claim(self._number, box.array[0], int(ObjectClass[self.label.upper()]), score=self.score)

    def _best(self, victim: VictimPlan) -> Floats | None:
        """Return the row of the box in the world for which the planner brakes hardest; None: for none hard."""
        first, label = 1 + round(_NEAREST_M / victim.route.spacing_m), np.array([int(ObjectClass[self.label.upper()])])
        rows = self._boxes(victim)[first : first + _PLACES * _APART : _APART]
        boxes = [Boxes3D.from_array(row[None]) for row in rows]
        late_s = _CONFIRMED * victim.dt_s
        answers = [victim.answer(box, np.zeros((1, 2)), label, late_s) for box in boxes]
        if not answers or min(answers) > HARD_M_S2:
            return None
        # The farthest of the hardest: the victim has longer to find out that it is not there.
        best = max(k for k, each in enumerate(answers) if each == min(answers))
        row: Floats = boxes[best].transform(victim.world_SE3_base).array[0]
        return row

    def _boxes(self, victim: VictimPlan) -> Floats:
        """Return a row of a box (K, 7) on each point of the route, in the victim's base frame."""
        points, tangents = victim.route.points, victim.route.tangents
        size = np.tile(SIZES_M[self.label], (len(points), 1))
        yaw = np.arctan2(tangents[:, 1], tangents[:, 0])
        return np.column_stack([points, size[:, 2] / 2, size, yaw])


_NEAREST_M, _APART, _PLACES = 8.0, 3, 9
"""Distance of the nearest place of a phantom ahead of the car's middle, points of the route between places, and their
number: up to where a car at 13 m/s stops."""

_CONFIRMED = 3
"""Frames until most trackers report a new object."""


@ATTACKS.register("trust_poison")
@dataclass(kw_only=True)
class TrustPoison(AimedAttack):
    """Contradict honest agents where the victim cannot see for itself, after TrustFlip (arXiv 2605.22122).

    What others tell of objects that the victim does not tell of itself is repeated beside its place. A receiver that
    compares its senders finds that they disagree, and may expel the wrong one; two liars are a majority. TrustFlip
    puts odd-shaped objects on the road for that; here the message alone lies.

    Attributes:
        off_m: distance by which objects are moved.
        objects: most objects that are contradicted.
    """

    off_m: float = 1.5
    objects: int = 10

    def __post_init__(self) -> None:
        super().__post_init__()
        require_positive(off_m=self.off_m)
        require_count(1, 100, objects=self.objects)

    def plan(self, victim: VictimPlan) -> None:
        own = victim.others.get(victim.name, Boxes3D.empty())
        told = Boxes3D.concatenate(boxes for name, boxes in victim.others.items() if name != victim.name)
        told = told[_apart_m(told, own) > _SAME_M]
        told = told[np.argsort(np.hypot(*told.center[:, :2].T), kind="stable")][: self.objects]
        by_m = victim.world_SE3_base.inverse().rotate_planar(np.array([self.off_m, 0.0]))  # all liars say the same
        for row in np.flatnonzero(_apart_m(victim.objects.boxes, told) <= _SAME_M).tolist():
            victim.move(row, by_m)
        unseen = told[_apart_m(told, victim.objects.boxes) > _SAME_M]
        for number, box in enumerate(unseen.array):
            victim.claim(number, box + np.append(by_m, np.zeros(5)), int(ObjectClass.CAR))


_SAME_M = 2.0
"""Largest distance of one object as two agents tell of it."""


def _apart_m(boxes: Boxes3D, others: Boxes3D) -> Floats:
    """Return the distance (N,) from each box to the nearest other one; infinite if there is none."""
    apart = np.linalg.norm(boxes.center[:, None, :2] - others.center[None, :, :2], axis=2)
    nearest: Floats = apart.min(axis=1, initial=np.inf)
    return nearest
