"""Attacks that aim at the brakes, each in a case made by hand: a straight road, one object, and a copy of a planner."""

from __future__ import annotations

import types
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np
import pytest

import coopsim
from coopsim.attacks import AimedAttack, VictimPlan, make_attack
from coopsim.envs.frames import AgentFrame, Frame, FrameSource
from coopsim.errors import CoopsimError
from coopsim.geometry.boxes import Boxes3D
from coopsim.geometry.se3 import SE3
from coopsim.interfaces.attack import AttackerView
from coopsim.planning import PlannedCar, make_planner
from coopsim.tracking.ab3dmot_tracker import ab3dmot
from coopsim.types import Detections, GroundTruth
from coopsim.types.driving import NOBODY_FIRST, Route
from coopsim.types.taxonomy import ObjectClass
from coopsim.world.world import World

SPEED_M_S, DT_S = 10.0, 0.1
CAR = (4.5, 1.9, 1.6)


def road() -> Route:
    points = np.column_stack([np.arange(60.0), np.zeros(60)])
    return Route(points, 1.0, np.full(60, 13.9), np.full(60, NOBODY_FIRST))


def victim(frame: int, box: Any, label: ObjectClass, **given: Any) -> VictimPlan:
    """Return the car after some frames on a straight road, with an object that stands in the world."""
    gone_m = frame * DT_S * SPEED_M_S
    objects = Detections(Boxes3D.from_array([[box[0] - gone_m, *box[1:]]]), np.array([0.8]), np.array([int(label)]))
    world_SE3_base = SE3.from_xyz_yaw(np.array([gone_m, 0.0, 0.0]), 0.0)
    usual = {"speed_m_s": SPEED_M_S, "heard": np.zeros(1, np.int64), "others": {}} | given
    return VictimPlan(
        name="cav_0",
        time_ns=frame * 100_000_000,
        dt_s=DT_S,
        route=road(),
        objects=objects,
        id=np.array([0]),
        velocity=np.zeros((1, 2)),
        planner="idm_aeb",
        liar_SE3_base=SE3.identity(),
        world_SE3_base=world_SE3_base,
        rng=np.random.default_rng(0),
        **usual,
    )


PARKED, WALKER = (32.0, -2.6, 0.8, *CAR, 0.0), (20.0, 0.0, 0.9, 0.6, 0.6, 1.75, 0.0)


def told(attack: str, box: Any, label: ObjectClass, frames: int) -> Iterator[tuple[VictimPlan, np.ndarray[Any, Any]]]:
    """Yield what an attack knows and the shift (2,) that it tells in each frame."""
    made: Any = make_attack(attack)
    for frame in range(frames):
        now = victim(frame, box, label)
        made.plan(now)
        yield now, now.lines.by_m[0]


def hardest(attack: str | None) -> float:
    """Return the hardest braking of a planner that drives by a tracker of what is told of a parked car."""
    planner_sees, tracker = [0.0], ab3dmot()
    planner = make_planner("idm_aeb")
    lies = [by_m for _, by_m in told(attack, PARKED, ObjectClass.CAR, 30)] if attack else [np.zeros(2)] * 30
    for frame, by_m in enumerate(lies):
        box = np.array([PARKED])
        box[0, :2] += by_m
        seen = Detections(Boxes3D.from_array(box), np.array([0.9]), np.array([int(ObjectClass.CAR)]))
        world_SE3_base = SE3.from_xyz_yaw(np.array([frame * DT_S * SPEED_M_S, 0.0, 0.0]), 0.0)
        tracks = tracker.step(seen, frame * 100_000_000).transform(world_SE3_base.inverse())
        car = PlannedCar("cav_0", frame * 100_000_000, DT_S, tracks, SPEED_M_S, 0.0, 0.0, 4.5, 1.9, road())
        planner_sees.append(float(planner.plan(car)))  # type: ignore[arg-type]
    return min(planner_sees)


def test_a_parked_car_that_is_moved_by_less_than_a_metre_makes_the_planner_brake_hard() -> None:
    assert hardest(None) > -1.0
    assert hardest("shift_into_path") <= -3.0
    shifts = [by_m for _, by_m in told("shift_into_path", PARKED, ObjectClass.CAR, 30)]
    assert np.abs(shifts).max() <= 0.9 + 1e-9
    assert np.allclose([by_m[0] for by_m in shifts], 0)  # across the road alone
    aside = np.array([by_m[1] for by_m in shifts])
    assert aside.min() < -0.5 and np.diff(aside).max() == pytest.approx(0.3)  # away, then to the left at 3 m/s


def test_a_weak_shift_moves_less() -> None:
    shifts = [by_m for _, by_m in told("shift_into_path(most_m=0.2)", PARKED, ObjectClass.CAR, 30)]
    assert 0 < np.abs(shifts).max() <= 0.2 + 1e-9


def test_a_person_on_the_way_is_moved_off_it_and_stays_there() -> None:
    frames = list(told("hide_conflict", WALKER, ObjectClass.PEDESTRIAN, 8))
    honest, by_m = frames[0][0], frames[0][1]
    box, label, still = honest.objects.boxes, honest.objects.label, np.zeros((1, 2))
    moved = Boxes3D(box.center + np.append(by_m, 0.0), box.size, box.yaw)
    assert honest.answer(box, still, label) < -1.0 <= honest.answer(moved, still, label)
    assert np.allclose([shift for _, shift in frames], by_m) and np.hypot(*by_m) == pytest.approx(2.5)
    far = [shift for _, shift in told("hide_conflict", (20.0, 7.0, *WALKER[2:]), ObjectClass.PEDESTRIAN, 3)]
    assert not np.any(far)  # of what is in nobody's way it tells the truth


