"""Junctions between which no vehicle can stop: who enters the first has a grant for the second."""

from __future__ import annotations

import numpy as np
import pytest
from two_junctions import two_junctions

from coopsim.world.custom.place import place_from
from coopsim.world.scenario import make_scenario
from coopsim.world.traffic.asked import GRANTED
from coopsim.world.world import World

LONGEST_S = 110.0


def drive(gap_m: float, seed: int, seconds: float, *, priority: bool) -> tuple[int, float, int]:
    """Return how many crashed, how long one stood at most (s), and how many came in again."""
    place = place_from(two_junctions(gap_m, priority=priority), "two")
    world = World(make_scenario(place, vehicles=14, connected_cars=0, rsus=0, drones=1, truck_share=0.2, buses=2), seed)
    stood: dict[int, float] = {}
    longest = 0.0
    for _ in range(int(10 * seconds)):
        world.step(0.1)
        rows = world.fleet.rows
        stood = {int(row["id"]): stood.get(int(row["id"]), 0.0) + 0.1 if row["speed"] < 0.1 else 0.0 for row in rows}
        longest = max(longest, *stood.values())
    return len(world.crashed()), longest, int(world.fleet.rows["id"].max()) - len(world.fleet)


@pytest.mark.filterwarnings("ignore::coopsim.errors.CrowdedWarning")
@pytest.mark.parametrize(("gap_m", "priority", "seed"), [(6.0, False, 1), (6.0, True, 2), (16.0, True, 3)])
def test_nobody_crashes_or_waits_for_ever_between_two_junctions(gap_m: float, priority: bool, seed: int) -> None:
    crashed, longest_s, passed = drive(gap_m, seed, 150.0, priority=priority)
    assert crashed == 0
    assert longest_s < LONGEST_S
    assert passed > 12


def test_a_vehicle_between_the_junctions_has_its_grant() -> None:
    world = World(make_scenario(place_from(two_junctions(), "two"), vehicles=12, connected_cars=0, rsus=0, drones=1), 4)
    lanes, met = world._traffic._network.lane_index, 0
    for _ in range(600):
        world.step(0.1)
        for row in world.fleet.rows:
            start, end, _number = lanes[row["target_lane"]]
            if (start, end) in (("0e", "1W"), ("1w", "0E")):
                met += 1
                assert row["ticket"] == GRANTED and row["movement"] >= 0
    assert met > 5
    assert np.isfinite(world.fleet.position).all()
