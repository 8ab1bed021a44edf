"""Cars that leave their log, and what others then do."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import coopsim
from coopsim.data.logs.play.logged_world import LoggedWorld
from coopsim.data.logs.reading import read_log
from coopsim.data.logs.track_log import TrackLog
from coopsim.interfaces.planner import PlannedCar, Planner
from coopsim.types.driving import NOBODY_FIRST
from coopsim.world.drawn_places import choose_scenarios

Motion = Callable[[float], tuple[float, float] | None]
"""Place of a road user by time; None: it is not there."""

ROW: Mapping[str, Motion] = {
    "a": lambda t: (8 * t, 0.0),
    "b": lambda t: (8 * t - 15, 0.0),
    "c": lambda t: (8 * t + 40, 0.0),
}
"""Cars in a row along x, at 8 m/s: b, a, c."""


def write(path: Path, motions: Mapping[str, Motion], seconds: float = 12.0, kind: str = "car") -> str:
    rows = ["time_s,id,class,x_m,y_m,length_m,width_m,height_m"]
    for name, motion in motions.items():
        for k in range(round(10 * seconds) + 1):
            place = motion(k / 10)
            if place is not None:
                rows.append(f"{k / 10},{name},{kind},{place[0]:.6f},{place[1]:.6f},4.5,1.8,1.5")
    path.write_text("\n".join(rows))
    return str(path)


def world_of(log: str, cars: str, control: str = "acceleration", **options: Any) -> LoggedWorld:
    around = {"around": (0.0, 0.0), "least_s": 2.0, "start_s": 0.0}
    scenario = choose_scenarios(log, cars=cars, **around | options).of(0)
    assert scenario.played is not None
    world = scenario.played.world(scenario, 0, control=control)
    assert isinstance(world, LoggedWorld)
    return world


def places(world: LoggedWorld, log: TrackLog) -> dict[str, tuple[float, float, float]]:
    """Return x, y and speed by name; all tracks of the log are near."""
    actors = world.actors()
    rows = zip(actors.id.tolist(), actors.boxes.center.tolist(), np.hypot(*actors.velocity.T).tolist(), strict=True)
    return {log.ids[number - 1]: (x, y, speed) for number, (x, y, _), speed in rows}


def run(world: LoggedWorld, steps: int, **commands: float) -> None:
    for _ in range(steps):
        world.step(0.1, commands)


def test_a_car_begins_as_in_its_log_and_goes_on_along_its_way(tmp_path: Path) -> None:
    bend = {"a": lambda t: (40 * np.sin(0.2 * t), 40 - 40 * np.cos(0.2 * t)), "b": lambda t: (8 * t, -20.0)}
    path = write(tmp_path / "bend.csv", bend)
    world, log = world_of(path, "a"), read_log(path)
    first = places(world, log)
    assert first["a"] == pytest.approx((0.0, 0.0, 8.0), abs=0.05)
    run(world, 20, cav_0=0.0)
    same = places(world, log)
    assert same["a"][:2] == pytest.approx(bend["a"](2.0), abs=0.15)  # who keeps its speed is where the log has it
    run(world, 40, cav_0=-2.0)
    x, y, speed = places(world, log)["a"]
    assert speed == pytest.approx(0.0, abs=1e-6)
    assert np.hypot(x, y - 40) == pytest.approx(40, abs=0.02)
    assert np.hypot(x - bend["a"](6.0)[0], y - bend["a"](6.0)[1]) > 10
    assert places(world, log)["b"][:2] == pytest.approx((48.0, -20.0))


def test_the_way_ahead_is_the_logs_without_right_of_way(tmp_path: Path) -> None:
    world = world_of(write(tmp_path / "row.csv", ROW), "a")
    run(world, 5, cav_0=0.0)
    car = world.car_ahead("cav_0")
    np.testing.assert_allclose(car.route.points[:90], np.column_stack([np.arange(90.0), np.zeros(90)]), atol=1e-6)
    assert (car.route.right_of_way == NOBODY_FIRST).all()
    assert car.route.speed_limit_m_s[:80] == pytest.approx(8.0)
    assert car.speed_m_s == pytest.approx(8.0)


def test_who_follows_a_log_and_drives_into_a_car_is_told_apart(tmp_path: Path) -> None:
    path = write(tmp_path / "row.csv", ROW)
    braking, speeding = world_of(path, "a"), world_of(path, "a")
    run(braking, 60, cav_0=-4.0)
    car = braking.car_ahead("cav_0")
    assert car.crashed and car.hit_by_log
    run(speeding, 110, cav_0=3.0)
    car = speeding.car_ahead("cav_0")
    assert car.crashed and not car.hit_by_log
    assert len(speeding.crashed()) == 1  # who follows a log goes on


def test_drivers_stop_behind_a_car_that_stops(tmp_path: Path) -> None:
    path = write(tmp_path / "row.csv", ROW)
    world, log = world_of(path, "a", others="idm"), read_log(path)
    run(world, 110, cav_0=-3.0)
    now = places(world, log)
    assert now["b"][2] < 0.1
    assert 0.5 < now["a"][0] - now["b"][0] - 4.5 < 4.0
    assert not world.crashed()
    assert now["c"][2] > 7.0  # nobody is before it


CROSS: Mapping[str, Motion] = {
    "east": lambda t: (8 * t - 40, 0.0),
    "north": lambda t: (0.0, 8 * t - 52),
    "far": lambda t: (8 * t - 40, 60.0),
}
"""`east` is at the crossing after 5 s, `north` after 6.5 s."""


def test_who_came_later_in_the_log_waits(tmp_path: Path) -> None:
    path = write(tmp_path / "cross.csv", CROSS)
    world, log = world_of(path, "east", others="idm"), read_log(path)
    for step in range(90):
        world.step(0.1, {"cav_0": -2.0 if step < 15 else 1.0 if step < 35 else 0.0})  # both would meet
        now = places(world, log)
        assert not (abs(now["east"][0]) < 3 and abs(now["north"][1]) < 3)
    assert not world.crashed()
    assert now["north"][1] > -2 or now["north"][2] > 0.5


def test_nobody_waits_for_a_car_that_stands(tmp_path: Path) -> None:
    path = write(tmp_path / "cross.csv", CROSS)
    world, log = world_of(path, "east", others="idm"), read_log(path)
    run(world, 80, cav_0=-2.0)
    now = places(world, log)
    assert now["east"][0] < -10 and now["east"][2] < 0.1
    assert now["north"][1] > 5


def test_drivers_stand_as_long_as_in_the_log_without_anybody_ahead(tmp_path: Path) -> None:
    stops = {"s": lambda t: (min(8 * t, 24.0) + max(0.0, 8 * (t - 8)), 0.0), "far": lambda t: (8 * t - 40, 60.0)}
    path = write(tmp_path / "stop.csv", stops)
    world, log = world_of(path, "far", "traffic", others="idm"), read_log(path)
    run(world, 75)
    assert places(world, log)["s"][:1] == pytest.approx((24.0,), abs=1.5)
    run(world, 40)
    assert places(world, log)["s"][0] > 30


def test_who_comes_later_waits_until_there_is_room(tmp_path: Path) -> None:
    late = ROW | {"late": lambda t: (8 * (t - 4) - 2, 0.0) if t >= 4 else None}
    path = write(tmp_path / "late.csv", {name: late[name] for name in ("a", "late")} | {"c": ROW["c"]})
    world, log = world_of(path, "a", others="idm"), read_log(path)
    run(world, 10, cav_0=-8.0)
    run(world, 60, cav_0=0.0)
    assert world.car_ahead("cav_0").speed_m_s < 0.1
    assert "late" not in places(world, log)
    run(world, 40, cav_0=2.0)
    assert "late" in places(world, log)
    assert not world.crashed()


def test_an_episode_is_over_at_the_end_of_the_way(tmp_path: Path) -> None:
    path = write(tmp_path / "short.csv", ROW | {"a": lambda t: (8 * t, 0.0) if t <= 4 else None})
    quick, slow = world_of(path, "a"), world_of(path, "a")
    run(quick, 35, cav_0=3.0)
    assert quick.is_over_in(0.1)
    run(slow, 60, cav_0=-1.5)
    assert not slow.is_over_in(0.1)
    run(slow, 60, cav_0=-8.0)
    assert slow.is_over_in(0.1)  # the log


class Stops(Planner):
    """Brakes as hard as it can."""

    def plan(self, car: PlannedCar) -> float:
        return -8.0


def test_scores_and_infos_tell_who_drove_into_whom(tmp_path: Path) -> None:
    path = write(tmp_path / "row.csv", ROW)
    told = []
    for _ in range(2):
        options: dict[str, Any] = {"cars": "a", "start_s": 0.0, "lidar": None, "max_cycles": 60}
        env = coopsim.parallel_env(path, control="planner", planner=Stops, ends_on_crash=True, **options)
        policy = coopsim.make_policy("no_fusion")
        coopsim.run_episode(env, policy, seed=3)
        values = env.score().values
        assert (values["crash"], values["crash_by_log"], values["crash_at_fault"]) == (100.0, 100.0, 0.0)
        told.append(repr(values))
        env.close()
    assert told[0] == told[1]
