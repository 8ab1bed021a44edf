"""The catalogue of models: the built-in ones, by groups, and those that users register."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from coopsim.errors import DuplicateNameError, InvalidValueError
from coopsim.support.registry import Registry
from coopsim.types import Ints
from coopsim.types.taxonomy import ObjectClass
from coopsim.world.models.built_in import GROUPS, built_in_models
from coopsim.world.models.model import Model

CUSTOM_MODELS: Registry[Model] = Registry("model")
"""Models that users have registered."""


def make_models(varied: bool = False, at_rest: bool = False) -> tuple[Model, ...]:
    """Return all models: the built-in ones by class, then custom ones by name.

    They are followed by the variants if `varied`, and then by people who stand and sit if `at_rest`.
    """
    custom = (CUSTOM_MODELS.get(name) for name in CUSTOM_MODELS)
    added = (*(("varied",) if varied else ()), *(("standing", "sitting") if at_rest else ()))
    return (*built_in_models("plain"), *custom, *(model for group in added for model in built_in_models(group)))


def register_model(model: Model) -> Model:
    """Let worlds that are made from now on choose `model` for actors of its class, next to the built-in ones.

    Raises:
        DuplicateNameError: a model of that name exists.
        InvalidValueError: `model` is not a `Model`.
    """
    if not isinstance(model, Model):
        raise InvalidValueError(f"model must be a Model, as model_from_mesh makes one, got {model!r}")
    if any(model.name == other.name for group in GROUPS for other in built_in_models(group)):
        raise DuplicateNameError(f"model {model.name!r} is built in")
    return CUSTOM_MODELS.register(model.name)(model)


def models_of(models: Sequence[Model], label: ObjectClass, *, parked: bool = False) -> Ints:
    """Return the indices of the models of a class, at least one; `parked` also of those that only stand."""
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
