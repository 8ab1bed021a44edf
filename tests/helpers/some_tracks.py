"""Tracks and detections for tests: cars in a row."""

from __future__ import annotations

import numpy as np

from coopsim.geometry.boxes import Boxes3D
from coopsim.tracking.motion.constant_velocity import ConstantVelocity
from coopsim.tracking.track_states import EmbeddingMemory, TrackStates
from coopsim.types import Detections

FRAME_NS = 100_000_000


def cars(*xs: float, score: float | list[float] = 0.8, label: int | list[int] = 0) -> Detections:
    """Cars at (x, 0), heading along x."""
    rows = np.array([[x, 0, 0.8, 4.5, 1.9, 1.6, 0.0] for x in xs]).reshape(-1, 7)
    full = np.broadcast_to
    return Detections(Boxes3D.from_array(rows), full(score, len(rows)), full(label, len(rows)))


def tracks(
    *xs: float,
    score: float | list[float] = 0.8,
    label: int | list[int] = 0,
    hits: int | list[int] = 3,
    misses: int | list[int] = 0,
    speed_m_s: float | list[float] = 0.0,
    memory: EmbeddingMemory | None = None,
) -> TrackStates:
    """Tracks at (x, 0), going along x."""
    found = cars(*xs)
    count = len(found)
    beliefs = ConstantVelocity().initiate(found.boxes.array, None)

    def numbers(value: int | list[int]) -> np.ndarray:
        return np.array(np.broadcast_to(value, count), dtype=np.int64)

    scores = np.array(np.broadcast_to(score, count), dtype=float)
    velocity = np.column_stack([np.broadcast_to(speed_m_s, count), np.zeros(count)]).astype(float)
    return TrackStates(
        beliefs,
        found.boxes.array,
        velocity,
        1 + np.arange(count),
        numbers(label),
        scores,
        scores,
        scores,
        numbers(hits),
        numbers(misses),
        numbers(5),
        np.zeros(count, dtype=bool),
        EmbeddingMemory.blank(count, dim=0, window=1) if memory is None else memory,
    )
