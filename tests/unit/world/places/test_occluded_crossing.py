"""A parked truck hides people from one car, not from another: by the LiDAR, ray by ray."""

from typing import Any

import numpy as np
import pytest

import coopsim
from coopsim.types.taxonomy import ObjectClass
from coopsim.world.scenario import make_scenario

TRUCK = make_scenario("occluded_crossing").layout.bays[0]


def hidden_and_walking(seed: int, frames: int) -> tuple[set[int], set[int]]:
    """Who is next to the truck's front, 0 returns from cav_0 and some from cav_1; and who is on the road later."""
    env = coopsim.parallel_env("occluded_crossing", max_cycles=frames, expose_ground_truth=True, pedestrians=12)
    policy = coopsim.make_policy("no_fusion")
    observations, infos = env.reset(seed=seed)
    policy.reset(env.agent_specs)
    hidden: set[int] = set()
    crossing: set[int] = set()
    while env.agents:
        rows = env.state()
        people = rows[rows[:, 1] == ObjectClass.PEDESTRIAN]
        identity, x, y = people[:, 0].astype(int), people[:, 2], people[:, 3]
        behind, towards = (returns(identity, infos[car]) > 0 for car in ("cav_0", "cav_1"))
        at_kerb = (y < -4) & (x > TRUCK.x_m) & (x < TRUCK.x_m + 12)
        hidden |= set(identity[~behind & towards & at_kerb & (observations["cav_0"]["pose"][0] < TRUCK.x_m)].tolist())
        crossing |= set(identity[np.isin(identity, list(hidden)) & (np.abs(y) < 4)].tolist())
        observations, _, _, _, infos = env.step(policy.act(observations))
    return hidden, crossing


def returns(identity: Any, info: Any) -> Any:
    """How many returns a car has of each."""
    return (info["instances"]["lidar"][:, None] == identity).sum(axis=0)


@pytest.mark.parametrize("seed", range(3))
def test_who_comes_to_the_kerb_is_hidden_from_one_car_and_seen_by_the_other(seed: int) -> None:
    hidden, _ = hidden_and_walking(seed, 50)
    assert hidden


def test_who_was_hidden_steps_onto_the_road() -> None:
    hidden, crossing = hidden_and_walking(1, 200)
    assert hidden & crossing
