"""Lies: the record of what attackers put into their messages, for metrics and pictures."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field

import numpy as np

from coopsim.geometry.boxes import Boxes3D
from coopsim.types.units import Ints


@dataclass(frozen=True, slots=True, eq=False)
class Lie:
    """The lies of one attack of one agent in one frame. No policy, defence or detector is ever given one.

    Attributes:
        time_ns: time of the frame.
        agent: the attacker's name.
        attack: the attack's registered name.
        senders: names that the lying messages of this frame bear: the agent's own, or made-up ones.
        id: (N,) number of each claimed object, constant over its life; unique among the attack's objects.
        claimed: N boxes in the world frame, where receivers would place them by the stated pose: objects that are
            not there.
        denied: M boxes in the world frame: objects that the agent knows of, and does not report where they are.
        against: name of the receiver that is meant; None: all.
        stated_m: x and y in the world frame where the agent's message says that it is; None: unknown.
    """

    time_ns: int
    agent: str
    attack: str
    senders: tuple[str, ...] = ()
    id: Ints = field(default_factory=lambda: np.zeros(0, np.int64))
    claimed: Boxes3D = field(default_factory=Boxes3D.empty)
    denied: Boxes3D = field(default_factory=Boxes3D.empty)
    against: str | None = None
    stated_m: tuple[float, float] | None = None


def lying_senders(lies: Iterable[Lie]) -> set[str]:
    """Return the names that the messages of these lies bear."""
    return {sender for lie in lies for sender in lie.senders}
