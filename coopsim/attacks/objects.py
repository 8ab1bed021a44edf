"""Attacks on the objects that an agent does detect: `remove`, `shift`, `relabel`, `resize` and `speed`."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any, ClassVar

import numpy as np

from coopsim.attacks.claims import with_boxes
from coopsim.geometry.boxes import Boxes3D
from coopsim.geometry.se3 import Floats
from coopsim.interfaces.attack import ATTACKS, Attack, AttackerView
from coopsim.support.checks import require_choice, require_finite_number, require_number, require_positive
from coopsim.types import Detections, Mask
from coopsim.types.taxonomy import ObjectClass
from coopsim.types.track_estimates import TrackEstimates

UNNUMBERED = -1
"""Number of claimed objects that have none of their own: those that an attacker moves."""


@dataclass(kw_only=True)
class ObjectLie(Attack):
    """A lie about objects that the agent detects or tracks. It costs no bytes.

    Attributes:
        within_m: largest distance of these objects from the victim, by the poses in messages; inf: all objects, for
            which nothing need be known of anybody.
    """

    within_m: float = math.inf
    knowledge: ClassVar[str] = "poses"

    def __post_init__(self) -> None:
        super().__post_init__()
        require_number("> 0 (inf: all objects)", lambda far: far > 0, within_m=self.within_m)

    def chosen(self, view: AttackerView, boxes: Boxes3D) -> Mask:
        """Return the mask (N,) of objects in the attacker's base frame that it lies about."""
        if math.isinf(self.within_m):
            return np.ones(len(boxes), np.bool_)
        victim = view.victim(self.against)
        if victim is None:
            return np.zeros(len(boxes), np.bool_)
        place = view.world_SE3_base.inverse().apply(victim.world_SE3_base.translation)
        near: Mask = np.hypot(*(boxes.center[:, :2] - place[:2]).T) <= self.within_m
        return near


@ATTACKS.register("remove")
@dataclass(kw_only=True)
class Remove(ObjectLie):
    """Leave objects out, as Zhang et al. (USENIX Security 2024) do in late fusion."""

    def detect(self, view: AttackerView, detections: Detections) -> Detections:
        return detections[self._kept(view, detections.boxes)]

    def track(self, view: AttackerView, tracks: TrackEstimates) -> TrackEstimates:
        return tracks[self._kept(view, tracks.tracks.boxes)]

    def _kept(self, view: AttackerView, boxes: Boxes3D) -> Mask:
        chosen = self.chosen(view, boxes)
        if chosen.any():
            view.deny(boxes[chosen])
        return ~chosen


@dataclass(kw_only=True)
class _ChangedBoxes(ObjectLie):
    def changed(self, boxes: Boxes3D) -> Boxes3D:
        """Return the boxes as the attacker reports them."""
        raise NotImplementedError

    def detect(self, view: AttackerView, detections: Detections) -> Detections:
        return replace(detections, boxes=self._lied(view, detections.boxes))

    def track(self, view: AttackerView, tracks: TrackEstimates) -> TrackEstimates:
        return with_boxes(tracks, self._lied(view, tracks.tracks.boxes))

    def _lied(self, view: AttackerView, boxes: Boxes3D) -> Boxes3D:
        chosen = self.chosen(view, boxes)
        if not chosen.any():
            return boxes
        rows = boxes.array.copy()
        changed = self.changed(boxes[chosen])
        rows[chosen] = changed.array
        view.deny(boxes[chosen])
        view.claim(np.full(len(changed), UNNUMBERED), changed)
        return Boxes3D.from_array(rows)


@ATTACKS.register("shift")
@dataclass(kw_only=True)
class Shift(_ChangedBoxes):
    """Report objects beside their places.

    Attributes:
        along_m: distance forward, in each object's own axes.
        aside_m: distance to its left.
    """

    along_m: float = 0.0
    aside_m: float = 3.0

    def __post_init__(self) -> None:
        super().__post_init__()
        require_finite_number(along_m=self.along_m, aside_m=self.aside_m)

    def changed(self, boxes: Boxes3D) -> Boxes3D:
        cos, sin = np.cos(boxes.yaw), np.sin(boxes.yaw)
        x, y = cos * self.along_m - sin * self.aside_m, sin * self.along_m + cos * self.aside_m
        return Boxes3D(boxes.center + np.column_stack([x, y, np.zeros(len(boxes))]), boxes.size, boxes.yaw)


@ATTACKS.register("resize")
@dataclass(kw_only=True)
class Resize(_ChangedBoxes):
    """Report objects of another length, width and height; their undersides stay where they are.

    Attributes:
        factor: factor on the size.
    """

    factor: float = 2.0

    def __post_init__(self) -> None:
        super().__post_init__()
        require_positive(factor=self.factor)

    def changed(self, boxes: Boxes3D) -> Boxes3D:
        size = boxes.size * self.factor
        raised = (size[:, 2] - boxes.size[:, 2]) / 2
        return Boxes3D(boxes.center + np.column_stack([0 * raised, 0 * raised, raised]), size, boxes.yaw)


@ATTACKS.register("relabel")
@dataclass(kw_only=True)
class Relabel(ObjectLie):
    """Report objects as another class.

    Attributes:
        label: the class, in lower case, such as "pedestrian".
    """

    label: str = "pedestrian"

    def __post_init__(self) -> None:
        super().__post_init__()
        require_choice("label", self.label, [each.title for each in ObjectClass])

    def detect(self, view: AttackerView, detections: Detections) -> Detections:
        return replace(detections, label=self._lied(view, detections))

    def track(self, view: AttackerView, tracks: TrackEstimates) -> TrackEstimates:
        return replace(tracks, tracks=replace(tracks.tracks, label=self._lied(view, tracks.tracks)))

    def _lied(self, view: AttackerView, rows: Any) -> Any:
        chosen = self.chosen(view, rows.boxes)
        if chosen.any():
            view.lie()
        return np.where(chosen, int(ObjectClass[self.label.upper()]), rows.label)


@ATTACKS.register("speed")
@dataclass(kw_only=True)
class Speed(ObjectLie):
    """Report other speeds of objects; detections have some only if the uplink sends velocities.

    Attributes:
        factor: factor on the velocity: 0 lets all stand, -1 lets them drive back.
        offset_m_s: speed added along each object's axis.
    """

    factor: float = 0.0
    offset_m_s: float = 0.0

    def __post_init__(self) -> None:
        super().__post_init__()
        require_finite_number(factor=self.factor, offset_m_s=self.offset_m_s)

    def detect(self, view: AttackerView, detections: Detections) -> Detections:
        if detections.velocity is None:
            return detections
        return replace(detections, velocity=self._lied(view, detections.boxes, detections.velocity))

    def track(self, view: AttackerView, tracks: TrackEstimates) -> TrackEstimates:
        boxes = tracks.tracks.boxes
        return with_boxes(tracks, boxes, self._lied(view, boxes, tracks.tracks.velocity))

    def _lied(self, view: AttackerView, boxes: Boxes3D, velocity: Floats) -> Floats:
        chosen = self.chosen(view, boxes)
        if chosen.any():
            view.lie()
        ahead = np.column_stack([np.cos(boxes.yaw), np.sin(boxes.yaw)])
        return np.where(chosen[:, None], self.factor * velocity + self.offset_m_s * ahead, velocity)
