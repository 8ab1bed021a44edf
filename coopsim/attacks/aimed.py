"""The base of attacks that aim at a planner: an attack is a class with `plan(victim)`."""

from __future__ import annotations

import math
from abc import abstractmethod
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from coopsim.attacks.claims import Claims, with_boxes
from coopsim.attacks.objects import UNNUMBERED
from coopsim.attacks.victim_plan import VictimPlan
from coopsim.geometry.boxes import Boxes3D, covers
from coopsim.geometry.se3 import Floats
from coopsim.interfaces.attack import Attack, AttackerView, Victim
from coopsim.tracking.ab3dmot_tracker import ab3dmot
from coopsim.types import Detections, Ints
from coopsim.types.driving import NOBODY_FIRST, Route
from coopsim.types.track_estimates import TrackEstimates
from coopsim.types.valid_detections import drop_unreportable

_SAME_M = 2.0
"""Largest distance of one object in two frames, and in two agents' messages."""

_STRAIGHT_M, _USUAL_LIMIT_M_S = 60.0, 13.9
"""Length of the way ahead where no map has one, and the limit there: that of towns."""


@dataclass(kw_only=True)
class AimedAttack(Attack):
    """An attack that is asked in each frame what to say to one driven car: override `plan`.

    It hears what others send, sees what its own sensors see, knows the map, and can try what it would say on a copy of
    the planner, see `VictimPlan`. Where others truly are it is never told.
    """

    knowledge: ClassVar[str] = "boxes"

    def __post_init__(self) -> None:
        super().__post_init__()
        self._tracker, self._known, self._next_id = ab3dmot(), np.zeros((0, 3)), 0

    @abstractmethod
    def plan(self, victim: VictimPlan) -> None:
        """Decide on the lies of a frame by `victim.move`, `hide` and `claim`; they are noted by themselves."""

    def detect(self, view: AttackerView, detections: Detections) -> Detections:
        found = drop_unreportable(detections)
        victim = self._victim_plan(view, found, self._velocity(view, found))
        if victim is None or victim.lines.are_honest:
            return detections
        boxes, kept, claims = self._said(view, victim, found.boxes)
        velocity = found.velocity
        if velocity is not None:
            velocity = velocity + victim.liar_SE3_base.rotate_planar(victim.lines.speed)
        honest = replace(found, boxes=boxes, velocity=velocity, score=_scores(found.score, victim))[kept]
        return honest if claims is None else claims.among_detections(honest, view.rng)

    def track(self, view: AttackerView, tracks: TrackEstimates) -> TrackEstimates:
        found = tracks.tracks
        victim = self._victim_plan(view, Detections(found.boxes, found.score, found.label), found.velocity)
        if victim is None or victim.lines.are_honest:
            return tracks
        boxes, kept, claims = self._said(view, victim, found.boxes)
        speed = found.velocity + victim.liar_SE3_base.rotate_planar(victim.lines.speed)
        moved = with_boxes(tracks, boxes, speed)
        honest = replace(moved, tracks=replace(moved.tracks, score=_scores(found.score, victim)))[kept]
        return honest if claims is None else claims.among_tracks(honest, view.rng)

    def _velocity(self, view: AttackerView, found: Detections) -> Floats:
        """Return velocities (N, 2) m/s of objects, in the attacker's base frame, by a tracker of its own."""
        placed = found.transform(view.world_SE3_base)
        self._tracker.step(placed, view.observation.time_ns)
        velocity, _ = self._tracker.known(placed, view.observation.time_ns)
        return view.world_SE3_base.inverse().rotate_planar(np.nan_to_num(velocity))

    def _victim_plan(self, view: AttackerView, found: Detections, velocity: Floats) -> VictimPlan | None:
        """Return the victim with objects found in the attacker's base frame, as planned against; None: none is heard.

        The victim itself stays among the objects as a row with the number -1, so that rows are those of the message.
        """
        ids = self._numbered(view, found.boxes)
        heard = view.victim(self.against)
        if heard is None:
            return None
        victim_SE3_base = heard.world_SE3_base.inverse().compose(view.world_SE3_base)
        placed = found.transform(victim_SE3_base)
        victim_SE3_world = heard.world_SE3_base.inverse()
        others = {name: view.objects_of(name).transform(victim_SE3_world) for name in sorted(view.heard)}
        victim = VictimPlan(
            name=heard.name,
            time_ns=view.observation.time_ns,
            dt_s=view.spec.dt_s,
            speed_m_s=float(np.hypot(*heard.velocity)),
            route=_way_ahead(view, heard),
            objects=placed,
            id=np.where(covers(placed.boxes, np.zeros(2)), -1, ids),
            velocity=victim_SE3_base.rotate_planar(velocity),
            heard=_heard(placed.boxes, others),
            others=others,
            planner=view.facts.planner,
            liar_SE3_base=victim_SE3_base.inverse(),
            world_SE3_base=heard.world_SE3_base,
            rng=view.rng,
        )
        self.plan(victim)
        return victim

    def _numbered(self, view: AttackerView, boxes: Boxes3D) -> Ints:
        """Return a number (N,) for each object, that of the nearest one in the frame before."""
        place = view.world_SE3_base.apply(boxes.center)[:, :2]
        ids = np.arange(self._next_id, self._next_id + len(place))
        self._next_id += len(place)
        if len(place) and len(self._known):
            apart_m = np.hypot(*(place[:, None] - self._known[None, :, :2]).transpose(2, 0, 1))
            nearest = apart_m.argmin(axis=1)
            mutual = apart_m.argmin(axis=0)[nearest] == np.arange(len(place))
            same = mutual & (apart_m[np.arange(len(place)), nearest] <= _SAME_M)
            ids[same] = self._known[nearest[same], 2].astype(np.int64)
        self._known = np.column_stack([place, ids])
        return ids

    def _said(self, view: AttackerView, victim: VictimPlan, honest: Boxes3D) -> tuple[Boxes3D, Ints, Claims | None]:
        """Return all objects as the message has them, the rows that it keeps, and what it claims besides.

        All are in the attacker's base frame. Notes the lies.
        """
        lines, rows = victim.lines, honest.array.copy()
        moved, hidden = lines.by_m.any(axis=1) & ~lines.hidden, lines.hidden
        rows[moved, :2] += victim.liar_SE3_base.rotate_planar(lines.by_m[moved])
        boxes = Boxes3D.from_array(rows)
        view.deny(honest[moved | hidden])
        view.claim(np.full(int(moved.sum()), UNNUMBERED), boxes[moved])
        if not lines.added:
            return boxes, np.flatnonzero(~hidden), None
        ids, added, speeds, labels, scores = map(np.array, zip(*lines.added, strict=True))
        claimed = Boxes3D.from_array(added).transform(victim.liar_SE3_base)
        view.claim(ids, claimed)
        speeds = victim.liar_SE3_base.rotate_planar(speeds)
        return boxes, np.flatnonzero(~hidden), Claims(ids, claimed, speeds, scores, labels)


def _scores(honest: Floats, victim: VictimPlan) -> Floats:
    """Return the scores (N,) of objects as stated."""
    return np.where(np.isnan(victim.lines.score), honest, victim.lines.score)


def _way_ahead(view: AttackerView, victim: Victim) -> Route:
    found = view.facts.way_ahead(victim.world_SE3_base)
    if found is not None:
        return found
    points = np.column_stack([np.arange(0.0, _STRAIGHT_M), np.zeros(math.ceil(_STRAIGHT_M))])
    limits, rights = np.full(len(points), _USUAL_LIMIT_M_S), np.full(len(points), NOBODY_FIRST)
    return Route(points, 1.0, limits, rights)


def _heard(boxes: Boxes3D, others: dict[str, Boxes3D]) -> Ints:
    """Return the number (N,) of others who said that an object is near each box."""
    count = np.zeros(len(boxes), np.int64)
    for said in others.values():
        apart_m = np.linalg.norm(boxes.center[:, None, :2] - said.center[None, :, :2], axis=2)
        count += apart_m.min(axis=1, initial=np.inf) <= _SAME_M
    return count
