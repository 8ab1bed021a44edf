"""Driven cars in a whole environment: by accelerations and by planners, to the end of an episode."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

import coopsim
from coopsim.envs.wrappers import BevImage, Driving, FixedTracks
from coopsim.errors import InvalidActionError, PlannerError
from coopsim.interfaces.planner import PlannedCar, Planner
from coopsim.types import Tracks
from coopsim.wire.actions import pack_tracks
from coopsim.world.world import World

Make = Callable[..., Any]

NOTHING = {"tracks": pack_tracks(Tracks.empty())}
QUICK: dict[str, Any] = {"lidar": None, "pedestrians": 0, "rsus": 0}


def drive(env: Any, seed: int, *, acceleration: float | None = None, policy: str | None = None) -> list[dict[str, Any]]:
    """Step to the episode's end; return all positions by agent, and what the last step said."""
    observations, _ = env.reset(seed=seed)
    tracker = None if policy is None else coopsim.make_policy(policy)
    if tracker is not None:
        tracker.reset(env.agent_specs)
    history: list[dict[str, Any]] = []
    while env.agents:
        actions = {name: dict(NOTHING) for name in env.agents} if tracker is None else tracker.act(observations)
        if acceleration is not None:
            for name, spec in env.agent_specs.items():
                if spec.drives:
                    actions[name]["acceleration_m_s2"] = acceleration
        observations, _, terminated, truncated, _ = env.step(actions)
        rows = env.state()
        history.append({"state": rows, "terminated": terminated, "truncated": truncated})
    return history


def speeds(history: list[dict[str, Any]], actor: int) -> list[float]:
    """Return an actor's speed in each frame, m/s."""
    rows = [step["state"][step["state"][:, 0] == actor][0] for step in history]
    return [float(np.hypot(*row[9:11])) for row in rows]


def test_accelerations_drive_the_car_along_its_route(make_small: Make) -> None:
    env = make_small(control="acceleration", vehicles=1, connected_cars=1, max_cycles=30, **QUICK)
    (actor,) = [int(row[0]) for row in env_state(env, seed=1) if row[0]]
    faster = speeds(drive(env, 1, acceleration=1.0), actor)
    slower = speeds(drive(env, 1, acceleration=-5.0), actor)
    # Speeds are of the box over a step: the first ones still build up the acceleration.
    assert np.diff(faster)[3:12] == pytest.approx(0.1, abs=0.02)
    assert slower[-1] == pytest.approx(0.0, abs=1e-6)


def env_state(env: Any, seed: int) -> Any:
    env.reset(seed=seed)
    return env.state()


@pytest.mark.parametrize("given", [None, "x", np.nan, np.inf, 3.1, -8.1, [1.0, 2.0], {}])
def test_a_bad_acceleration_changes_nothing(make_small: Make, given: Any) -> None:
    env = make_small(control="acceleration", connected_cars=1, **QUICK)
    env.reset(seed=0)
    before = env.state()
    with pytest.raises(InvalidActionError, match=r"cav_0: .*acceleration_m_s2"):
        env.step({"cav_0": NOTHING | {"acceleration_m_s2": given}})
    np.testing.assert_array_equal(env.state(), before)
    env.step({"cav_0": NOTHING | {"acceleration_m_s2": np.float32([-8.0])}})


def test_only_driven_agents_have_commands_and_the_others_drive_on(make_small: Make) -> None:
    env = make_small(control="acceleration", driven_agents=["cav_1"], connected_cars=3, max_cycles=40, **QUICK)
    assert [name for name, spec in env.agent_specs.items() if spec.drives] == ["cav_1"]
    assert set(env.action_space("cav_0").spaces) == {"tracks"}
    history = drive(env, 3, acceleration=-8.0)
    bodies = {name: agent.body.actor_id for name, agent in env.episode.frame.agents.items()}
    assert max(speeds(history, bodies["cav_1"])[-5:]) == 0.0
    assert max(max(speeds(history, bodies[name])) for name in ("cav_0", "cav_2")) > 3.0


