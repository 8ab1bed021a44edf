"""Intents: the way that a road user plans to go, what it says of a hard brake, and what a planner knows of both."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from coopsim.geometry.se3 import Floats
from coopsim.support.arrays import freeze
from coopsim.types.units import Ints, Mask


@dataclass(frozen=True, slots=True, eq=False)
class PlannedPath:
    """Content of a message about a road user's planned way.

    Attributes:
        station: the sender's number, in [0, 2^32 - 1].
        time_ns: time at which it was made. A message has it modulo 65.536 s, see `latest_ns`.
        position: (3,) m, of the sender's middle in the world frame.
        points: (K, 2) m, its middle from now on, from `position` to the east and north.
        heading_rad: (K,) headings there, counter-clockwise from the east.
        speed_m_s: (K,) speeds there.
        first_s: time from `time_ns` to the first point.
        step_s: time from each point to the next.
        length_m: length of its body; NaN: unknown.
        width_m: width of its body; NaN: unknown.
    """

    station: int
    time_ns: int
    position: Floats
    points: Floats
    heading_rad: Floats
    speed_m_s: Floats
    first_s: float
    step_s: float
    length_m: float
    width_m: float

    def __post_init__(self) -> None:
        count = len(self.points)
        columns = dict.fromkeys(("heading_rad", "speed_m_s"), ((count,), np.float64))
        freeze(self, position=((3,), np.float64), points=((count, 2), np.float64), **columns)


@dataclass(frozen=True, slots=True, eq=False)
class HardBrake:
    """Content of a warning of a road user that brakes hard.

    Attributes:
        station: the sender's number, in [0, 2^32 - 1].
        number: number of the brake among those of its sender, in [0, 65535].
        began_ns: time at which the brake began.
        time_ns: time at which the message was made.
        position: (3,) m, of the sender in the world frame.
        heading_rad: its heading, counter-clockwise from the east.
        speed_m_s: its speed.
    """

    station: int
    number: int
    began_ns: int
    time_ns: int
    position: Floats
    heading_rad: float
    speed_m_s: float

    def __post_init__(self) -> None:
        freeze(self, position=((3,), np.float64))


STEP_S, AHEAD_S = 0.2, 4.0
"""Time between the places of `Intents`, and from a message to the last of them."""


@dataclass(frozen=True, slots=True, eq=False)
class Intents:
    """Ways of M road users as they have told them, in the base frame of the car that got their messages.

    Attributes:
        station: (M,) numbers of the senders, distinct.
        age_s: (M,) time since each was told.
        places: (M, K, 3) middle, m, and heading, rad, without jumps; every `STEP_S` from the moment of the message on.
        speed_m_s: (M,) speeds now, by what was told.
        length_m: (M,) length of the bodies; NaN: unknown.
        width_m: (M,) width of the bodies; NaN: unknown.
        hard_brake: (M,) flags of those that warn of a hard brake.
    """

    station: Ints
    age_s: Floats
    places: Floats
    speed_m_s: Floats
    length_m: Floats
    width_m: Floats
    hard_brake: Mask

    def __post_init__(self) -> None:
        count, steps = self.places.shape[:2]
        columns = dict.fromkeys(("age_s", "speed_m_s", "length_m", "width_m"), ((count,), np.float64))
        flags = {"station": ((count,), np.int64), "hard_brake": ((count,), np.bool_)}
        freeze(self, places=((count, steps, 3), np.float64), **columns, **flags)

    @classmethod
    def empty(cls) -> Intents:
        """Return the intents of nobody."""
        none = np.zeros(0)
        return cls(np.zeros(0, np.int64), none, np.zeros((0, 2, 3)), none, none, none, np.zeros(0, np.bool_))

    def __len__(self) -> int:
        return len(self.station)

    def at(self, times_s: Floats) -> Floats:
        """Return middle, m, and heading, rad, (T, M, 3) at times (T,) from now; beyond the last place they stay."""
        last = self.places.shape[1] - 1
        step = np.clip((times_s[:, None] + self.age_s) / STEP_S, 0.0, last)
        before = np.minimum(step.astype(np.int64), max(last - 1, 0))
        rows, share = np.arange(len(self)), (step - before)[..., None]
        found: Floats = (1 - share) * self.places[rows, before] + share * self.places[
            rows, np.minimum(before + 1, last)
        ]
        return found
