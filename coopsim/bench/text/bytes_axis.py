"""The axis of bytes in figures: logarithmic, with a place of its own for nothing sent."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

_UNITS = ("", " k", " M", " G", " T")


def place_bytes(panel: Any, rates: Sequence[float], after: float = 0.3) -> list[float]:
    """Make the horizontal axis of a panel one of bytes per second, and return where each of `rates` stands on it.

    A policy that sends nothing stands on the left, apart from the logarithmic scale. `after` is the room to the right
    of the last tick, in decades.
    """
    sent = [rate for rate in rates if rate > 0]
    first, last = (math.floor(math.log10(min(sent))), math.ceil(math.log10(max(sent)))) if sent else (0, 1)
    silent = 10.0 ** (first - 0.5)
    panel.set_xscale("log")
    ticks = {10.0**power: _word(power) for power in range(first, last + 1)}
    if len(sent) < len(rates):
        panel.axvline(10.0 ** (first - 0.15), color="0.8", lw=0.8)
        ticks = {silent: "0", **ticks}
    panel.set_xlim(10.0 ** (first - 1), 10.0 ** (last + after))
    panel.set_xticks(list(ticks), list(ticks.values()))
    panel.set_xticks([], minor=True)
    return [rate or silent for rate in rates]


def _word(power: int) -> str:
    """Return a power of ten as people write it, as "10 k"; matplotlib's own labels are formulas."""
    unit = min(max(power // 3, 0), len(_UNITS) - 1)
    return f"{10.0 ** (power - 3 * unit):g}{_UNITS[unit]}"