def test_a_crash_terminates_the_episode_for_all(make_small: Make) -> None:
    """A car that accelerates, come what may, runs into the standing traffic of a crowded street before long."""
    options = {"control": "acceleration", "vehicles": 25, "connected_cars": 3, "max_cycles": 400, "lidar": None}
    ended = []
    for seed in range(4):
        history = drive(make_small(ends_on_crash=True, driven_agents=["cav_0"], **options), seed, acceleration=2.0)
        last = history[-1]
        assert all(last["terminated"].values()) != all(last["truncated"].values())
        ended.append(all(last["terminated"].values()))
        assert not any(any(step["terminated"].values()) for step in history[:-1])
    assert any(ended)


def play(policy: str | None, seed: int, situation: str = "crossing_path", **options: Any) -> tuple[bool, Any]:
    """Play a situation; return whether the ego crashed, and its drive. Without a policy nothing is reported."""
    tracker = None if policy is None else coopsim.make_policy(policy)
    uplink = "none" if tracker is None else tracker.needs.uplink
    env = coopsim.parallel_env(situation, uplink=uplink, lidar=None, **options)
    observations, infos = env.reset(seed=seed)
    if tracker is not None:
        tracker.reset(env.agent_specs)
    terminated: dict[str, bool] = {}
    while env.agents:
        actions = dict.fromkeys(env.agents, NOTHING) if tracker is None else tracker.act(observations, infos)
        observations, _, terminated, _, infos = env.step(actions)
    return terminated["cav_0"], env.records["drives"]["cav_0"].drive


@pytest.mark.parametrize("seed", [0, *(pytest.param(seed, marks=pytest.mark.long) for seed in (1, 2))])
def test_planners_drive_by_the_reported_tracks(seed: int) -> None:
    """Told nothing, the ego crashes into what comes from behind the corner; told the truth it does not."""
    told = play("truth", seed, expose_ground_truth=True)
    assert play(None, seed)[0] and not told[0]
    np.testing.assert_array_equal(told[1].command_m_s2, play("truth", seed, expose_ground_truth=True)[1].command_m_s2)


def test_a_planner_gets_nothing_of_the_truth() -> None:
    """Whether the truth is exposed to the caller changes no plan."""
    hidden, exposed = (play("no_fusion", 1, expose_ground_truth=shown)[1] for shown in (False, True))
    np.testing.assert_array_equal(hidden.command_m_s2, exposed.command_m_s2)
    assert np.nanmin(hidden.command_m_s2) < -1.0


def test_the_latency_of_messages_reaches_the_planner() -> None:
    """With late messages the track of the car behind the corner comes later, and so do the plans."""
    options = {"lidar": None, "penetration": 1.0, "rsus": 1, "max_cycles": 40}
    soon, late = (
        coopsim.evaluate("late_fusion", "crossing_path", seed=2, latency_s=each, **options).score for each in (0.0, 1.5)
    )
    assert soon["lead_time"] - late["lead_time"] > 1.0


class Broken(Planner):
    """A planner that goes wrong in its third call."""

    answer: Any = float("nan")

    def __init__(self) -> None:
        self.calls = 0

    def plan(self, car: PlannedCar) -> float:
        self.calls += 1
        if self.calls < 3:
            return 0.0
        if isinstance(self.answer, Exception):
            raise self.answer
        return self.answer  # type: ignore[no-any-return]


