"""YOLOO's cost of a pair: how unlike it looks, and how far apart it is (Gu et al., eq. 4, 8 and 9)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from coopsim.geometry.se3 import Floats
from coopsim.tracking.affinity import fgam
from coopsim.tracking.appearance import Appearance
from coopsim.tracking.embedding_memory import EmbeddingMemory
from coopsim.tracking.tracked import Tracked
from coopsim.types import Detections, Ints, Mask

_LONG_S = 1e6


@dataclass(frozen=True, slots=True)
class LastLook(Appearance):
    """Keeps the last embedding of each track, for the association alone: nothing is found again or suppressed by it."""

    window_s: float = _LONG_S
    views: int = 1

    def older(self, tracks: Tracked, detections: Detections, rows: Ints, columns: Ints, reported: Mask) -> Ints:
        return rows

    def repeats(self, found: Detections, matched: Ints, memory: EmbeddingMemory | None = None) -> Ints:
        return np.arange(len(found))


@dataclass(frozen=True, slots=True)
class LooksAndDistance:
    """The affinity 2 - c_p - c_g of N tracks and M detections, in [0, 2]; -inf where c_g exceeds 1.

    c_g is the distance in units of the smaller box, and c_p is 1 less the cosine of the embeddings, at most 1 (the
    source says that it is in [0, 1]). A pair without embeddings is compared by geometry alone: its c_g counts twice, so
    that its cost is of the same size as those of other pairs.

    Attributes:
        count: called with the numbers of possible pairs of one class that were compared with looks, and without.
    """

    count: Callable[[int, int], None]

    def __call__(self, tracks: Tracked, detections: Detections, /) -> Floats:
        near = fgam(tracks, detections)
        alike = tracks.appearance.similarity(tracks.appearance.readable(detections))
        known = np.isfinite(alike)
        possible = np.isfinite(near) & (tracks.label[:, None] == detections.label)
        self.count(int((possible & known).sum()), int((possible & ~known).sum()))
        return near + np.where(known, np.maximum(alike, 0.0), near)
