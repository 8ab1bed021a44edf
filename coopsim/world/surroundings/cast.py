"""Models of bystanders by role: who stands, who sits, what is parked."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from typing import NamedTuple

import numpy as np

from coopsim.types.taxonomy import ObjectClass
from coopsim.world.models import Model, make_models
from coopsim.world.models.built_in import built_in_models

_VAN_SHARE = 0.12
_LONGEST_PARKED_M = 5.6
"""Of what stands in bays and on private ground; longer ones reach into the next bay."""

_SCOOTER_SHARE = 0.15


class Role(NamedTuple):
    """Models of one role, and the weight of each (M,)."""

    models: tuple[Model, ...]
    weight: tuple[float, ...]

    def draw(self, rng: np.random.Generator) -> Model:
        """Draw a model, each as often as its weight says."""
        weight = np.array(self.weight)
        return self.models[int(np.searchsorted(np.cumsum(weight / weight.sum())[:-1], rng.random(), side="right"))]


class Cast(NamedTuple):
    """Roles of bystanders.

    Attributes:
        standing: people who stand.
        sitting: people who sit.
        vehicle: parked cars and vans.
        cycle: bicycles and kick scooters without a rider.
    """

    standing: Role
    sitting: Role
    vehicle: Role
    cycle: Role


@cache
def make_cast() -> Cast:
    """Return the roles of the built-in models."""
    parked = [model for model in make_models(varied=True) if model.size_m[0] <= _LONGEST_PARKED_M]
    cars, vans = ([m for m in parked if m.label == label] for label in (ObjectClass.CAR, ObjectClass.VAN))
    bicycles, scooters = ([m for m in parked if m.name == name] for name in ("bicycle_parked", "kick_scooter_parked"))
    return Cast(
        _role(built_in_models("standing")),
        _role(built_in_models("sitting")),
        _joined(_role(cars), _role(vans), _VAN_SHARE),
        _joined(_role(bicycles), _role(scooters), _SCOOTER_SHARE),
    )


def _role(models: Sequence[Model]) -> Role:
    return Role(tuple(models), tuple(model.share for model in models))


def _joined(usual: Role, other: Role, share: float) -> Role:
    """Return both roles as one, of which the other has a share."""
    weights = [
        [part * weight / sum(role.weight) for weight in role.weight]
        for role, part in ((usual, 1.0 - share), (other, share))
    ]
    return Role(usual.models + other.models, tuple(weights[0] + weights[1]))
