"""What the paper leaves open or says twice, by parameter."""

from __future__ import annotations

import numpy as np
import pytest
from some_tracks import FRAME_NS, cars

from coopsim.agents.appearance import DinoCoDTTracking
from coopsim.types import Tracks
from coopsim.types.taxonomy import ObjectClass, Superclass


def last(policy: DinoCoDTTracking, *frames: tuple[float, int]) -> Tracks:
    """The last report on one object at x m, of a class, in each frame."""
    tracker = policy.make_tracker()
    return [tracker.step(cars(x, label=label), k * FRAME_NS) for k, (x, label) in enumerate(frames)][-1]


def test_negative_gates_need_giou_and_then_match_boxes_that_do_not_overlap() -> None:
    frames = [(0.0, 0), (5.0, 0)]  # a gap of half a metre
    apart = last(DinoCoDTTracking(), *frames)
    assert len(apart) == 2 and not apart.velocity.any()
    near = last(DinoCoDTTracking(affinity="giou_3d", gate=-0.2), *frames)
    assert len(near) == 1 and near.velocity[0, 0] > 10


@pytest.mark.parametrize(("motion", "turning"), [("section_3f", (7, 8, 4, 5, 6)), ("section_4b", (0, 7, 8, 4, 5, 6))])
def test_which_classes_turn(motion: str, turning: tuple[int, ...]) -> None:
    """Only models that turn have the speed in their state, and size 11."""
    for label in ObjectClass:
        fresh = DinoCoDTTracking(motion=motion).make_tracker()
        fresh.step(cars(0.0, label=int(label)), 0)
        (size,) = {state.tracked.beliefs.mean.shape[1] for state in fresh.state if len(state.tracked)}
        assert (size == 11) == (label in turning), label.title


def test_classes_of_a_superclass_match_where_asked() -> None:
    van, truck = int(ObjectClass.VAN), int(ObjectClass.TRUCK)
    assert ObjectClass.VAN.superclass is ObjectClass.TRUCK.superclass is Superclass.TRUCK
    frames = [(0.0, truck), (0.1, truck), (0.2, truck), (0.3, van)]
    apart, together = (last(DinoCoDTTracking(by_superclass=flag), *frames) for flag in (False, True))
    assert together.label.tolist() == [truck] and np.isclose(together.boxes.center[0, 0], 0.3, atol=0.05)
    assert together.id[0] == apart.id[apart.label == truck][0]
    assert np.isclose(together.score[0], 0.8)
