"""Draws from what a recipe says: ranges and weights."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np


def between(ends: Sequence[float], rng: np.random.Generator) -> float:
    """Draw a number of a range; all are equally likely."""
    return ends[0] + rng.random() * (ends[1] - ends[0])


def count_between(ends: Sequence[int], rng: np.random.Generator) -> int:
    """Draw an integer of a range, both ends among them."""
    return int(rng.integers(ends[0], ends[1] + 1))


def one_of(weights: Mapping[str, float], rng: np.random.Generator) -> str:
    """Draw a name, each as often as its weight says."""
    names = list(weights)
    shares = np.array([weights[name] for name in names], dtype=np.float64)
    return names[int(rng.choice(len(names), p=shares / shares.sum()))]
