"""The learning rate of every step."""

from __future__ import annotations

import math


def one_cycle(step: int, steps: int, highest: float, rising: float = 0.3) -> float:
    """Return the learning rate of a step: half cosines from highest/25 up to `highest`, and down to highest/10,000.

    Source: Smith and Topin 2019, "Super-convergence", with cosines in place of straight lines.

    Args:
        step: from 0.
        steps: of the whole training.
        highest: learning rate.
        rising: share of the steps in which it rises.
    """
    turn = max(1.0, rising * steps)
    if step < turn:
        return _between(highest / 25, highest, step / turn)
    return _between(highest, highest / 1e4, (step - turn) / max(1.0, steps - 1 - turn))


def _between(first: float, last: float, share: float) -> float:
    return last + (first - last) * 0.5 * (1 + math.cos(math.pi * min(1.0, share)))
