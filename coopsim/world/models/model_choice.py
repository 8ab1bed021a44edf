"""Choice of models for actors: among those of a class, each as often as its share says."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from coopsim.errors import InvalidValueError
from coopsim.types import Ints
from coopsim.types.taxonomy import ObjectClass
from coopsim.world.models.model import Model


def models_of(models: Sequence[Model], label: ObjectClass, *, parked: bool = False) -> Ints:
    """Return the indices of the models of a class, at least one; `parked` also of those that only stand.

    Raises:
        InvalidValueError: no model has that class.
    """
    fitting = [k for k, model in enumerate(models) if model.label == label and (parked or not model.stands)]
    if not fitting:
        known = sorted({ObjectClass(model.label).title for model in models})
        raise InvalidValueError(f"there is no model of class {label.title!r}, only of {', '.join(known)}")
    return np.array(fitting, dtype=np.int64)


def draw_models(rng: np.random.Generator, models: Sequence[Model], fitting: Ints, count: int) -> Ints:
    """Draw `count` of the indices `fitting` of `models`, each as often as its model's share says.

    Models of equal shares take one whole number each from `rng`, as they did before there were shares.
    """
    share = np.array([models[k].share for k in fitting])
    if (share == share[0]).all():
        return fitting[rng.integers(len(fitting), size=count)]
    drawn: Ints = fitting[np.searchsorted(np.cumsum(share / share.sum())[:-1], rng.random(count), side="right")]
    return drawn
