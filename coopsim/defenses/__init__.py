"""Defences: from what a receiver has and is told to its trust in each sender.

In: a `Reception`, which holds the receiver's own observation and the messages as claims. Out: `Trust`. Start reading at
`defense.py`, the seam; `guard.py` asks the defences for a policy. Importing this package registers all defences.
"""

from coopsim.defenses import consistency, made, mate, oracle, plausibility, robosac
from coopsim.defenses.defense import DEFENSES, LEAST_TRUST, Claim, Defense, Reception, Trust, make_defense

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
]
