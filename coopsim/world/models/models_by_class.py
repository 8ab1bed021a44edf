"""Which shapes an actor of a class can have."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from coopsim.errors import InvalidValueError
from coopsim.types import Ints
from coopsim.types.taxonomy import ObjectClass
from coopsim.world.snapshot import Model


def models_of(models: Sequence[Model], label: ObjectClass) -> Ints:
    """Indices of the models of a class, at least one.

    Raises:
        InvalidValueError: there is none.
    """
    fitting = np.array([k for k, model in enumerate(models) if model.label == label], dtype=np.int64)
    if not len(fitting):
        known = sorted({ObjectClass(model.label).title for model in models})
        raise InvalidValueError(f"there is no model of class {label.title!r}, only of {', '.join(known)}")
    return fitting
