"""All places: repeatable, free of overlaps and crashes, moving, and honest about velocities."""

from dataclasses import fields
from itertools import pairwise

import numpy as np
import pytest
from worlds import DT_S, SCENARIOS, frames, make_world, people, table, vehicles

from coopsim.geometry.iou import iou_bev
from coopsim.world.scenario import make_scenario
from coopsim.world.snapshot import Actors


@pytest.mark.parametrize("name", SCENARIOS)
def test_same_seed_same_bits_and_another_seed_another_world(name: str) -> None:
    first, again = (list(frames(make_world(name, 3, vehicles=10), 100)) for _ in range(2))
    for a, b in zip(first, again, strict=True):
        np.testing.assert_array_equal(table(a), table(b))
    places, others = (actors.boxes.center @ [1, 1j, 0] for actors in (first[0], make_world(name, 4).actors()))
    assert not np.isin(places, others).any()


@pytest.mark.parametrize(
    ("name", "steps"), [("crossing", 60), ("highway", 250), ("platoon", 60), ("occluded_crossing", 60)]
)
@pytest.mark.parametrize("more", [{"connected_cars": 3}, {"rsus": 2}])
def test_one_agent_more_leaves_traffic_and_people_as_they_were(name: str, steps: int, more: dict[str, int]) -> None:
    # On the highway long enough that many are replaced: this must not depend on who is connected either.
    few, many = (
        make_world(name, 1, **({"vehicles": 14, "connected_cars": 2, "rsus": 1} | extra)) for extra in ({}, more)
    )
    assert len(many.agents()) == len(few.agents()) + 1
    for a, b in zip(frames(few, steps), frames(many, steps), strict=True):
        np.testing.assert_array_equal(table(a), table(b))


@pytest.mark.parametrize("name", SCENARIOS)
@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("full", [False, True])
def test_nobody_starts_inside_a_vehicle(name: str, seed: int, full: bool) -> None:
    layout = make_scenario(name).layout
    numbers = {"vehicles": len(layout.slots), "parked": len(layout.bays)} if full else {"vehicles": 20}
    actors = make_world(name, seed, **numbers).actors()
    overlap = iou_bev(vehicles(actors).boxes.array, actors.boxes.array)
    assert (overlap > 0).sum() == len(vehicles(actors))  # each with itself


@pytest.mark.parametrize("name", ["crossing", "highway"])
def test_actors_are_what_a_check_of_them_would_make(name: str) -> None:
    """They are made without one in every frame."""
    made = make_world(name, 1).actors()
    columns = {each.name: getattr(made, each.name) for each in fields(Actors)}
    checked = Actors(**columns)
    for column, array in columns.items():
        if column != "boxes":
            assert getattr(checked, column) is array, f"{column} has another type or shape, or can be written to"


@pytest.mark.parametrize(("name", "least_m_s"), [("crossing", 3.0), ("highway", 20.0)])
@pytest.mark.parametrize("seed", [0, 1])
def test_traffic_keeps_moving_without_crashes(name: str, least_m_s: float, seed: int) -> None:
    world = make_world(name, seed, vehicles=18)
    speeds = [np.linalg.norm(vehicles(actors).velocity, axis=1).mean() for actors in frames(world, 300)]
    assert world.crashed() == ()
    # Measured over the last 5 s: 4.7 and 3.7 m/s at the crossing, 23.3 and 23.7 on the highway.
    assert np.mean(speeds[-50:]) > least_m_s


@pytest.mark.parametrize("name", SCENARIOS)
@pytest.mark.parametrize("seed", range(3))
def test_a_minute_without_a_crash_an_overlap_or_a_jump(name: str, seed: int) -> None:
    world = make_world(name, seed)
    before = world.actors()
    for step in range(600):
        world.step(DT_S)
        after = world.actors()
        _, old, new = np.intersect1d(before.id, after.id, return_indices=True)
        moved_m = np.linalg.norm(after.boxes.center[new] - before.boxes.center[old], axis=1)
        assert moved_m.max() < 40 * DT_S and len(after) == len(before)
        before = after
        if step % 20 == 0:
            overlap = iou_bev(vehicles(after).boxes.array, after.boxes.array)
            assert (overlap > 0).sum() == len(vehicles(after))  # each with itself
    assert world.crashed() == ()


@pytest.mark.parametrize("name", SCENARIOS)
def test_velocities_are_what_positions_do(name: str) -> None:
    of_vehicles: list[float] = []
    for before, after in pairwise(frames(make_world(name, 0, vehicles=16), 150)):
        _, old, new = np.intersect1d(before.id, after.id, return_indices=True)
        moved = (after.boxes.center[new, :2] - before.boxes.center[old, :2]) / DT_S
        error = np.linalg.norm(moved - after.velocity[new], axis=1)
        walks = np.isin(after.id[new], people(after).id)
        np.testing.assert_allclose(error[walks], 0, atol=1e-9)
        of_vehicles += error[~walks].tolist()
    # A velocity is that of the frame's end: it differs by what braking (at most 6 m/s2) and turning do in a step.
    assert max(of_vehicles) < 1.5
    assert np.mean(of_vehicles) < 0.15


@pytest.mark.parametrize("name", SCENARIOS)
def test_ids_are_unique_and_belong_to_one_body(name: str) -> None:
    bodies: dict[int, tuple[int, ...]] = {}
    for actors in frames(make_world(name, 0), 60):
        assert len(set(actors.id)) == len(actors) and actors.id.min() >= 1
        looks = np.column_stack([actors.model, actors.color, actors.accent]).tolist()
        for identity, look in zip(actors.id.tolist(), looks, strict=True):
            assert bodies.setdefault(identity, tuple(look)) == tuple(look)


def test_boxes_stand_on_the_ground_and_have_their_models_size() -> None:
    world = make_world("crossing")
    actors = world.actors()
    np.testing.assert_array_equal(actors.boxes.center[:, 2], actors.boxes.size[:, 2] / 2)
    np.testing.assert_array_equal(actors.boxes.size, [world.models[model].size_m for model in actors.model])
    np.testing.assert_array_equal(actors.label, [world.models[model].label for model in actors.model])


def test_people_go_through_their_poses_as_far_as_they_walk() -> None:
    world = make_world("crossing", 2, vehicles=3, connected_cars=1, pedestrians=30)
    cycle_m = np.array([model.cycle_m for model in world.models])
    seen = [people(actors) for actors in frames(world, 100)]
    turned = np.sum([np.mod(after.phase - before.phase, 1.0) for before, after in pairwise(seen)], axis=0)
    walked_m = np.sum([np.linalg.norm(actors.velocity, axis=1) * DT_S for actors in seen[1:]], axis=0)
    np.testing.assert_allclose(turned * cycle_m[seen[0].model], walked_m, atol=1e-6)
    assert walked_m.max() > 5.0
    assert len(np.unique(seen[0].phase)) == 30  # nobody in step
    assert (vehicles(world.actors()).phase >= 0).all()


@pytest.mark.parametrize("name", SCENARIOS)
def test_long_steps_are_as_safe_as_short_ones(name: str) -> None:
    long, short = (make_world(name, 0, vehicles=18) for _ in range(2))
    for _ in range(20):
        long.step(0.5)
        for _ in range(5):
            short.step(0.1)
    np.testing.assert_allclose(table(long.actors()), table(short.actors()), atol=1e-6)
    assert long.crashed() == ()