@pytest.mark.parametrize(
    ("answer", "match"),
    [
        pytest.param(10**400, r"at 0.20 s returned 1000\d*\.\.\.0*; accepted: a finite acceleration", id="no float"),
        pytest.param(10**5000, "at 0.20 s returned .*; accepted: a finite acceleration", id="an endless integer"),
        (float("nan"), "Broken of cav_0 at 0.20 s returned nan; accepted: a finite acceleration"),
        (None, "returned None"),
        (True, "returned True"),
        (np.zeros(2), "returned array"),
        (ZeroDivisionError("by nought"), "raised ZeroDivisionError: by nought"),
    ],
)
def test_a_broken_planner_is_named_and_the_next_episode_runs(make_small: Make, answer: Any, match: str) -> None:
    kind = type("Broken", (Broken,), {"answer": answer})
    env = make_small(control="planner", planner=kind, connected_cars=1, max_cycles=5, **QUICK)
    with pytest.raises(PlannerError, match=match):
        drive(env, 0)
    kind.answer = 0.0
    assert len(drive(env, 0)) == 5


@pytest.mark.filterwarnings("ignore")
def test_gymnasium_and_wrappers_take_accelerations() -> None:
    single = coopsim.single_env(
        "crossing", tracker="late_fusion", others="late_fusion", control="acceleration", max_cycles=5, **QUICK
    )
    assert single.action_space == gymnasium.spaces.Box(-8.0, 3.0, (1,), np.float32)
    check_env(BevImage(single), skip_render_check=True)
    parallel = Driving(coopsim.parallel_env("crossing", control="acceleration", max_cycles=5, **QUICK))
    parallel.reset(seed=0)
    parallel.step({name: parallel.action_space(name).sample() for name in parallel.agents})
    rows = FixedTracks(coopsim.parallel_env("crossing", control="acceleration", max_cycles=5, **QUICK), tracks=2)
    rows.reset(seed=0)
    assert rows.action_space("cav_0").shape == (41,)
    rows.step({name: np.ones(41, np.float32) for name in rows.agents})


def test_drives_are_logged_and_their_commands_replay_the_world(make_small: Make) -> None:
    """The accelerations that planners asked for, given as actions, make the same world to the bit."""
    options = {"vehicles": 10, "max_cycles": 30, "connected_cars": 2}
    planned = make_small(control="planner", **options)
    history = drive(planned, 4, policy="late_fusion")
    commands = {name: log.drive.command_m_s2 for name, log in planned.records["drives"].items()}
    assert set(commands) == {"cav_0", "cav_1"} and all(len(each) == 31 for each in commands.values())
    assert all(np.isnan(each[-1]) and np.isfinite(each[:-1]).any() for each in commands.values())
    again = make_small(control="acceleration", **options)
    again.reset(seed=4)
    for k, step in enumerate(history):
        given = {name: float(np.nan_to_num(each[k])) for name, each in commands.items()}
        again.step(
            {name: NOTHING | ({"acceleration_m_s2": given[name]} if name in given else {}) for name in again.agents}
        )
        np.testing.assert_array_equal(again.state(), step["state"])


@pytest.mark.parametrize("scenario", ["crossing", pytest.param("urban_grid", marks=pytest.mark.long)])
def test_others_crash_as_rarely_with_a_planned_car_as_without(monkeypatch: pytest.MonkeyPatch, scenario: str) -> None:
    worlds: list[World] = []
    make = World.__init__

    def remember(world: World, *given: Any, **named: Any) -> None:
        make(world, *given, **named)
        worlds.append(world)

    monkeypatch.setattr(World, "__init__", remember)
    options: dict[str, Any] = {"lidar": None, "max_cycles": 120, "expose_ground_truth": True}
    for control in ({"control": "planner", "driven_agents": ("cav_0",)}, {"control": "traffic"}):
        env, policy = coopsim.parallel_env(scenario, **options, **control), coopsim.make_policy("truth")
        observations, infos = env.reset(seed=2)
        policy.reset(env.agent_specs)
        while env.agents:
            observations, *_, infos = env.step(policy.act(observations, infos))
        assert worlds[-1].crashed() == ()


def test_ordinary_traffic_has_no_drives(make_small: Make) -> None:
    env = make_small()
    drive(env, 0)
    assert env.records["drives"] == {}
