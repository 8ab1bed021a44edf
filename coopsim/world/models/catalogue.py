"""The catalogue of models: the built-in ones, by sets, and those that users register."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cache

import numpy as np

from coopsim.errors import DuplicateNameError, InvalidValueError
from coopsim.support.registry import Registry
from coopsim.types import Ints
from coopsim.types.taxonomy import ObjectClass
from coopsim.world.models.model import Model

CUSTOM_MODELS: Registry[Model] = Registry("model")
"""Models that users have registered."""

SHAPES: Registry[Callable[[], Sequence[Model]]] = Registry("set of models", home="coopsim.world.shapes")
"""Functions that return the built-in models: those of "plain" places, "varied" ones, and people "at_rest"."""


def make_models(varied: bool = False, at_rest: bool = False) -> tuple[Model, ...]:
    """Return all models: the built-in ones by class, then custom ones by name.

    They are followed by the variants if `varied`, and then by people who stand and sit if `at_rest`.
    """
    custom = (CUSTOM_MODELS.get(name) for name in CUSTOM_MODELS)
    return (*_set("plain"), *custom, *(_set("varied") if varied else ()), *(_set("at_rest") if at_rest else ()))


def register_model(model: Model) -> Model:
    """Let worlds that are made from now on choose `model` for actors of its class, next to the built-in ones.

    Raises:
        DuplicateNameError: a model of that name exists.
        InvalidValueError: `model` is not a `Model`.
    """
    if not isinstance(model, Model):
        raise InvalidValueError(f"model must be a Model, as model_from_mesh makes one, got {model!r}")
    if any(model.name == other.name for name in SHAPES for other in _set(name)):
        raise DuplicateNameError(f"model {model.name!r} is built in")
    return CUSTOM_MODELS.register(model.name)(model)


@cache
def _set(name: str) -> tuple[Model, ...]:
    return tuple(SHAPES.get(name)())


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
