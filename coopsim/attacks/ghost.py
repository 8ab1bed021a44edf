"""The attack `ghost`: an object that is not there, in the way of another agent."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from coopsim.attacks.claims import Claims
from coopsim.errors import InvalidValueError
from coopsim.geometry.boxes import Boxes3D
from coopsim.geometry.se3 import SE3, Floats
from coopsim.interfaces.attack import ATTACKS, Attack, AttackerView, Victim
from coopsim.support.checks import require_choice, require_finite_number, require_probability
from coopsim.types import Detections
from coopsim.types.taxonomy import ObjectClass
from coopsim.types.track_estimates import TrackEstimates

SIZES_M = {
    "car": (4.5, 1.95, 1.75),
    "truck": (8.0, 2.5, 3.2),
    "pedestrian": (0.6, 0.6, 1.75),
    "child": (0.45, 0.45, 1.2),
    "bicycle": (1.8, 0.6, 1.7),
}
"""Length, width and height of claimed objects; the car's is that of the fitted clutter (`ClutterConfig.size_m`), the
others are plausible ones of ours."""

MOTIONS = ("standing", "along", "crossing")


@dataclass(kw_only=True)
class PlacedClaim(Attack):
    """An object that is not there, placed relative to another agent, whose place messages tell.

    Attributes:
        ahead_m: distance ahead of the victim's middle to the object's.
        aside_m: distance to the left of the victim's middle.
        motion: "standing" (it stays where it was placed, and is placed anew once the victim is past it), "along" (it
            keeps its place before the victim), or "crossing" (it comes from `ahead_m` and 10 m to the right, crosses
            to the left with `speed_m_s`, and comes again).
        speed_m_s: speed of a crossing object.
        label: class of the object: "car", "truck", "pedestrian", "child" or "bicycle".
    """

    ahead_m: float = 15.0
    aside_m: float = 0.0
    motion: str = "standing"
    speed_m_s: float = 1.5
    label: str = "car"
    knowledge: ClassVar[str] = "poses"

    def __post_init__(self) -> None:
        super().__post_init__()
        require_finite_number(ahead_m=self.ahead_m, aside_m=self.aside_m, speed_m_s=self.speed_m_s)
        require_choice("motion", self.motion, MOTIONS)
        require_choice("label", self.label, SIZES_M)
        if self.motion == "crossing" and self.speed_m_s <= 0:
            raise InvalidValueError(f"speed_m_s must be > 0 for a crossing object, got {self.speed_m_s!r}")
        self._victim: str | None = self.against
        self._world_SE3_start: SE3 | None = None
        self._begun_s, self._id = 0.0, -1

    def placed(self, view: AttackerView) -> tuple[int, Boxes3D, Floats] | None:
        """Return the object's number, its box in the attacker's base frame and its velocity (1, 2) there.

        None: nothing was heard of the victim yet, or there is no place for it.
        """
        victim = view.victim(self._victim)
        if victim is None:
            return None
        self._victim = victim.name
        length, width, height = SIZES_M[self.label]
        moving = self._motion(view, victim)
        if moving is None:
            return None
        world_SE3_object, velocity = moving
        lifted = world_SE3_object.translation + np.array([0.0, 0.0, height / 2])
        row = np.array([[*lifted, length, width, height, world_SE3_object.yaw]])
        base_SE3_world = view.world_SE3_base.inverse()
        return self._id, Boxes3D.from_array(row).transform(base_SE3_world), base_SE3_world.rotate_planar(velocity[None])

    def begin_at(self, view: AttackerView, victim: Victim) -> SE3 | None:
        """Return the place, in the world frame, at which the object appears; None: there is none now."""
        return victim.world_SE3_base.compose(self._start(_ASIDE_M))

    def _motion(self, view: AttackerView, victim: Victim) -> tuple[SE3, Floats] | None:
        """Return the object's place on the ground and its velocity (2,), in the world frame; None: it is nowhere."""
        if self.motion == "along":
            self._id = max(self._id, 0)
            return victim.world_SE3_base.compose(self._start(0.0)), victim.velocity
        if self._world_SE3_start is None or self._is_over(view, victim):
            start = self.begin_at(view, victim)
            if start is None:
                return None
            self._world_SE3_start = start
            self._begun_s, self._id = view.time_s, self._id + 1
        start = self._world_SE3_start
        if self.motion == "standing":
            return start, np.zeros(2)
        velocity = self.speed_m_s * start.rotation[:2, 0]
        moved = start.translation + np.append(velocity, 0.0) * (view.time_s - self._begun_s)
        return SE3(start.rotation, moved), velocity

    def _start(self, right_m: float) -> SE3:
        """Return the object's place in the victim's base frame; a crossing one begins `right_m` to the right."""
        if self.motion != "crossing":
            return SE3.from_xyz_yaw(np.array([self.ahead_m, self.aside_m, 0.0]), 0.0)
        return SE3.from_xyz_yaw(np.array([self.ahead_m, self.aside_m - right_m, 0.0]), math.pi / 2)

    def _is_over(self, view: AttackerView, victim: Victim) -> bool:
        """Return whether the victim is past a standing object, or a crossing one is on the other side."""
        assert self._world_SE3_start is not None
        if self.motion == "crossing":
            return (view.time_s - self._begun_s) * self.speed_m_s > 2 * _ASIDE_M
        ahead = victim.world_SE3_base.inverse().apply(self._world_SE3_start.translation)
        return float(ahead[0]) < -_PAST_M


