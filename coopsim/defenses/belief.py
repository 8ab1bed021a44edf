"""A hidden Markov model of each sender, honest or lying, for defences whose evidence comes frame by frame."""

from __future__ import annotations

from coopsim.interfaces.guard import MOST_SENDERS

PRIOR, TURNS = 0.05, 0.002
"""Chance that a sender that has not been heard lies, and that an honest one begins to lie, or a liar ends, in a frame;
ours: liars are rare, and lie for a minute at 10 Hz."""

_SUREST = 1e-4
"""Least chance of either state, so that no sender is believed or condemned for ever."""


class SenderBeliefs:
    """Forward filter of a two-state hidden Markov model for each sender (Rabiner, 1989, eq. 19-20)."""

    def __init__(self) -> None:
        self._lying: dict[str, float] = {}

    def update(self, sender: str, ratio: float) -> None:
        """Take in evidence.

        Args:
            sender: name of the sender.
            ratio: likelihood of the evidence if the sender lies, divided by that if it is honest.
        """
        before = self._lying.pop(sender, PRIOR)
        moved = before + (1 - before) * TURNS - before * TURNS
        odds = moved / (1 - moved) * ratio
        self._lying[sender] = min(max(odds / (1 + odds), _SUREST), 1 - _SUREST)
        while len(self._lying) > MOST_SENDERS:
            self._lying.pop(next(iter(self._lying)))

    def trust(self, sender: str) -> float:
        """Return the chance that a sender is honest."""
        return 1 - self._lying.get(sender, PRIOR)