def test_a_phantom_stands_where_the_planner_brakes_hardest_and_goes_when_the_car_stands() -> None:
    made: Any = make_attack("phantom_stop")
    aside = (20.0, 30.0, *WALKER[2:])
    now = victim(0, aside, ObjectClass.PEDESTRIAN)
    made.plan(now)
    ((number, box, _, label, _),) = now.lines.added
    assert (number, label) == (0, int(ObjectClass.CAR)) and abs(box[1]) < 1e-9
    assert now.answer(Boxes3D.from_array(box[None]), np.zeros((1, 2)), np.array([label])) <= -3.0
    stands = victim(1, aside, ObjectClass.PEDESTRIAN, speed_m_s=0.5)
    made.plan(stands)
    assert not stands.lines.added


def test_poison_contradicts_what_others_tell_of_what_the_victim_does_not_tell() -> None:
    there, seen = (np.array([[x, 5.0, 0.8, *CAR, 0.0]]) for x in (15.0, 40.0))
    others = {"cav_0": Boxes3D.from_array(seen), "rsu_0": Boxes3D.from_array(np.concatenate([there, seen]))}
    now = victim(0, there[0], ObjectClass.CAR, others=others)
    make_attack("trust_poison").plan(now)  # type: ignore[attr-defined]
    assert np.allclose(now.lines.by_m, [[1.5, 0.0]]) and not now.lines.added
    blind = victim(0, (50.0, 50.0, 0.8, *CAR, 0.0), ObjectClass.CAR, others=others)
    make_attack("trust_poison").plan(blind)  # type: ignore[attr-defined]
    (claim,) = blind.lines.added
    assert claim[1][:2] == pytest.approx([16.5, 5.0])


def test_a_copy_of_the_planner_yields_later_if_the_object_is_confirmed_later() -> None:
    now = victim(0, WALKER, ObjectClass.PEDESTRIAN)
    box, label = Boxes3D.from_array([WALKER]), np.array([int(ObjectClass.PEDESTRIAN)])
    assert now.answer(box, np.zeros((1, 2)), label, seen_after_s=5.0) == 0.0
    assert now.answer(box, np.zeros((1, 2)), label) < -1.0


@pytest.mark.parametrize(
    "attack",
    [
        "shift_into_path(most_m=3)",
        "shift_into_path(speed_m_s=0)",
        "shift_into_path(score=2)",
        "hide_conflict(objects=0)",
        "phantom_stop(label='moon')",
        "trust_poison(off_m=nan)",
        "trust_poison(far=1)",
    ],
)
def test_a_wrong_parameter_is_refused_in_one_line(attack: str) -> None:
    with pytest.raises(CoopsimError) as refused:
        make_attack(attack)
    assert "\n" not in str(refused.value) and attack.split("(")[1].split("=")[0] in str(refused.value)


SPIED: list[Any] = []


@dataclass(kw_only=True)
class Spy(AimedAttack):
    def plan(self, victim: VictimPlan) -> None:
        SPIED.append(victim)
        if len(victim.objects):
            victim.hide(0)

    def detect(self, view: AttackerView, detections: Detections) -> Detections:
        SPIED.append(view)
        return super().detect(view, detections)


def reachable(start: Any) -> Iterator[Any]:
    """Yield all objects that code could reach from one by attributes, items, methods and closures."""
    known, left = set[int](), [start]
    while left:
        each = left.pop()
        if id(each) in known or isinstance(each, (type, types.ModuleType, str, bytes, np.ndarray)):
            continue
        known.add(id(each))
        yield each
        if isinstance(each, dict):
            left += [*each.keys(), *each.values()]
        elif isinstance(each, (list, tuple, set, frozenset)):
            left += list(each)
        elif isinstance(each, types.MethodType):
            left += [each.__self__, each.__func__]
        elif isinstance(each, types.FunctionType):
            left += [cell.cell_contents for cell in each.__closure__ or ()] + list(each.__defaults__ or ())
        elif isinstance(each, partial):
            left += [each.func, *each.args, *each.keywords.values()]
        else:
            slots = [name for kind in type(each).__mro__ for name in getattr(kind, "__slots__", ())]
            left += [getattr(each, name) for name in slots if hasattr(each, name)]
            left += list(getattr(each, "__dict__", {}).values())


def test_an_attack_that_looks_for_the_truth_does_not_find_it() -> None:
    """It walks through all that it is given; the world, its frames and its truth are nowhere."""
    SPIED.clear()
    options = {"lidar": None, "max_cycles": 4, "control": "planner", "driven_agents": ("cav_0",)}
    coopsim.evaluate("late_fusion", "crossing", seed=3, attacks={"cav_1": Spy}, **options)
    assert any(isinstance(each, VictimPlan) for each in SPIED)
    truth = (GroundTruth, Frame, AgentFrame, FrameSource, World)
    found = [each for each in reachable(SPIED) if isinstance(each, truth)]
    assert not found
    # The search finds what it looks for where it is.
    frame = replace(Frame(0, {}, None), last=True)  # type: ignore[arg-type]
    assert any(isinstance(each, Frame) for each in reachable([partial(print, {"a": (frame,)})]))
