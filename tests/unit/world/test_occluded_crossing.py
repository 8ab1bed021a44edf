"""A parked truck hides people from one car, not from another: by the LiDAR, ray by ray."""

import numpy as np
import pytest

import coopsim
from coopsim.taxonomy import ObjectClass


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_somebody_near_is_hidden_from_one_car_and_seen_by_another(seed: int) -> None:
    env = coopsim.parallel_env("occluded_crossing", max_cycles=50, lidar_columns=1024, expose_ground_truth=True)
    policy = coopsim.make_policy("no_fusion")
    observations, infos = env.reset(seed=seed)
    policy.reset(env.agent_specs)
    hidden = hidden_on_road = 0
    while env.agents:
        observations, _, _, _, infos = env.step(policy.act(observations))
        actors = env.bev_frame().actors  # of the frame before
        if not env.agents:
            break
        walks = env.state()[:, 1] == ObjectClass.PEDESTRIAN
        rows = env.state()[walks]
        from_behind, towards = (
            np.isin(rows[:, 0], infos[car]["instances"]["lidar"]) for car in ("cav_0", "cav_1")
        )
        place = observations["cav_0"]["pose"][:2]
        ahead_m = rows[:, 2] - place[0]
        one = ~from_behind & towards & (ahead_m > 0) & (ahead_m < 50) & (rows[:, 3] < -3.0)
        hidden += bool(one.any())
        hidden_on_road += bool((one & (rows[:, 3] > -6.7)).any())
        assert len(actors) > 0
    print("SEED", seed, hidden, hidden_on_road)
    assert hidden >= 1
