"""The conformance check of a planner."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from coopsim.geometry.boxes import Boxes3D
from coopsim.interfaces.planner import PlannedCar, Planner, make_planner
from coopsim.testing.harness import name_of, require_own_state, untouched
from coopsim.types import NS_PER_S, Tracks
from coopsim.types.driving import LARGEST_ACCELERATION_M_S2, LARGEST_BRAKING_M_S2, NOBODY_FIRST, Route, approached
from coopsim.types.taxonomy import ObjectClass

_DT_S, _LENGTH_M, _WIDTH_M, _WHEELBASE_M = 0.1, 4.5, 1.9, 2.6

_Around = Callable[[int], Tracks]
"""Tracks by the number of the frame, in the frame of reference in which the car starts."""

_Driven = list[tuple[float, float, float]]


def check_planner(planner: str | Planner | type[Planner] | Callable[[], Planner], *, brakes: bool = True) -> None:
    """Check that a planner keeps what environments rely on.

    It must return a finite number for no tracks, many, far and fast ones, bodies on the car itself and whatever ids;
    leave its input as it is; return the same again for the same drive, in a new object and whatever other cars it
    drove before, as no two cars or episodes may share state. With `brakes` it must stop before a standing car that it
    is shown in time.

    Args:
        planner: a registered name or spec, the place of a class, a class, or a function that makes one.
        brakes: require that it stops for what stands in its way.

    Raises:
        AssertionError: a check failed; the message names it.
        CoopsimError: there is no such planner.
    """
    name = name_of(planner)
    assert not isinstance(planner, Planner), f"{name} must be a class or a name: each car has a planner of its own"
    made = make_planner(planner)
    assert isinstance(made, Planner), f"{name} must make a coopsim.Planner, got {made!r}"
    assert make_planner(planner) is not made, f"{name} must make a new planner for each car"

    def drive(planner: Planner, around: _Around) -> _Driven:
        return _drive(planner, name, around)

    cases = (_nothing, _crowd, _standing)
    last = require_own_state(lambda: make_planner(planner), drive, cases, name, ("drive", "cars"))
    if brakes:
        assert _stops(last), f"{name} must stop before a standing car that it is shown {_STANDS_AT_M:g} m ahead"


def _nothing(frame: int) -> Tracks:
    return Tracks.empty()


_STANDS_AT_M, _SPEED_M_S, _FRAMES = 80.0, 10.0, 250


def _standing(frame: int) -> Tracks:
    """Return a car that stands on the route."""
    return _tracks([[_STANDS_AT_M, 0.0]], [[0.0, 0.0]], [7])


def _crowd(frame: int) -> Tracks:
    """Return tracks that are many, far, fast, on the car itself, born and lost, with changing numbers."""
    rng = np.random.default_rng(frame)
    count = (0, 1, 200, 3)[frame % 4]
    places = rng.normal(0.0, (5.0, 60.0, 5000.0)[frame % 3], (count, 2))
    places[: count // 50] = 0.0
    return _tracks(places, rng.normal(0.0, 10.0, (count, 2)), rng.choice(10**9, count, replace=False))


def _tracks(
    places: object, velocity: object, ids: Sequence[int] | np.ndarray[tuple[int], np.dtype[np.int64]]
) -> Tracks:
    at = np.asarray(places, dtype=np.float64).reshape(-1, 2)
    rows = np.column_stack([at, np.tile([0.8, _LENGTH_M, _WIDTH_M, 1.6, 0.0], (len(at), 1))])
    labels = np.arange(len(at)) % len(ObjectClass)
    return Tracks(np.asarray(ids), Boxes3D.from_array(rows), np.asarray(velocity, float), np.ones(len(at)), labels)


def _drive(planner: Planner, name: str, around: _Around) -> _Driven:
    """Drive straight on; return place (m), speed (m/s) and answer (m/s²) of each frame."""
    at, speed, acceleration, driven = 0.0, _SPEED_M_S, 0.0, []
    ahead = np.arange(101.0)
    route = Route(np.column_stack([ahead, 0 * ahead]), 1.0, np.full(101, 13.9), np.full(101, NOBODY_FIRST))
    for frame in range(_FRAMES):
        tracks = around(frame)
        moved = replace(tracks, boxes=Boxes3D.from_array(tracks.boxes.array - np.array([at, 0, 0, 0, 0, 0, 0])))
        time_ns = round(frame * _DT_S * NS_PER_S)
        car = PlannedCar("cav_0", time_ns, _DT_S, moved, speed, acceleration, 0.0, _LENGTH_M, _WIDTH_M, route)
        car = replace(car, wheelbase_m=_WHEELBASE_M) if planner.steers else car
        with untouched(car, f"{name} must leave its input as it is"):
            answer = _answer(planner, name, car)
        driven.append((at, speed, answer))
        wanted = min(max(answer, -LARGEST_BRAKING_M_S2), LARGEST_ACCELERATION_M_S2)
        acceleration = approached(acceleration, wanted, _DT_S)
        speed = max(speed + acceleration * _DT_S, 0.0)
        at += speed * _DT_S
    return driven


def _answer(planner: Planner, name: str, car: PlannedCar) -> float:
    try:
        answer: Any = planner.plan(car)
    except Exception as error:
        raise AssertionError(f"{name} must return a number, and raised {type(error).__name__}: {error}") from error
    pair = isinstance(answer, tuple) and len(answer) == 2
    assert pair or not planner.steers, f"{name} must return an acceleration and an angle, got {answer!r}"
    for number in answer if planner.steers else (answer,):
        known = isinstance(number, (int, float, np.integer, np.floating)) and not isinstance(number, bool)
        assert known and math.isfinite(number), f"{name} must return a finite acceleration, got {answer!r}"
    return float(answer[0] if planner.steers else answer)


def _stops(driven: _Driven) -> bool:
    """Return whether the car stands before the standing car in the end."""
    at, speed, _ = driven[-1]
    return speed < 1.0 and at < _STANDS_AT_M - _LENGTH_M
