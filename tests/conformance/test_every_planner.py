"""Every registered planner passes the check, and the check finds what is wrong with others."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import coopsim
from coopsim import PlannedCar, Planner
from coopsim.cli import main
from coopsim.errors import InvalidValueError, UnknownNameError
from coopsim.interfaces.planner import PLANNERS, make_planner
from coopsim.testing import check_planner

MINE = """
import coopsim

class Mine(coopsim.Planner):
    def __init__(self, brake=2.0):
        self.brake = brake
    def plan(self, car):
        return -self.brake

class Other:
    pass
"""


@pytest.mark.parametrize("name", PLANNERS.names())
def test_every_registered_planner_keeps_the_rules(name: str) -> None:
    check_planner(name)


class Good(Planner):
    def plan(self, car: PlannedCar) -> float:
        return -2.0


class Steady(Planner):
    def plan(self, car: PlannedCar) -> float:
        return 0.0


class Random(Planner):
    def plan(self, car: PlannedCar) -> float:
        return -float(np.random.default_rng().random())


class Shares(Planner):
    calls = 0

    def plan(self, car: PlannedCar) -> float:
        Shares.calls += len(car.tracks) > 100
        return -2.0 - 0.001 * Shares.calls


class Undefined(Planner):
    def plan(self, car: PlannedCar) -> float:
        return -float(np.hypot(*car.tracks.boxes.center[:, :2].T).min()) * np.inf if len(car.tracks) else np.nan


class Raises(Planner):
    def plan(self, car: PlannedCar) -> float:
        return -float(car.tracks.score.min())


class Writes(Planner):
    def plan(self, car: PlannedCar) -> float:
        object.__setattr__(car, "speed_m_s", 0.0)
        return -2.0


class Text(Planner):
    def plan(self, car: PlannedCar) -> Any:
        return "brake"


ONE = Good()


@pytest.mark.parametrize(
    ("planner", "match"),
    [
        (Steady, "must stop before a standing car"),
        (Random, "must return the same for the same drive"),
        (Shares, "must share no state|must return the same"),
        (Undefined, "must return a finite acceleration, got nan"),
        (Raises, "must return a number, and raised ValueError"),
        (Writes, "must leave its input as it is"),
        (Text, "must return a finite acceleration, got 'brake'"),
        (Good(), "must be a class or a name"),
        (lambda: "nothing", "must make a coopsim.Planner"),
        (lambda: ONE, "must make a new planner for each car"),
    ],
)
def test_the_check_finds_what_is_wrong(planner: Any, match: str) -> None:
    with pytest.raises(AssertionError, match=match):
        check_planner(planner)


def test_a_good_one_passes_and_need_not_brake_if_told_so() -> None:
    check_planner(Good)
    check_planner(Steady, brakes=False)


def test_a_planner_in_a_file_is_found_by_its_place(tmp_path: Path) -> None:
    path = tmp_path / "mine.py"
    path.write_text(MINE)
    assert make_planner(f"{path}:Mine(brake=3)").plan(None) == -3  # type: ignore[arg-type]
    env = coopsim.parallel_env(
        "crossing", lidar=None, control="planner", planner=f"{path}:Mine(brake=8)", max_cycles=40, connected_cars=1
    )
    policy = coopsim.make_policy("no_fusion")
    observations, _ = env.reset(seed=0)
    policy.reset(env.agent_specs)
    while env.agents:
        observations, *_ = env.step(policy.act(observations))
    assert env.records["drives"]["cav_0"].drive.speed_m_s[-1] == 0
    for place, error, match in (
        (f"{path}:Min", UnknownNameError, "planner 'Min'.*Mine"),
        (f"{path}:Other", InvalidValueError, "derived from coopsim.Planner"),
        (f"{path}:Mine(brakes=1)", UnknownNameError, "parameter 'brakes'"),
        (f"{tmp_path}/none.py:Mine", InvalidValueError, "planner .*cannot read"),
        ("no_such_module:Mine", InvalidValueError, "planner module 'no_such_module'"),
    ):
        with pytest.raises(error, match=match):
            make_planner(place)


def test_planners_are_listed(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["list"]) == 0
    (line,) = (line for line in capsys.readouterr().out.splitlines() if line.startswith("planners:"))
    assert "idm_aeb" in line
