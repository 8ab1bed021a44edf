"""The defence `witness` by hand-made receptions: a receiver that stands, and claims over time."""

from __future__ import annotations

from collections.abc import Sequence
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from coopsim.defenses.witness import Witness
from coopsim.errors import CoopsimError
from coopsim.geometry.boxes import Boxes3D
from coopsim.geometry.se3 import SE3
from coopsim.interfaces.defense import Claim, Reception, Trust, make_defense
from coopsim.types import Detections

Places = Sequence[tuple[float, float]]
PERSON, CAR = (0.6, 0.6, 1.75), (4.5, 1.9, 1.6)
HERE = SE3.identity()


def found(places: Places, size: tuple[float, float, float] = PERSON) -> Detections:
    rows = [(x, y, size[2] / 2, *size, 0.0) for x, y in places]
    boxes = Boxes3D.from_array(np.reshape(rows, (-1, 7)))
    return Detections(boxes, np.full(len(rows), 0.9), np.zeros(len(rows), np.int64))


class _Sweep:
    def __init__(self, points: Any) -> None:
        self.points = points.astype(np.float32)

    def __len__(self) -> int:
        return len(self.points)


def judge(
    defense: Witness, frame: int, said: dict[str, Detections], own: Detections | None = None, points: Any = None
) -> Trust:
    """Return the answer of a defence in a frame, to senders that say objects in the receiver's base frame."""
    sweep = _Sweep(np.reshape([] if points is None else points, (-1, 3)))
    claims = [
        Claim(SimpleNamespace(sender=name), each, HERE, 0.0)  # type: ignore[arg-type]
        for name, each in said.items()
    ]
    mounting = SimpleNamespace(base_SE3_lidar=SE3.from_xyz_yaw([0.0, 0.0, 2.0], 0.0))
    reception: Any = Reception(
        spec=SimpleNamespace(lidars={"roof": mounting}),  # type: ignore[arg-type]
        observation=SimpleNamespace(time_ns=frame * 100_000_000, sweeps={"roof": sweep}),  # type: ignore[arg-type]
        odom_SE3_base=HERE,
        claims=claims,
        find=lambda senders: found([]) if own is None else own,
    )
    return defense.judge(reception)


def believed(trust: Trust, claim: int = 0) -> list[bool]:
    assert trust.objects is not None
    return [bool(each >= 0.5) for each in trust.objects[claim]]


def test_what_the_receiver_detects_itself_needs_no_other_witness() -> None:
    own = found([(20.0, 3.0)])
    trust = judge(Witness(), 0, {"cav_1": found([(20.0, 2.1), (20.0, 9.0)])}, own)
    assert believed(trust) == [False, True] and trust.senders["cav_1"] > 0.5


def over_time(y: Sequence[float], size: tuple[float, float, float] = PERSON) -> tuple[list[bool], float]:
    """Return whether an object at x = 20 m and y (T,) is believed in each frame, and the sender's trust at the end."""
    defense, answers = Witness(), []
    for frame, each in enumerate(y):
        trust = judge(defense, frame, {"cav_1": found([(20.0, each)], size)})
        answers.append(believed(trust)[0])
    return answers, trust.senders["cav_1"]


def test_a_person_that_leaps_is_left_out_and_one_that_walks_or_is_seen_with_noise_is_not() -> None:
    leaps, _ = over_time([5.0] * 14 + [5.0 - 0.3 * k for k in range(1, 7)])
    assert all(leaps[:15]) and not leaps[-1]
    assert all(over_time([8.0 - 0.15 * k for k in range(40)])[0])
    assert all(over_time(5.0 + 0.12 * np.random.default_rng(1).normal(size=40))[0])
    assert all(over_time([6.0 - 0.5 * 3.0 * (0.1 * k) ** 2 for k in range(14)])[0])  # starts at 3 m/s²


def test_a_car_that_slides_sideways_is_left_out_and_its_sender_condemned() -> None:
    answers, trust = over_time([9.0 - 0.2 * k for k in range(40)], CAR)
    assert not any(answers[12:]) and trust < 0.5


def test_what_rays_go_through_is_left_out_and_its_sender_condemned() -> None:
    free = [(40.0, y, 0.2) for y in np.linspace(-0.8, 0.8, 9)]
    defense = Witness()
    for frame in range(25):
        trust = judge(defense, frame, {"cav_1": found([(20.0, 0.0)], CAR)}, points=free)
        assert believed(trust) == [False]
    assert trust.senders["cav_1"] < 0.5


def test_a_majority_decides_on_a_place_and_expels_nobody() -> None:
    defense = Witness()
    said = {"cav_1": found([(20.0, 5.0)]), "liar_1": found([(21.5, 5.0)]), "liar_2": found([(21.5, 5.1)])}
    for frame in range(40):
        trust = judge(defense, frame, said)
    assert [believed(trust, k) for k in range(3)] == [[False], [True], [True]]
    assert min(trust.senders.values()) > 0.5
    assert all(believed(judge(Witness(), 0, dict(list(said.items())[:2])), k) == [True] for k in range(2))


@pytest.mark.parametrize("spec", ["witness(rays=0)", "witness(leap_m=-1)", "witness(own_m='far')", "witness(votes=1)"])
def test_a_wrong_parameter_is_refused_in_one_line(spec: str) -> None:
    with pytest.raises(CoopsimError) as refused:
        make_defense(spec)
    assert "\n" not in str(refused.value) and spec.split("(")[1].split("=")[0] in str(refused.value)


def test_a_sender_that_misplaces_what_the_receiver_sees_is_condemned_and_one_with_a_wrong_pose_is_not() -> None:
    rng, own = np.random.default_rng(2), [(12.0, 3.0), (20.0, -3.0), (25.0, 6.0)]
    expelled = {}
    for kind in ("noise", "pose", "shift"):
        defense = Witness()
        for frame in range(25):
            by = {"noise": 0.0, "pose": 0.6, "shift": 0.9 if frame >= 10 else 0.0}[kind]
            off = [(0.0, by)] * 3 if kind == "pose" else [(0.0, -by), (0.0, by), (0.0, 0.0)]
            said = np.array(own) + off + 0.1 * rng.normal(size=(3, 2))
            trust = judge(defense, frame, {"cav_1": found([tuple(each) for each in said], CAR)}, found(own, CAR))
        expelled[kind] = trust.senders["cav_1"] < 0.5
    assert expelled == {"noise": False, "pose": False, "shift": True}


def test_what_the_receiver_remembers_and_has_points_on_is_believed_where_its_own_track_is() -> None:
    front = [(17.7, y, z) for y in np.linspace(2.2, 3.8, 5) for z in (0.5, 0.9)]
    for y, expected in ((3.1, True), (3.9, False)):
        defense = Witness()
        for frame in range(10):
            judge(defense, frame, {"cav_1": found([])}, found([(20.0, 3.0)], CAR), front)
        later = [judge(defense, frame, {"cav_1": found([(20.0, y)], CAR)}, None, front) for frame in range(10, 20)]
        assert believed(later[-1]) == [expected]


def test_a_wrong_heading_makes_no_car_that_drives_slide() -> None:
    defense = Witness()
    for frame in range(20):
        car = found([(10.0 + frame, 5.0)], CAR)  # 10 m/s, with a heading that is off by 0.16 rad
        boxes = Boxes3D(car.boxes.center, car.boxes.size, np.array([0.16]))
        trust = judge(defense, frame, {"cav_1": Detections(boxes, car.score, car.label)})
    assert believed(trust) == [True]
