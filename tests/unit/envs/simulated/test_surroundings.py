"""Surroundings of all agents at once, against each agent's by itself."""

from __future__ import annotations

import numpy as np

from coopsim.envs.simulated.perception import GroundTruths
from coopsim.geometry.boxes import Boxes3D
from coopsim.geometry.se3 import SE3
from coopsim.world.snapshot import Actors, AgentBody

COUNT = 9
REGION_M = (20.0, 15.0)


def around(seed: int) -> tuple[dict[str, AgentBody], Actors, np.ndarray]:
    """Two cars, actors 3 and 7, and a mast; returns from some actors."""
    rng = np.random.default_rng(seed)
    boxes = Boxes3D(rng.uniform(-30, 30, (COUNT, 3)), rng.uniform(1, 5, (COUNT, 3)), rng.uniform(-3, 3, COUNT))
    numbers = np.arange(COUNT)
    colors = rng.integers(0, 256, (2, COUNT, 3)).astype(np.uint8)
    actors = Actors(numbers + 1, boxes, rng.normal(size=(COUNT, 2)), numbers, numbers, *colors, rng.random(COUNT))
    bodies = {
        name: AgentBody(name, "cav" if actor else "rsu", actor, SE3.from_xyz_yaw(rng.uniform(-20, 20, 3), yaw), 1.5)
        for name, actor, yaw in (("cav_0", 3, 0.4), ("rsu_0", None, -2.0), ("cav_1", 7, 3.0))
    }
    return bodies, actors, rng.integers(0, 3, (COUNT, 3)) * rng.integers(0, 2, (COUNT, 1))


def test_every_agent_has_all_others_in_its_own_frame() -> None:
    for seed in range(20):
        bodies, actors, returns = around(seed)
        oracles = GroundTruths.of(bodies, actors, returns).oracles
        assert list(oracles) == list(bodies)
        for k, (name, body) in enumerate(bodies.items()):
            other = actors.id != body.actor_id if body.actor_id else np.ones(COUNT, np.bool_)
            want, got = actors[other].transform(body.world_SE3_base.inverse()), oracles[name]
            for column in ("id", "velocity", "label", "model", "color", "accent", "phase"):
                np.testing.assert_allclose(getattr(got.actors, column), getattr(want, column), rtol=1e-12, atol=1e-12)
            np.testing.assert_allclose(got.actors.boxes.array, want.boxes.array, rtol=1e-12, atol=1e-12)
            np.testing.assert_array_equal(got.returns, returns[other, k])
            assert got.world_SE3_base is body.world_SE3_base


def test_what_counts_is_in_the_region_and_seen_by_some_agent() -> None:
    bodies, actors, returns = around(0)
    surroundings = GroundTruths.of(bodies, actors, returns)
    some, everything = (surroundings.truths(REGION_M, all_count=all_count) for all_count in (False, True))
    for k, (name, body) in enumerate(bodies.items()):
        other = actors.id != body.actor_id if body.actor_id else np.ones(COUNT, np.bool_)
        truth, seen = some[name], returns[other] > 0
        inside = (np.abs(truth.boxes.center[:, :2]) <= REGION_M).all(axis=1)
        assert 0 < inside.sum() < len(inside) and 0 < seen.any(axis=1).sum() < len(inside)
        np.testing.assert_array_equal(truth.in_region, inside)
        np.testing.assert_array_equal(truth.visible_to, np.where(seen[:, k], 0, np.where(seen.any(axis=1), 1, 2)))
        np.testing.assert_array_equal(truth.counts, inside & seen.any(axis=1))
        np.testing.assert_array_equal(everything[name].counts, inside)
        np.testing.assert_array_equal(truth.returns, returns[other])
