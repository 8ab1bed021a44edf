"""Stops a training whose losses are no numbers, or run away."""

from __future__ import annotations

import math
import statistics
from collections import deque
from collections.abc import Mapping

from coopsim.errors import TrainingError

_REMEMBERED = 500
_LEAST = 50
_TOO_LARGE = 9.0
_PATIENCE = 50


class LossWatch:
    """Refuses losses that are not finite, and 50 losses in a row that are far above losses before them.

    Far above is the running median and nine times the median of their magnitudes more: ten times the median of losses
    that are positive. Likelihoods may be of any sign.

    Attributes:
        kept: what is kept of the training, for the errors.
    """

    def __init__(self, kept: str) -> None:
        self.kept = kept
        self._losses: deque[float] = deque(maxlen=_REMEMBERED)
        self._high = 0

    def check(self, step: int, losses: Mapping[str, float], gradient: float) -> None:
        """Check a step before it is taken.

        Args:
            step: from 1.
            losses: by name; "loss" is the total.
            gradient: length of the gradient.

        Raises:
            TrainingError: a loss or the gradient is not finite, or losses run away.
        """
        broken = [f"{name} is {value}" for name, value in losses.items() if not math.isfinite(value)]
        if not math.isfinite(gradient):
            broken.append(f"the gradient's length is {gradient}")
        if broken:
            raise TrainingError(f"step {step}: {', '.join(broken)}; {self.kept}. A smaller lr or clip may help")
        total = losses["loss"]
        limit = self._limit()
        if total <= limit:
            self._high = 0
            self._losses.append(total)
            return
        self._high += 1
        if self._high >= _PATIENCE:
            raise TrainingError(
                f"step {step}: the loss is {total:.4g}, and since {_PATIENCE} steps above {limit:.4g}, far above its "
                f"median {statistics.median(self._losses):.4g}: it diverges; {self.kept}. A smaller lr may help"
            )

    def _limit(self) -> float:
        """Return the loss above which one is too large; infinite while few are known."""
        if len(self._losses) < _LEAST:
            return math.inf
        magnitude = statistics.median(map(abs, self._losses))
        return statistics.median(self._losses) + _TOO_LARGE * magnitude
