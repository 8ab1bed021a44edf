"""Content of messages about junctions with lights: their geometry, and the phases of their lights."""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import IntEnum
from typing import Literal

import numpy as np

from coopsim.geometry.se3 import Floats
from coopsim.support.arrays import freeze
from coopsim.types.units import Ints

HOUR_DS = 36_000
"""Tenths of a second in an hour. As a time mark it stands for more than an hour from now."""

UNKNOWN_MARK = HOUR_DS + 1
"""The time mark of a change at an unknown time."""

_PAST_DS = 600  # marks of the last minute are past: messages are late by seconds


class MovementPhase(IntEnum):
    """State of a signal group, numbered as `MovementPhaseState` of ISO/TS 19091."""

    UNAVAILABLE = 0
    DARK = 1
    STOP_THEN_PROCEED = 2
    RED = 3
    RED_AND_YELLOW = 4
    GREEN_GIVE_WAY = 5
    GREEN = 6
    YELLOW_AFTER_GIVE_WAY = 7
    YELLOW = 8
    CAUTION = 9


@dataclass(frozen=True, slots=True, eq=False)
class SignalPhases:
    """Phases of the G signal groups of a junction at a moment.

    Attributes:
        intersection: the junction's id, in [0, 65535].
        time_ns: the moment, since the episode's start, in whole milliseconds.
        group: (G,) ids in [1, 255], of lights that always show the same.
        phase: (G,) `MovementPhase` now.
        earliest_ds: (G,) earliest time at which it changes: tenths of a second of the hour, or `HOUR_DS` or
            `UNKNOWN_MARK`.
        likely_ds: (G,) likely time at which it changes, alike.
        revision: number of the junction's `IntersectionMap`, in [0, 127].
    """

    intersection: int
    time_ns: int
    group: Ints
    phase: Ints
    earliest_ds: Ints
    likely_ds: Ints
    revision: int = 0

    def __post_init__(self) -> None:
        count = len(self.group)
        freeze(self, **dict.fromkeys(("group", "phase", "earliest_ds", "likely_ds"), ((count,), np.int64)))

    def left_s(self, time_ns: int) -> Floats:
        """Return the times (G,) s from a moment to the likely changes.

        It is 0 for a change that is past, infinite if more than an hour away, NaN if unknown.
        """
        left = (self.likely_ds - time_ns / 1e8) % HOUR_DS
        left = np.where(left > HOUR_DS - _PAST_DS, 0.0, left / 10)
        left = np.where(self.likely_ds == HOUR_DS, np.inf, left)
        return np.where(self.likely_ds == UNKNOWN_MARK, np.nan, left)


@dataclass(frozen=True, slots=True, eq=False)
class MapLane:
    """Lane at a junction.

    Attributes:
        id: in [0, 255].
        kind: "vehicle", "crosswalk" or "other".
        points: (K, 2) m along its middle, to the east and north of the junction's reference point; the first is next to
            the junction, for an approach the stop line.
        approaches: it leads to the junction.
        leaves: it leads away from the junction. A crosswalk has both.
        connections: pairs of a lane that one may go on to, and the signal group that decides when.
    """

    id: int
    kind: Literal["vehicle", "crosswalk", "other"]
    points: Floats
    approaches: bool
    leaves: bool
    connections: tuple[tuple[int, int | None], ...] = ()

    def __post_init__(self) -> None:
        freeze(self, points=((None, 2), np.float64))


@dataclass(frozen=True, slots=True, eq=False)
class IntersectionMap:
    """Geometry of a junction with lights.

    Attributes:
        intersection: its id, in [0, 65535].
        reference: (3,) m in the world frame.
        lanes: lanes that lead to it and away from it, and crosswalks with lights.
        lane_width_m: usual width of its lanes; None: unknown.
        revision: in [0, 127].
    """

    intersection: int
    reference: Floats
    lanes: tuple[MapLane, ...] = field(default=())
    lane_width_m: float | None = None
    revision: int = 0

    def __post_init__(self) -> None:
        freeze(self, reference=((3,), np.float64))
