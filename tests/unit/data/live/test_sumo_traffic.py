"""SUMO as a live engine: positions, classes, lights, who drives, and one run in a process."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from sumo_crossing import crossing, demand, needs_sumo

import coopsim
from coopsim.data.live import engine as sumo_engine
from coopsim.data.live.demand import begin_of, circuits
from coopsim.data.live.engine import SumoEngine, SumoRun, step_for
from coopsim.data.live.sumo_world import SumoWorld
from coopsim.data.logs.floating_cars import floating_columns
from coopsim.data.maps.reading import read_map
from coopsim.errors import CoopsimError, EpisodeStateError, InvalidValueError, MapFileError, MissingDependencyError
from coopsim.types.taxonomy import ObjectClass
from coopsim.world.drawn_places import LIVE_TRAFFIC, choose_scenarios
from coopsim.world.population import Population
from coopsim.world.scenario import Scenario

PLACE: dict[str, Any] = {"around": "1000,500", "radius_m": 200, "place_seed": 0, "detail": "plain", "start_s": 160.0}
OPTIONS: dict[str, Any] = PLACE | {"traffic": "sumo", "lidar": None, "connected_cars": 1, "least_s": 1.0}
pytestmark = needs_sumo


@pytest.fixture(autouse=True)
def _free_sumo() -> Iterator[None]:
    """Let no test that fails keep SUMO from the next one."""
    yield
    holder = None if SumoEngine._holder is None else SumoEngine._holder()
    if holder is not None:
        holder.close()


@pytest.fixture(scope="module")
def network(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return crossing(tmp_path_factory.mktemp("sumo"))


@pytest.fixture(scope="module")
def trips(network: Path) -> Path:
    return demand(network.parent, begin_s=100.0)


@pytest.fixture
def played(network: Path, trips: Path) -> Iterator[tuple[SumoWorld, Scenario]]:
    drawer = LIVE_TRAFFIC.get("sumo")(str(network), 0.1)
    found = choose_scenarios(str(network), drawer=drawer, demand=trips, least_s=3.0, connected_cars=2, **PLACE)
    scenario = found.of(3)
    assert scenario.played is not None
    world = scenario.played.world(scenario, 3)
    assert isinstance(world, SumoWorld)
    yield world, scenario
    found.close()


def fronts(world: SumoWorld) -> np.ndarray:
    """Return the fronts (N, 2) of all road users in the network's plane."""
    boxes = world.actors().boxes.array
    ahead = np.column_stack([np.cos(boxes[:, 6]), np.sin(boxes[:, 6])])
    front: np.ndarray = boxes[:, :2] + 0.5 * boxes[:, 3:4] * ahead + [1000.0, 500.0]
    return front


def test_road_users_are_where_sumo_writes_them(
    played: tuple[SumoWorld, Scenario], network: Path, trips: Path, tmp_path: Path
) -> None:
    world, _ = played
    program = Path(pytest.importorskip("sumo").__file__).parent / "bin" / "sumo"
    out = tmp_path / "written.fcd.xml"
    options = sumo_engine.OPTIONS | {
        "net-file": network, "route-files": trips, "begin": 100, "step-length": 0.1, "seed": 3, "end": 165,
        "fcd-output": out, "precision": 6, "device.fcd.begin": 159,
    }  # fmt: skip
    words = [str(word) for name, value in options.items() for word in (f"--{name}", value)]
    subprocess.run([str(program), *words], check=True)
    written = floating_columns(out)
    compared = 0
    for step in range(40):
        # SUMO names its rows by the time at which a step begins.
        rows = np.flatnonzero(np.abs(written.time_s - (160.0 + 0.1 * (step - 1))) < 1e-3)
        front, actors = fronts(world), world.actors()
        apart = np.linalg.norm(front[:, None] - written.xy[rows][None], axis=-1)
        assert apart.min(axis=1).max() < 1e-5
        at = rows[apart.argmin(axis=1)]
        assert written.velocity is not None
        np.testing.assert_allclose(actors.velocity, written.velocity[at], atol=1e-5)
        compared += len(front)
        world.step(0.1)
    assert compared > 400


