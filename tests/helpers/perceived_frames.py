"""Frames of a receiver for tests of protocols: cars of 4 x 2 x 1.5 m along x, by hand."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from coopsim.bench.detect.perceived import Perceived
from coopsim.bench.detect.protocols import PROTOCOLS
from coopsim.bench.detect.ranking import Overlaps, Ranking
from coopsim.geometry.boxes import Boxes3D
from coopsim.types import Detections, GroundTruth

CAR, PERSON = (4.0, 2.0, 1.5), (0.6, 0.6, 1.7)


def detections(*x_and_score: tuple[float, float], label: int = 0, size: Sequence[float] = CAR) -> Detections:
    """Boxes at these x m, y = 0, with these scores. A car 1 m off has IoU 0.6, 2 m off 1/3, in 3D as in BEV."""
    return Detections(
        _boxes([x for x, _ in x_and_score], size), [score for _, score in x_and_score], [label] * len(x_and_score)
    )


def objects(
    *x_m: float,
    label: int = 0,
    size: Sequence[float] = CAR,
    seen_by: Sequence[int] | None = None,
    counts: Sequence[bool] | None = None,
    returns: Sequence[Sequence[int]] | None = None,
) -> GroundTruth:
    """Objects at these x m, y = 0."""
    return GroundTruth(
        np.arange(len(x_m)) + 1,
        _boxes(list(x_m), size),
        [label] * len(x_m),
        None if seen_by is None else np.array(seen_by),
        returns=None if returns is None else np.array(returns),
        counts=None if counts is None else np.array(counts),
    )


def overlaps(frames: Sequence[tuple[Detections, GroundTruth]], region_m: tuple[float, float] | None = None) -> Overlaps:
    """The pairs of one episode of these frames."""
    return Overlaps.of(Perceived.of([found for found, _ in frames], [truth for _, truth in frames], region_m))


def values(protocol: str, *episodes: Sequence[tuple[Detections, GroundTruth]]) -> dict[str, float]:
    """The metrics of episodes together."""
    made = PROTOCOLS.get(protocol)()
    parts = [made.rankings(overlaps(frames, (100.0, 40.0))) for frames in episodes]
    return made.values({name: Ranking.joined([part[name] for part in parts]) for name in parts[0]})


def _boxes(x_m: Sequence[float], size: Sequence[float]) -> Boxes3D:
    return Boxes3D.from_array(np.array([[x, 0.0, 0.75, *size, 0.0] for x in x_m]).reshape(-1, 7))
