"""A car that drives by accelerations follows its way, and the way leads where the car then goes."""

from __future__ import annotations

import numpy as np
import pytest
from worlds import make_world

from coopsim.types.driving import GIVES_WAY, HAS_PRIORITY, JERK_M_S3

DT_S = 0.1


def names(world: object) -> list[str]:
    return [name for name in world.agents() if name.startswith("cav_")]  # type: ignore[attr-defined]


@pytest.mark.parametrize("place", ["crossing", "roundabout", "urban_grid", "t_junction", "highway", "merge"])
def test_a_car_drives_along_the_way_that_it_was_told(place: str) -> None:
    world = make_world(place, 3, vehicles=3, control="acceleration")
    (name, *_) = names(world)
    told, pose = world.car_ahead(name).route, world.agents()[name].world_SE3_base
    told_there = np.column_stack([told.points, np.zeros(len(told.points))]) @ pose.rotation.T + pose.translation
    gone_m, away = 0.0, []
    for _ in range(80):
        state = world.car_ahead(name)
        if state.crashed or gone_m > 60:
            break
        slow = np.clip(6.0 - state.speed_m_s, -3.0, 2.0)
        world.step(DT_S, {each: float(slow) for each in names(world)})
        gone_m += state.speed_m_s * DT_S
        at = world.agents()[name].world_SE3_base.translation[:2]
        away.append(np.hypot(*(told_there[:, :2] - at).T).min())
    assert gone_m > 20 and max(away) < 1.0
    assert (told.speed_limit_m_s > 1).all() and set(told.right_of_way.tolist()) <= {GIVES_WAY, 0, HAS_PRIORITY}


def test_points_lie_at_equal_distances_from_the_car_on() -> None:
    world = make_world("roundabout", 1, vehicles=4, control="acceleration")
    for name in names(world):
        route = world.car_ahead(name).route
        assert np.hypot(*route.points[0]) < 0.6
        steps = np.hypot(*np.diff(route.points, axis=0).T)
        assert steps.min() > 0.85 and steps.max() < 1.15
        assert (np.diff(route.points, axis=0)[0] @ [1, 0]) > 0.9


def test_asking_for_the_way_changes_nothing() -> None:
    asked, silent = (make_world("urban_grid", 5, vehicles=6, control="acceleration") for _ in range(2))
    for _ in range(60):
        for name in names(asked):
            asked.car_ahead(name)
        for world in (asked, silent):
            world.step(DT_S, dict.fromkeys(names(world), 0.3))
    np.testing.assert_array_equal(asked.actors().boxes.array, silent.actors().boxes.array)


def test_brakes_build_up_and_a_car_does_not_reverse() -> None:
    world = make_world("crossing", 2, vehicles=3, control="acceleration")
    (name, *_) = names(world)
    accelerations = []
    for _ in range(40):
        world.step(DT_S, {name: -8.0})
        accelerations.append(world.car_ahead(name).acceleration_m_s2)
    assert accelerations[0] == pytest.approx(-JERK_M_S3 * DT_S) and min(accelerations) == pytest.approx(-8.0)
    assert world.car_ahead(name).speed_m_s == pytest.approx(0.0, abs=1e-9)


def test_other_vehicles_brake_for_a_car_that_stops() -> None:
    world = make_world("highway", 4, vehicles=24, connected_cars=1, control="acceleration")
    for _ in range(200):
        world.step(DT_S, {"cav_0": -1.5})
    assert world.car_ahead("cav_0").speed_m_s == pytest.approx(0.0, abs=1e-9)
    assert not world.crashed()


def test_the_way_in_a_bend_has_a_limit_by_its_radius() -> None:
    world = make_world("roundabout", 0, vehicles=6, control="acceleration")
    limits = np.concatenate([world.car_ahead(name).route.speed_limit_m_s for name in names(world)])
    assert limits.min() < 0.8 * limits.max()