def test_classes_sizes_and_people_are_sumos(played: tuple[SumoWorld, Scenario]) -> None:
    world, scenario = played
    engine = scenario.played.engine  # type: ignore[union-attr]
    users = engine.users()
    label = {name: int(engine.label[kind]) for name, kind in zip(users.names, users.kind, strict=True)}
    assert label["person p"] == ObjectClass.PEDESTRIAN
    known = dict(zip(engine.sumo.vehicletype.getIDList(), engine.label.tolist(), strict=True))
    assert known["passenger"] == ObjectClass.CAR and known["tram"] == ObjectClass.BUS
    assert [known[each] for each in ("bus", "truck", "delivery")] == [
        ObjectClass.BUS,
        ObjectClass.TRUCK,
        ObjectClass.VAN,
    ]
    assert [known[each] for each in ("motorcycle", "bicycle")] == [ObjectClass.MOTORCYCLE, ObjectClass.BICYCLE]
    actors = world.actors()
    cars = actors.label == ObjectClass.CAR
    assert cars.any()
    np.testing.assert_allclose(actors.boxes.size[cars], np.tile([5.0, 1.8, 1.5], (int(cars.sum()), 1)))


def test_only_the_place_is_in_the_world_and_ids_stay(played: tuple[SumoWorld, Scenario]) -> None:
    world, scenario = played
    engine = scenario.played.engine  # type: ignore[union-attr]
    seen: dict[str, int] = {}
    for _ in range(30):
        users, actors = engine.users(), world.actors()
        near = np.linalg.norm(users.place - [1000.0, 500.0], axis=1) <= 200.0
        assert near.sum() == len(actors) < len(users.names)
        for name, number in zip(np.array(users.names)[near], actors.id.tolist(), strict=True):
            assert seen.setdefault(name, number) == number
        world.step(0.1)
    assert len({*seen.values()}) == len(seen)


def test_lights_are_sumos(played: tuple[SumoWorld, Scenario]) -> None:
    world, scenario = played
    engine = scenario.played.engine  # type: ignore[union-attr]
    (name,) = engine.sumo.trafficlight.getIDList()
    ways = {
        (start[0], end[1]): number
        for number, ((start, end, _), *_) in enumerate(engine.sumo.trafficlight.getControlledLinks(name))
        if not start.startswith(":")
    }
    arms = {"e": (1, 0), "n": (0, 1), "w": (-1, 0), "s": (0, -1)}
    shown = set()
    for _ in range(60):
        world.step(1.0)
        state = engine.sumo.trafficlight.getRedYellowGreenState(name)
        assert len(world.map.lights) == len(world.map.stop_lines) > 0
        for line, letter in zip(world.map.stop_lines, world.map.lights, strict=True):
            arm = max(arms, key=lambda each: float(line.mean(axis=0) @ arms[each]))
            assert letter in {state[number] for (start, _), number in ways.items() if start == arm}
            shown.add(letter)
    assert {"G", "r", "y"} <= shown


def test_same_seed_same_bits(network: Path, trips: Path) -> None:
    scores = []
    for seed in (4, 4, 5):
        env = coopsim.parallel_env(str(network), demand=trips, max_cycles=20, **OPTIONS)
        coopsim.run_episode(env, coopsim.make_policy("no_fusion"), seed=seed)
        scores.append(env.episode.frame.actors.boxes.array.tobytes() + repr(env.score()).encode())
        env.close()
    assert scores[0] == scores[1] != scores[2]


@pytest.mark.parametrize("control", ["acceleration", "planner"])
def test_agents_drive_on_sumos_lanes(network: Path, trips: Path, control: str) -> None:
    env = coopsim.parallel_env(str(network), demand=trips, max_cycles=25, control=control, **OPTIONS)
    env.reset(seed=1)
    world: Any = env._source._world  # type: ignore[attr-defined]
    before = world.car_ahead("cav_0")
    assert np.linalg.norm(before.route.points[0]) < 2.0
    assert 0.0 < before.route.speed_limit_m_s.max() <= 13.9
    if control == "planner":
        coopsim.run_episode(env, coopsim.make_policy("no_fusion"), seed=1)
        assert env.agents == [] and world.car_ahead("cav_0").speed_m_s >= 0.0
        env.close()
        return
    speeds = [before.speed_m_s]
    for _ in range(10):
        world.step(0.1, {"cav_0": -2.0})
        speeds.append(world.car_ahead("cav_0").speed_m_s)
    np.testing.assert_allclose(np.diff(speeds), np.maximum(-0.2, -np.array(speeds[:-1])), atol=1e-6)
    env.close()


def test_a_car_that_is_driven_into_another_crashes_and_both_stand(played: tuple[SumoWorld, Scenario]) -> None:
    world, _ = played
    for _ in range(300):
        world.step(0.1, {"cav_0": 3.0, "cav_1": 3.0})
        if world.crashed():
            break
    assert set(world.crashed()) & {1, 2}
    where = {name: body.world_SE3_base for name, body in world.agents().items()}
    hit = [f"cav_{number - 1}" for number in world.crashed() if number <= 2]
    for _ in range(5):
        world.step(0.1, {"cav_0": 3.0, "cav_1": 3.0})
    for name in hit:
        assert world.car_ahead(name).crashed
        moved = where[name].inverse().apply(world.agents()[name].world_SE3_base.translation[None])[0]
        assert abs(moved[0]) < 0.05  # it may go on to the side, where it was changing its lane