_ASIDE_M = 10.0
"""Distance from the victim's path at which a crossing object begins and ends: beyond two lanes and a pavement."""

_PAST_M = 10.0
"""Distance behind the victim at which a standing object has served."""


_OWN_BODY_M, _HIDES_FROM_M, _BEHIND_M = 3.0, 3.0, 0.5
"""Distance from the victim of what is not the victim itself; length from which an object hides a car; and the gap
behind it. A car is hidden by what is as large as itself."""


@ATTACKS.register("ghost")
@dataclass(kw_only=True)
class Ghost(PlacedClaim):
    """Report an object that is not there, as Zhang et al. (USENIX Security 2024) spoof in late fusion.

    It knows the poses in the messages that it hears, and costs the bytes of one object a message.

    Attributes:
        score: confidence of the detection or track.
        knows: "nothing", or "visibility": the attacker knows that receivers compare claims with what they see to be
            free. So a standing ghost is put behind an object that the attacker detects, where the victim cannot look.
    """

    score: float = 0.9
    knows: str = "nothing"

    def __post_init__(self) -> None:
        super().__post_init__()
        require_probability(score=self.score)
        require_choice("knows", self.knows, ("nothing", "visibility"))
        if self.knows != "nothing" and self.motion != "standing":
            raise InvalidValueError(f"knows must be 'nothing' for a ghost that moves, got {self.knows!r}")

    def begin_at(self, view: AttackerView, victim: Victim) -> SE3 | None:
        wanted = super().begin_at(view, victim)
        if self.knows == "nothing" or wanted is None:
            return wanted
        objects = view.observation.detections.boxes.transform(view.world_SE3_base)
        eye = victim.world_SE3_base.translation[:2]
        toward = objects.center[:, :2] - eye
        far_m = np.hypot(*toward.T)
        usable = np.flatnonzero((far_m > _OWN_BODY_M) & (objects.size[:, 0] > _HIDES_FROM_M))
        if not len(usable):
            return None
        # Behind the middle by half of both lengths, whichever way they face, and a little.
        behind_m = (objects.size[usable, 0] + SIZES_M[self.label][0]) / 2 + _BEHIND_M
        places = eye + toward[usable] * (1 + behind_m / far_m[usable])[:, None]
        best = int(np.argmin(np.hypot(*(places - wanted.translation[:2]).T)))
        ground_m = objects.bottom[usable[best]]
        return SE3.from_xyz_yaw(np.append(places[best], ground_m), wanted.yaw)

    def detect(self, view: AttackerView, detections: Detections) -> Detections:
        claims = self._claims(view)
        return detections if claims is None else claims.among_detections(detections, view.rng)

    def track(self, view: AttackerView, tracks: TrackEstimates) -> TrackEstimates:
        claims = self._claims(view)
        return tracks if claims is None else claims.among_tracks(tracks, view.rng)

    def _claims(self, view: AttackerView) -> Claims | None:
        placed = self.placed(view)
        if placed is None:
            return None
        number, boxes, velocity = placed
        ids = np.array([number])
        view.claim(ids, boxes)
        label = np.array([int(ObjectClass[self.label.upper()])])
        return Claims(ids, boxes, velocity, np.array([self.score]), label)
