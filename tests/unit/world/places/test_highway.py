"""The highway: connected cars stay in company, traffic is renewed around them and passes, policies can drive."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from worlds import DT_S, frames, make_world, place_of, speed_of

from coopsim.types.messages import MANEUVERS
from coopsim.world.models import make_models
from coopsim.world.places.highway import make_highway
from coopsim.world.population import Population
from coopsim.world.traffic.traffic import Traffic
from coopsim.world.world import World

CARS = ("cav_0", "cav_1", "cav_2")


def drive(world: World, maneuver: str, steps: int) -> None:
    for _ in range(steps):
        world.step(DT_S, {"cav_0": MANEUVERS.index(maneuver)})


def test_connected_cars_stay_together_while_others_pass() -> None:
    # Measured over 1000 steps and seeds 0 to 9: at most 99 m from the first to the last, no crash.
    world = make_world("highway", 1)
    side_of: dict[int, bool] = {}
    passed = set()
    for actors in frames(world, 450):
        along = [place_of(world, car)[0] for car in CARS]
        assert np.ptp(along) < 150
        for identity, box, velocity in zip(actors.id.tolist(), actors.boxes.center, actors.velocity, strict=True):
            ahead = bool(box[0] > along[0])
            if velocity[0] > 0 and side_of.setdefault(identity, ahead) != ahead:
                passed.add(identity)
            side_of[identity] = ahead
    assert len(passed) >= 3
    assert world.crashed() == ()


def test_traffic_is_renewed_around_the_connected_cars() -> None:
    world = make_world("highway", 0)
    first, *_, last = seen = list(frames(world, 400))
    middle = np.mean([place_of(world, car)[0] for car in CARS])
    assert middle > 500  # far from where everybody started
    for actors in (first, last):
        assert len(actors) == 30
    assert (np.abs(last.boxes.center[:, 0] - middle) < 350).all()
    assert (np.abs(last.boxes.center[:, 0] - middle) < 100).sum() >= 8
    for before, after in pairwise(seen):
        new = np.setdiff1d(after.id, before.id)
        assert (new > before.id.max()).all()  # never one that was used before
    assert {world.agents()[car].actor_id for car in CARS} <= set(first.id.tolist())
    assert last.id.max() > 40


def test_traffic_flows_past_a_lone_roadside_unit() -> None:
    world = make_world("highway", 0, vehicles=14, connected_cars=0)
    *seen, last = frames(world, 300)
    assert (np.abs(last.boxes.center[:, 0]) < 250).all()
    assert {np.sign(velocity) for velocity in last.velocity[:, 0]} == {-1, 1}
    came_and_went, frames_stayed = np.unique(
        [k for actors in seen for k in np.setdiff1d(actors.id, [*seen[0].id, *last.id])], return_counts=True
    )
    assert len(came_and_went) >= 5
    assert frames_stayed.min() > 100  # who enters drives through, and not out again at once


def test_a_connected_car_is_never_replaced_even_if_it_goes_the_other_way() -> None:
    world = make_world("highway", 0, vehicles=10, truck_share=0.0, connected_cars=10)
    cars = {body.actor_id for body in world.agents().values() if body.kind == "cav"}
    *_, last = frames(world, 200)
    assert {np.sign(velocity) for velocity in last.velocity[:, 0]} == {-1, 1}
    assert set(last.id.tolist()) == cars


@pytest.mark.parametrize(("maneuver", "reached_m_s"), [("faster", 30.0), ("idle", 25.0), ("slower", 20.0)])
def test_speed_maneuvers(maneuver: str, reached_m_s: float) -> None:
    world = make_world("highway", 0, vehicles=3, control="policy", connected_cars=1)
    drive(world, maneuver, 40)
    assert speed_of(world, "cav_0") == pytest.approx(reached_m_s, abs=0.2)


@pytest.mark.parametrize(("maneuver", "lanes_left"), [("lane_left", 1), ("idle", 0), ("lane_right", -1)])
def test_lane_maneuvers(maneuver: str, lanes_left: int) -> None:
    world = make_world("highway", 1, vehicles=3, truck_share=0.0, control="policy", connected_cars=1)
    before = world.agents()["cav_0"].world_SE3_base.inverse()
    assert place_of(world, "cav_0")[1] == -8.0  # the middle one of three lanes
    drive(world, maneuver, 1)
    drive(world, "idle", 40)
    moved = before.compose(world.agents()["cav_0"].world_SE3_base).translation
    assert moved[1] == pytest.approx(4.0 * lanes_left, abs=0.1)  # base frame: y to the left


def test_maneuvers_are_ignored_unless_a_policy_drives() -> None:
    told, free = (make_world("highway", 0, vehicles=6) for _ in range(2))
    drive(told, "lane_left", 30)
    *_, last = frames(free, 30)
    np.testing.assert_array_equal(told.actors().boxes.array, last.boxes.array)


def test_a_car_that_is_driven_into_another_stays_as_an_obstacle() -> None:
    world = make_world("highway", 0, vehicles=20, control="policy")
    driven = world.agents()["cav_0"].actor_id
    while driven not in world.crashed():
        assert place_of(world, "cav_0")[0] < 1500, "nobody was hit"
        drive(world, "faster", 1)
    wrecks = world.crashed()
    assert len(wrecks) >= 2
    drive(world, "faster", 100)
    place = place_of(world, "cav_0")
    drive(world, "faster", 50)
    assert speed_of(world, "cav_0") < 0.01
    np.testing.assert_allclose(place_of(world, "cav_0"), place, atol=0.05)
    assert set(wrecks) <= set(world.crashed()) <= set(world.actors().id.tolist())


def test_a_layout_need_not_rank_all_of_its_slots() -> None:
    layout = replace(make_highway(), connected_order=(0,))
    traffic = Traffic(layout, Population(vehicles=12, connected_cars=1, pedestrians=0), make_models(), 0)
    assert len(traffic.fleet.rows) == 12 and len(traffic.connected) == 1