def test_an_episode_ends_when_a_connected_car_arrives(network: Path, trips: Path) -> None:
    env = coopsim.parallel_env(str(network), demand=trips, max_cycles=90, dt_s=1.0, **OPTIONS | {"radius_m": 600.0})
    coopsim.run_episode(env, coopsim.make_policy("no_fusion"), seed=2)
    frame = env.episode.frame
    assert frame.time_ns < 60e9 and "cav_0" in frame.agents
    env.close()


def test_the_second_environment_of_a_process_is_refused(network: Path, trips: Path) -> None:
    options = OPTIONS | {"demand": trips}
    first = coopsim.parallel_env(str(network), **options)
    with pytest.raises(EpisodeStateError, match="runs once in a process: close that one"):
        coopsim.parallel_env(str(network), **options)
    first.close()
    second = coopsim.parallel_env(str(network), **options)
    second.reset(seed=0)
    second.close()


def test_a_town_is_driven_by_sumo(network: Path) -> None:
    streets = read_map(network)
    text = circuits(streets, Population(vehicles=6, truck_share=0.5, buses=1, pedestrians=3), 1)
    engine = SumoEngine()
    engine.start(SumoRun(network, text, 1, 0.1, 0.0))
    engine.go_on(200.0)
    users = engine.users()
    engine.close()
    labels = np.bincount(engine.label[users.kind], minlength=9)
    assert labels[ObjectClass.CAR] == 3 and labels[ObjectClass.TRUCK] == 3 and labels[ObjectClass.BUS] == 1
    assert labels[ObjectClass.PEDESTRIAN] == 3


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"dt_s": 0.0333}, "dt_s must be of whole milliseconds"),
        ({"start_s": 5.0}, "start_s must be at least 100, the first departure"),
        ({"start_s": 600.0}, "there is no road user in it"),
        ({"demand": "nowhere.rou.xml"}, "no file nowhere.rou.xml"),
        ({"density": 2.0}, "density must be 1"),
        ({"vehicles": 20}, "unknown option of a network"),
        ({"control": "policy"}, "Accepted: acceleration, planner, traffic"),
        ({"rsus": 40}, "rsus must be at most"),
        ({"control": "steering"}, "Accepted: acceleration, planner, traffic"),
        ({"signal_messages": True}, "unknown traffic with signal_messages"),
    ],
)
def test_wrong_options_are_refused_in_one_line(
    network: Path, trips: Path, options: dict[str, Any], message: str
) -> None:
    with pytest.raises(CoopsimError, match=message) as caught:
        coopsim.parallel_env(str(network), **OPTIONS | {"demand": trips} | options)
    assert "\n" not in str(caught.value)


def test_what_sumo_says_of_a_wrong_demand_is_told(network: Path) -> None:
    wrong = '<routes><trip id="a" depart="0" from="nowhere" to="ce"/></routes>'
    with pytest.raises(MapFileError, match="The edge 'nowhere' within the route for trip 'a' is not known") as caught:
        SumoEngine().start(SumoRun(network, wrong, 0, 0.1, 0.0))
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("scenario", ["crossing", "log.fcd.xml", "Town05.xodr"])
def test_other_scenarios_are_refused(scenario: str) -> None:
    with pytest.raises(InvalidValueError, match="needs a network of SUMO"):
        coopsim.parallel_env(scenario, traffic="sumo")


def test_without_libsumo_its_extra_is_named(network: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "libsumo", None)
    with pytest.raises(MissingDependencyError, match=r"pip install 'coopsim\[sumo\]'"):
        coopsim.parallel_env(str(network), **OPTIONS)


@pytest.mark.parametrize(("dt_s", "step_s"), [(0.1, 0.1), (0.05, 0.05), (1.0, 0.1), (0.25, 0.05), (0.033, 0.033)])
def test_steps_divide_the_time_between_frames(dt_s: float, step_s: float) -> None:
    assert step_for(dt_s) == step_s


def test_a_demand_begins_with_its_first_departure(trips: Path, tmp_path: Path) -> None:
    assert begin_of(trips) == 100.0
    file = tmp_path / "x.rou.xml"
    file.write_text('<routes><flow id="a" begin="1:00:05" end="7200" period="5" from="wc" to="ce"/></routes>')
    assert begin_of(file) == 3605.0
    file.write_text("<routes/>")
    with pytest.raises(MapFileError, match="has no road user"):
        begin_of(file)
