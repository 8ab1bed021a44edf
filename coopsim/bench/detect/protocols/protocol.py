"""The interface of a protocol: which boxes count, how they are matched, and how the ranking becomes a number."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from typing import ClassVar

import numpy as np

from coopsim.bench.detect.ranking.overlaps import Overlaps
from coopsim.bench.detect.ranking.ranking import Ranking
from coopsim.support.registry import Registry
from coopsim.types import Ints, Mask, ObjectClass

VEHICLES = (ObjectClass.CAR, ObjectClass.VAN, ObjectClass.TRUCK, ObjectClass.BUS)
PEOPLE = (ObjectClass.PEDESTRIAN, ObjectClass.CHILD)
RIDERS = (ObjectClass.MOTORCYCLE, ObjectClass.BICYCLE, ObjectClass.SCOOTER)
"""A rider and the ridden vehicle are one object here. Motorcycles are no vehicles, as in V2X-Real's superclasses."""


class Protocol(ABC):
    """A way of computing average precision, as some benchmark does it.

    It is in two steps, so that episodes can be pooled and resampled without matching them again.

    Attributes:
        ranks_frames_together: the detections of all frames are ranked together, not frame after frame.
    """

    ranks_frames_together: ClassVar[bool] = True

    @abstractmethod
    def rankings(self, overlaps: Overlaps) -> dict[str, Ranking]:
        """Match one episode. Return the ranking behind each metric; of every episode the same names."""

    @abstractmethod
    def values(self, rankings: Mapping[str, Ranking]) -> dict[str, float]:
        """Return the metrics of the joined rankings, in [0, 1] where they are ratios; NaN where nothing was there."""


class AreaProtocol(Protocol):
    """A protocol whose metrics are areas, each of its own ranking, by one rule."""

    _area: ClassVar[str] = "area"
    """Name of the method of `Ranking`."""

    def values(self, rankings: Mapping[str, Ranking]) -> dict[str, float]:
        """Return the area of each ranking."""
        return {name: float(getattr(ranking, self._area)()) for name, ranking in rankings.items()}


PROTOCOLS: Registry[type[Protocol]] = Registry("protocol", home="coopsim.bench.detect.protocols")


def among(label: Ints, classes: tuple[ObjectClass, ...]) -> Mask:
    """Return the mask (N,) of labels that are among some classes."""
    return np.isin(label, [int(each) for each in classes])


def ranked(overlaps: Overlaps, object_of: Ints, kept: Mask, objects: int) -> Ranking:
    """Rank the detections `kept` (N,), matched as `object_of` (N,) says."""
    there = overlaps.perceived
    return Ranking.of(there.found_start, there.found_score, object_of >= 0, kept, objects)
