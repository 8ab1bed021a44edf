"""What long vehicles sweep over a junction: others wait for them, and cars still turn together."""

from __future__ import annotations

from collections.abc import Sequence

import lit_crossing
import numpy as np
import pytest
from lit_crossing import crossing
from test_long_vehicles import CAR, COACH, NOBODY, fleet_on

from coopsim.world.custom.place import place_from
from coopsim.world.scenario import SCENARIOS
from coopsim.world.traffic.array_engine import ArrayEngine
from coopsim.world.traffic.lanes import NumberedNetwork
from coopsim.world.traffic.movements import movements_of

Turn = tuple[dict[str, float], tuple[int, int]]
"""A vehicle, and the arms that it comes from and goes to."""
TIPPER = {"length": 8.3, "width": 2.5, "axle_m": 8.3 / 4}
_SEEDS = 6


def crashes(turns: Sequence[Turn], line_m: float, monkeypatch: pytest.MonkeyPatch) -> tuple[int, float]:
    """Return how often vehicles touch that meet at a crossing, and the mean time until all are past it, s."""
    monkeypatch.setattr(lit_crossing, "LINE_M", line_m)
    layout = place_from(crossing(), "crossing").make_layout()
    network = NumberedNetwork(layout.network)
    engine = ArrayEngine(network, layout.movements, layout.speeds_m_s, layout.priority, layout.clearance_m)
    crashed, times_s = 0, []
    for seed in range(_SEEDS):
        rng = np.random.default_rng(seed)
        fleet = fleet_on(
            network,
            *(
                size
                | {"route": [(f"in{a}.", f"in{a}"), (f"in{a}", f"out{b}"), (f"out{b}", f"out{b}.")]}
                | {"along": float(rng.uniform(20, 45)), "speed": float(rng.uniform(5, 11))}
                for size, (a, b) in turns
            ),
        )
        step = 0
        while step < 300:
            engine.step(fleet, NOBODY, 0.1, {})
            step += 1
            left = [network.lane_index[lane][0].startswith("out") for lane in fleet.rows["lane"]]
            if fleet.rows["crashed"].any() or all(left):
                break
        times_s.append(0.1 * step)
        crashed += bool(fleet.rows["crashed"].any())
    return crashed, float(np.mean(times_s))


@pytest.mark.parametrize(
    ("turns", "line_m"),
    [
        ([(COACH, (0, 3)), (COACH, (2, 1))], 14.0),
        ([(TIPPER, (0, 3)), (CAR, (2, 1))], 14.0),
        ([(COACH, (0, 1)), (CAR, (1, 3))], 10.0),  # swings out into the lane of who comes from there
        ([(COACH, (0, 1)), (CAR, (1, 0))], 10.0),
        ([(COACH, (0, 3)), (CAR, (3, 1))], 10.0),
    ],
)
def test_a_long_vehicle_turns_without_touching_who_comes_the_other_way(
    turns: list[Turn], line_m: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    crashed, mean_s = crashes(turns, line_m, monkeypatch)
    assert crashed == 0
    assert mean_s < 20


def test_cars_turn_left_together_and_buses_one_after_the_other(monkeypatch: pytest.MonkeyPatch) -> None:
    crashed, cars_s = crashes([(CAR, (0, 3)), (CAR, (2, 1))], 12.0, monkeypatch)
    _, buses_s = crashes([(COACH, (0, 3)), (COACH, (2, 1))], 12.0, monkeypatch)
    assert crashed == 0
    assert cars_s < buses_s - 3


@pytest.mark.parametrize("name", ["crossing", "merge", "roundabout"])
def test_straight_lanes_and_arcs_are_as_they_were(name: str) -> None:
    layout = SCENARIOS.get(name).make_layout()
    found = movements_of(NumberedNetwork(layout.network), layout.movements, layout.priority, layout.clearance_m)
    assert found.long_clear_m is found.clear_m
    assert not found.back_m.any()


def test_what_is_swept_conflicts_both_ways_and_only_at_junctions(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(lit_crossing, "LINE_M", 12.0)
    layout = place_from(crossing(), "crossing").make_layout()
    found = movements_of(NumberedNetwork(layout.network), layout.movements, layout.priority, layout.clearance_m)
    number = {road: k for k, road in enumerate(layout.movements)}
    left, opposite, right = number["in0", "out3"], number["in2", "out1"], number["in2", "out3"]
    assert not np.isfinite(found.clear_m[left, opposite])
    assert 0 < found.long_clear_m[left, opposite] < 25
    assert np.isfinite(found.long_clear_m[opposite, left])
    far = number["in0", "out2"], number["in2", "out0"]  # straight on, past each other
    assert not np.isfinite(found.long_clear_m[far])
    assert (np.isfinite(found.long_clear_m) >= np.isfinite(found.clear_m)).all()
    assert np.isfinite(found.long_clear_m[left, right])
