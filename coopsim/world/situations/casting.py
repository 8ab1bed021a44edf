"""Casting: vehicles on ways, placed so that they pass the place of the conflict at a given time."""

from __future__ import annotations

from typing import Any

import numpy as np

from coopsim.types.taxonomy import ObjectClass
from coopsim.world.models.catalogue import make_models
from coopsim.world.models.model import Model
from coopsim.world.script import VehicleRole
from coopsim.world.situations.sites import Way, comfortable_m_s

CONFLICT_S = 4.5
"""Time of the conflict: a tracker has long confirmed what is in view by then."""

HEADWAY_S = (2.0, 2.6)
"""Time gap of the car behind the ego: the two-second rule of driving schools."""

_BEGIN_M = 3.0  # of a way, where a car fits


def draw(rng: np.random.Generator, ends: tuple[float, float]) -> float:
    """Draw a number from a range."""
    return float(rng.uniform(*ends))


def draw_model(rng: np.random.Generator, *labels: ObjectClass, tallest_m: float = 9.0) -> Model:
    """Draw a built-in model of these classes, with equal chances, no taller than `tallest_m`."""
    fitting = [each for each in make_models() if each.label in labels and each.size_m[2] <= tallest_m]
    return fitting[int(rng.integers(len(fitting)))]


def passing(name: str, way: Way, at_s: float, speed_m_s: float, **rest: Any) -> VehicleRole:
    """Return a car whose middle passes the way's place of interest at `at_s` if it keeps its speed.

    On a way that is too short for that it starts at the beginning. `rest` has further fields of `VehicleRole`.
    """
    start_m = max(-speed_m_s * at_s, float(way.starts_m[0]) + _BEGIN_M)
    lane, along_m = way.find(start_m)
    speed_m_s = min(speed_m_s, comfortable_m_s(way.network.get_lane(lane)))
    return VehicleRole(name, lane, along_m, speed_m_s, way.roads_from(start_m), **rest)


def standing(name: str, way: Way, along_m: float, aside_m: float, model: Model) -> VehicleRole:
    """Return a parked vehicle beside a way."""
    label = ObjectClass(model.label)
    return VehicleRole(name, *way.find(along_m), 0.0, (), label, "parked", aside_m=aside_m, model=model.name)
