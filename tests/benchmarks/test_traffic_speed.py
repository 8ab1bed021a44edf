"""How long a step of the traffic takes, by how many vehicles there are, and against highway-env. Run by `make bench`.

The targets are for a machine at rest: 50 vehicles under 2 ms a step and 200 under 8, people included. Nothing here
fails by time.
"""

from __future__ import annotations

import time
from dataclasses import replace

import numpy as np

from coopsim.types.taxonomy import ObjectClass
from coopsim.world.models import make_models
from coopsim.world.people.people import People, join_bodies
from coopsim.world.places.highway import make_highway
from coopsim.world.places.layout import Layout, StartSlot
from coopsim.world.population import Population
from coopsim.world.scenario import make_scenario
from coopsim.world.traffic.traffic import Traffic

SPACING_M = 24.0


def long_highway(vehicles: int) -> Layout:
    """The highway with room for so many; nobody is replaced, so that all are far from the road's end."""
    a_lane = -(-vehicles // 6)
    slots = tuple(
        StartSlot((f"{way}_start", f"{way}_end", lane), 3_000.0 + k * SPACING_M + lane * SPACING_M / 3)
        for way in ("east", "west")
        for lane in range(3)
        for k in range(a_lane)
    )
    return replace(make_highway(), slots=slots, connected_order=(0,), window_m=None, cruise_m_s=None)


def step_ms(layout: Layout, vehicles: int, pedestrians: int, engine: str, steps: int) -> float:
    """Mean time of a step of vehicles and people, after a second of getting going."""
    population = Population(vehicles=vehicles, pedestrians=pedestrians, connected_cars=0)
    models = make_models()
    traffic = Traffic(layout, population, models, 0, engine=engine)
    people = People(layout.footways, pedestrians, ObjectClass.PEDESTRIAN, models, 0, traffic.fleet.position)
    for step in range(10 + steps):
        if step == 10:
            began = time.perf_counter()
        everybody = join_bodies([people])
        traffic.step(0.1, {}, everybody)
        people.step(0.1, traffic.fleet, everybody)
    assert np.isfinite(traffic.fleet.position).all()
    return 1e3 * (time.perf_counter() - began) / steps


def test_time_by_number_of_vehicles() -> None:
    step_ms(long_highway(6), 6, 0, "arrays", 1)  # compiles
    print(f"\n{'highway':>9} {'arrays':>9} {'highway-env':>12} {'ratio':>7}")
    found = {}
    for vehicles in (10, 25, 50, 100, 200, 400):
        layout = long_highway(vehicles)
        ours = found[vehicles] = step_ms(layout, vehicles, 0, "arrays", 200)
        theirs = step_ms(layout, vehicles, 0, "highway-env", max(2, 200 // vehicles))
        print(f"{vehicles:9d} {ours:6.3f} ms {theirs:9.1f} ms {theirs / ours:7.0f}")
    print(f"8 times as many vehicles (50 to 400) take {found[400] / found[50]:.1f} times as long")


def test_time_at_the_crossing_with_people() -> None:
    layout = make_scenario("crossing").layout
    step_ms(layout, 6, 6, "arrays", 1)  # compiles
    print(f"\n{'crossing':>9} {'people':>7} {'arrays':>9} {'highway-env':>12} {'ratio':>7}")
    for vehicles, people in ((14, 8), (30, 8), (44, 20), (44, 100)):
        ours = step_ms(layout, vehicles, people, "arrays", 300)
        theirs = step_ms(layout, vehicles, people, "highway-env", 10)
        print(f"{vehicles:9d} {people:7d} {ours:6.3f} ms {theirs:9.1f} ms {theirs / ours:7.0f}")
