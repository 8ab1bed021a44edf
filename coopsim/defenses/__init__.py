"""Defences: from what a receiver has and is told to its trust in each sender.

In: a `Reception`, which holds the receiver's own observation and the messages as claims. Out: `Trust`. The interface,
and the guard that asks the defences for a policy, are in `coopsim.interfaces`. Importing this package registers all.
"""

from coopsim.defenses import consistency, made, mate, oracle, plausibility, robosac, witness
from coopsim.interfaces.defense import DEFENSES, LEAST_TRUST, Claim, Defense, Reception, Trust, make_defense
from coopsim.support.moved import moved

__all__ = [
    "DEFENSES",
    "LEAST_TRUST",
    "Claim",
    "Defense",
    "Reception",
    "Trust",
    "consistency",
    "made",
    "make_defense",
    "mate",
    "oracle",
    "plausibility",
    "robosac",
    "witness",
]

moved(f"{__name__}.defense", "coopsim.interfaces.defense")
