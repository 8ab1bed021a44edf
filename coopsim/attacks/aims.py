"""The seam of attacks by gradients: what of a message may change, and what the receivers' network makes of it."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import Any, Generic, TypeVar

import numpy as np
from numpy.typing import NDArray

from coopsim.geometry.boxes import Boxes3D
from coopsim.geometry.se3 import Floats
from coopsim.types import Mask
from coopsim.types.taxonomy import ObjectClass

Values = NDArray[np.float32]
T = TypeVar("T", covariant=True)

REMOVED_WITHIN_M = 20.0
"""Distance from the target within which objects are removed: about two lanes and four lengths of a car."""


@dataclass(frozen=True, slots=True, eq=False)
class Goal:
    """Wish of an attacker in a frame.

    Attributes:
        spoof: True: receivers shall see an object at `box`; False: none around it.
        box: one box in the attacker's base frame.
        velocity: (1, 2) m/s over ground, in the axes of that frame.
        label: class of a spoofed object.
        window_m: half the edge of the square around a target in which numbers of a map are changed.
    """

    spoof: bool
    box: Boxes3D
    velocity: Floats
    label: ObjectClass
    window_m: float

    def removed(self, boxes: Boxes3D) -> Mask:
        """Return which boxes (N,) in the attacker's base frame are to be removed."""
        near: Mask = np.hypot(*(boxes.center[:, :2] - self.box.center[0, :2]).T) <= REMOVED_WITHIN_M
        return near


class Aim(ABC, Generic[T]):
    """A message under attack. The network scores N places of it, the cells of a map or the queries.

    Attributes:
        goal: the attacker's wish.
        boxes: objects that the message claims or denies, in the attacker's base frame.
        mask: numbers that may change, of a shape that broadcasts to that of a change.
        target: (N) the places whose scores are to rise or fall; a map's N is its height and width.
        others: (N) the places whose scores an attacker with the knowledge "agreement" leaves as they were.
    """

    goal: Goal
    boxes: Boxes3D
    mask: Mask
    target: Mask
    others: Mask

    @abstractmethod
    def start(self, last: Any) -> Values:
        """Return the change to begin with: zeros, or what `memory` kept of the `last` frame where it is still there."""

    @abstractmethod
    def memory(self, change: Values) -> Any:
        """Return what the next frame needs of a change."""

    @abstractmethod
    def seen(self, change: Any) -> tuple[Any, Any]:
        """Return the logits of classes (9, N) that the network gives the message, and how far its objects then lie
        beside a spoofed target (m). A metre counts as a logit: a choice of ours. Both have gradients.
        """

    @abstractmethod
    def changed(self, change: Values) -> T:
        """Return the content with a change."""
