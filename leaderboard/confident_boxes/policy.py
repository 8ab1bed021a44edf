"""Late fusion of confident boxes: an example of an entry with code of its own."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from coopsim.agents.boxes import LateFusion
from coopsim.types import Detections


@dataclass(kw_only=True, eq=False)
class ConfidentBoxes(LateFusion):
    """Late fusion of boxes from a score on. Further parameters: `LateFusion`.

    Attributes:
        least_score: score from which a box counts.
    """

    method = "late fusion of boxes from a score on"

    least_score: float = 0.3

    def fuse(self, groups: Sequence[Detections]) -> Sequence[Detections]:
        return super().fuse([found[found.score >= self.least_score] for found in groups])
