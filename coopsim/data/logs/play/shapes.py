"""Shapes of other programs' road users: the models of their classes, stretched to their sizes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from coopsim.geometry.se3 import Floats
from coopsim.support.rng import uniform_numbers
from coopsim.types import Ints
from coopsim.types.taxonomy import ObjectClass
from coopsim.world.models.catalogue import models_of
from coopsim.world.models.model import Model

_STEP_M = 0.01
"""Sizes are met to half of it, so that road users of one type share a model."""


def fitted_models(labels: Ints, sizes: Floats, base: Sequence[Model], seed: int) -> tuple[tuple[Model, ...], Ints]:
    """Return the models of road users, and which of them each has (T,).

    Args:
        labels: (T,) classes.
        sizes: (T, 3) lengths, widths and heights, m.
        base: models to choose from: one of a road user's class, by its name and the seed, as often as its share says.
        seed: the episode's.
    """
    draw = uniform_numbers(seed, "model", np.arange(len(labels)), 1)[:, 0]
    size = np.maximum(np.round(sizes / _STEP_M), 1.0) * _STEP_M
    chosen = np.empty(len(labels), np.int64)
    for label in np.unique(labels).tolist():
        fitting = models_of(base, ObjectClass(label))
        share = np.cumsum([base[k].share for k in fitting])
        of = labels == label
        chosen[of] = fitting[np.searchsorted(share, draw[of] * share[-1], side="right")]
    kinds, number = np.unique(np.column_stack([chosen, size]), axis=0, return_inverse=True)
    return tuple(_stretched(base[int(kind[0])], kind[1:]) for kind in kinds), number.ravel()


def _stretched(model: Model, size_m: Floats) -> Model:
    factor = size_m / model.size_m
    length, width, height = size_m.tolist()
    return replace(
        model,
        name=f"{model.name} {length:.2f} x {width:.2f} x {height:.2f}",
        size_m=size_m,
        vertices=model.vertices * factor,
        poses=model.poses * factor,
    )
