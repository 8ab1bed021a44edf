"""Instances: their motion in time and between frames, their memory, and what is carried over."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

torch = pytest.importorskip("torch")
from some_instances import FRAMES, WIDTH, at, require_close, some_instances  # noqa: E402

from coopsim.geometry.se3 import SE3  # noqa: E402
from coopsim.nn.queries.instances import Instances, met  # noqa: E402
from coopsim.types import ObjectClass  # noqa: E402

torch.set_num_threads(1)


def test_a_motion_and_its_inverse_change_nothing() -> None:
    known, move = some_instances(7), SE3.from_xyz_yaw(np.array([3.0, -2.0, 0.4]), 1.1)
    back = known.moved(move).moved(move.inverse())
    require_close(known, back)
    assert torch.allclose(back.box, known.box, atol=1e-4)
    turned = at([[10.0, 0.0]], velocity=torch.tensor([[2.0, 0.0]])).moved(SE3.from_xyz_yaw(np.zeros(3), np.pi / 2))
    assert torch.allclose(turned.box[0, :2], torch.tensor([0.0, 10.0]), atol=1e-5)
    assert torch.allclose(turned.velocity[0], torch.tensor([0.0, 2.0]), atol=1e-5)
    assert float(turned.box[0, 6]) == pytest.approx(np.pi / 2)


def test_places_are_exact_in_a_pass_that_multiplies_bfloat16() -> None:
    move = SE3.from_xyz_yaw(np.array([103.3, -41.7, 0.4]), 1.1)
    known = at([[97.3, 61.9]], velocity=torch.tensor([[13.7, -3.1]]))
    with torch.autocast("cpu", torch.bfloat16):
        moved = known.moved(move)
    assert torch.equal(moved.box, known.moved(move).box)
    assert torch.equal(moved.velocity, known.moved(move).velocity)


def test_time_moves_boxes_and_ages_the_past() -> None:
    known = at([[1.0, 2.0]], velocity=torch.tensor([[3.0, -1.0]])).remembered().advanced(0.5)
    assert known.box[0, :2].tolist() == [2.5, 1.5]
    assert known.past_age_s[0].tolist() == [0.5, *[np.inf] * 3]


def test_the_oldest_frame_falls_out_of_the_past() -> None:
    known = some_instances(3)
    for number in range(6):
        known = replace(known, semantic=torch.full((3, WIDTH), float(number))).remembered().advanced(0.1)
    assert known.past_semantic[0, :, 0].tolist() == [5, 4, 3, 2]
    assert known.past_age_s.shape == (3, FRAMES) and torch.allclose(
        known.past_age_s[0], torch.tensor([0.1, 0.2, 0.3, 0.4])
    )


def test_others_get_neither_history_nor_number() -> None:
    known = some_instances(4, number=torch.arange(4))
    heard = known.as_received()
    require_close(known, heard)
    assert heard.number.tolist() == [-1] * 4 and not bool(torch.isfinite(heard.past_age_s).any())
    assert not heard.past_semantic.any() and heard.hits.tolist() == [2] * 4


def test_the_surest_stay_in_their_order() -> None:
    known = at([[0, 0], [9, 0], [18, 0]], score=torch.tensor([0.3, 0.9, 0.5]))
    assert known.surest(2).box[:, 0].tolist() == [9, 18]
    assert known.surest(5) is known


def test_what_is_seen_again_keeps_its_number_and_learns_its_velocity() -> None:
    before = at([[0, 0], [20, 0]], number=torch.tensor([7, 8]), semantic=torch.ones(2, WIDTH)).remembered()
    now = met(before.advanced(0.5), at([[24.0, 0.5], [40, 0], [0.2, 0]]), 0.5)
    assert now.number.tolist() == [7, 8, -1]
    assert torch.allclose(now.box[:, 0], torch.tensor([0.2, 24.0, 40.0]))
    assert now.hits.tolist() == [2, 2, 1]
    assert float(now.velocity[1, 0]) == pytest.approx(4.0 / 0.65, rel=1e-4)
    assert torch.equal(now.semantic[:, 0], torch.tensor([1.0, 1.0, 0.0]))
    known = replace(now, hits=now.hits + 5)
    steady = met(known.advanced(0.5), at((known.advanced(0.5).box[:2, :2] + torch.tensor([1.0, 0.0])).tolist()), 0.5)
    assert torch.allclose(steady.velocity[:2, 0], known.velocity[:2, 0] + 1.0)


def test_what_is_not_seen_fades_where_it_is_predicted() -> None:
    before = at([[0, 0]], number=torch.tensor([7]), velocity=torch.tensor([[10.0, 0.0]]))
    later, scores = before, []
    for _ in range(3):
        later = met(later.advanced(0.1), at(np.zeros((0, 2))), 0.1)
        scores.append(float(later.score[0]))
    assert later.box[0, 0] == pytest.approx(3.0) and later.missed.tolist() == [3] and later.number.tolist() == [7]
    assert scores == sorted(scores, reverse=True) and scores[-1] < 0.2


@pytest.mark.parametrize(
    ("far_m", "label", "hits", "same"),
    [(1.0, ObjectClass.CAR, 9, True), (4.0, ObjectClass.CAR, 9, False), (4.0, ObjectClass.VAN, 1, True),
     (1.0, ObjectClass.PEDESTRIAN, 1, False)],
)  # fmt: skip
def test_what_is_too_far_or_of_another_kind_is_another_object(far_m: float, label: int, hits: int, same: bool) -> None:
    before = at([[0, 0]], hits=torch.tensor([hits]), number=torch.tensor([3]))
    now = met(before, at([[far_m, 0]], label=torch.tensor([int(label)])), 0.5)
    assert (len(now) == 1) == same


def test_cars_of_a_motorway_keep_their_numbers_and_learn_their_speed() -> None:
    start_m, speed_m_s = torch.tensor([[0.0, 0.0], [12.0, 0.0], [3.0, 4.0]]), torch.tensor([33.0, 28.0, -33.0])
    known = at(start_m.tolist(), number=torch.tensor([0, 1, 2]))
    for frame in range(1, 6):
        place_m = start_m + torch.stack([0.1 * frame * speed_m_s, torch.zeros(3)], dim=1)
        known = met(known.advanced(0.1), at(place_m.tolist()), 0.1)
    assert sorted(known.number.tolist()) == [0, 1, 2]
    assert torch.allclose(known.velocity[torch.argsort(known.number), 0], speed_m_s, atol=2.0)


def test_what_is_far_aside_is_no_fast_car() -> None:
    now = met(at([[0, 0]], number=torch.tensor([3])), at([[0.0, 3.5]]), 0.1)
    assert sorted(now.number.tolist()) == [-1, 3]


def test_nothing_meets_nothing() -> None:
    none = Instances.none(WIDTH, FRAMES)
    assert len(met(none, none, 0.1)) == 0
    assert met(none, at([[1, 1]]), 0.1).number.tolist() == [-1]
