"""Environments that follow logs."""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

import coopsim
from coopsim.data.logs.play.choice import Wish, choose
from coopsim.data.logs.reading import read_log
from coopsim.errors import InvalidValueError, UnknownNameError
from coopsim.world.drawn_places import choose_scenarios


@pytest.fixture(scope="module")
def log_path(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Write a log of 12 s: four cars in a row, one that leaves early, one far away, and a person."""
    rows = ["time_s,id,class,x_m,y_m,length_m,width_m,height_m"]
    for k in range(121):
        for name, first_m in (("a", 0.0), ("b", 15.0), ("c", 30.0), ("d", 45.0), ("far", 900.0)):
            rows.append(f"{k / 10},{name},car,{first_m + 0.8 * k:.3f},0,4.37,1.84,1.52")
        if k < 50:
            rows.append(f"{k / 10},early,car,{-20 + 0.8 * k:.3f},4,4.5,1.8,1.5")
        rows.append(f"{k / 10},walker,pedestrian,40,{6 + 0.1 * k:.3f},0.5,0.6,1.8")
    path = tmp_path_factory.mktemp("log") / "street.csv"
    path.write_text("\n".join(rows))
    return path


def test_road_users_are_where_the_log_has_them(log_path: Path) -> None:
    scenario = choose_scenarios(str(log_path), connected_cars=2, start_s=1.0, least_s=5.0).of(5)
    assert scenario.played is not None
    world, log = scenario.played.world(scenario, 5), read_log(log_path)
    names = scenario.played.facts["log_cars"]
    offset = None
    for step in range(30):
        now, actors = log.at(1.0 + step / 10), world.actors()
        assert now.place[now.track == log.ids.index("far")].shape == (1, 3)
        for k, name in enumerate(names):
            body = world.agents()[f"cav_{k}"]
            row = int(np.flatnonzero(actors.id == body.actor_id)[0])
            logged = now.place[np.flatnonzero(now.track == log.ids.index(name))[0], :2]
            offset = logged - actors.boxes.center[row, :2] if offset is None else offset
            np.testing.assert_allclose(actors.boxes.center[row, :2] + offset, logged, atol=1e-9)
            np.testing.assert_allclose(body.world_SE3_base.translation[:2], actors.boxes.center[row, :2])
            np.testing.assert_allclose(actors.boxes.size[row], [4.37, 1.84, 1.52])
        assert len(actors) == len(now) - 1  # all but the far one
        world.step(0.1)


def test_an_environment_of_a_log_is_seeded_and_ends_with_its_cars(log_path: Path) -> None:
    scores = []
    for _ in range(2):
        env = coopsim.parallel_env(str(log_path), cars="early", start_s=4.0, least_s=0.5, lidar_columns=60)
        coopsim.run_episode(env, coopsim.make_policy("no_fusion"), seed=3)
        assert env.agents == []
        scores.append(env.score())
        env.close()
    assert repr(scores[0]) == repr(scores[1])


def test_only_cars_that_stay_are_connected(log_path: Path) -> None:
    log = read_log(log_path)
    for seed in range(20):
        found = choose(log, Wish(connected=3, start_s=0.0, least_s=6.0), seed)
        names = [found.log.ids[k] for k in found.connected]
        assert not {"early", "far", "walker"} & set(names)
        assert found.end_s == 12.0
    assert len({tuple(choose(log, Wish(connected=3), seed).connected.tolist()) for seed in range(20)}) > 3


def test_same_seed_same_choice(log_path: Path) -> None:
    log = read_log(log_path)
    one, other = (choose(log, Wish(connected=2), 7) for _ in range(2))
    assert (one.start_s, one.connected.tolist(), one.middle.tolist()) == (
        other.start_s,
        other.connected.tolist(),
        other.middle.tolist(),
    )


def test_an_episode_ends_when_the_first_connected_car_leaves(log_path: Path) -> None:
    found = choose(read_log(log_path), Wish(connected=1, ids=("early",), start_s=0.0, least_s=2.0), 0)
    assert found.end_s == pytest.approx(4.9)


@pytest.mark.parametrize(
    ("options", "error", "said"),
    [
        ({"connected_cars": 9}, InvalidValueError, "at most"),
        ({"cars": "a,ghost"}, UnknownNameError, "ghost"),
        ({"cars": ("a", "a")}, InvalidValueError, "different names"),
        ({"cars": "early", "least_s": 8}, InvalidValueError, "the cars early"),
        ({"cars": "a", "connected_cars": 2}, InvalidValueError, "must be left out"),
        ({"least_s": 40}, InvalidValueError, "least_s must be at most 12.0"),
        ({"start_s": 99}, InvalidValueError, "start_s=99"),
        ({"vehicles": 4}, UnknownNameError, "vehicles"),
        ({"density": 2}, InvalidValueError, "density must be 1"),
        ({"control": "policy"}, coopsim.CoopsimError, "control"),
        ({"lots": True, "map": "gone.xodr"}, InvalidValueError, "lots"),
        ({"others": "acc"}, coopsim.CoopsimError, "others"),
        ({"control": "planner", "driven_agents": ("cav_7",)}, coopsim.CoopsimError, "cav_7"),
        ({"radius_m": 5}, InvalidValueError, "radius_m"),
        ({"map": "gone.xodr"}, coopsim.CoopsimError, "gone.xodr"),
        ({"rsus": 1}, InvalidValueError, "rsus must be at most 0"),
    ],
)
def test_wrong_options_are_one_line(
    log_path: Path, options: dict[str, object], error: type[Exception], said: str
) -> None:
    with pytest.raises(error) as found:
        coopsim.parallel_env(str(log_path), **options)
    assert said in str(found.value)
    assert "\n" not in str(found.value)


def test_cars_of_a_smaller_share_are_among_those_of_a_larger(log_path: Path) -> None:
    log, drawn = read_log(log_path), set()
    for seed in range(6):
        names = []
        for connected in range(1, 5):
            wish = Wish(connected=connected, start_s=1.0, around=(30.0, 0.0), least_s=5.0)
            choice = choose(log, wish, seed)
            names.append([choice.log.ids[k] for k in choice.connected])
        assert all(more[: len(few)] == few for few, more in pairwise(names))
        drawn.add(names[0][0])
    assert len(drawn) > 1


def test_lots_are_drawn_where_nobody_ever_goes(log_path: Path) -> None:
    scenario = choose_scenarios(str(log_path), cars="a", start_s=1.0, lots=True).of(5)
    again = choose_scenarios(str(log_path), cars="a", start_s=1.0, lots=True).of(5)
    none = choose_scenarios(str(log_path), cars="a", start_s=1.0).of(5)
    assert scenario.played is not None and none.played is not None
    houses = [part for part in scenario.static if part.name == "building"]
    outlines = scenario.layout.road_map.buildings
    assert len(houses) == scenario.played.facts["log_lots"] == len(outlines) > 5
    assert "log_lots" not in none.played.facts and len(none.static) == 1
    assert all((a == b).all() for a, b in zip(outlines, again.layout.road_map.buildings, strict=True))
    log = read_log(log_path)
    middle = choose(log, Wish(connected=1, ids=("a",), start_s=1.0), 5).middle
    for outline in outlines:
        low, high = outline.min(axis=0) + middle, outline.max(axis=0) + middle  # ways are along x or y
        outside = np.maximum(low - log.place[:, :2], log.place[:, :2] - high).max(axis=1)
        assert outside.min() > 3.9
