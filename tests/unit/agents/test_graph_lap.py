"""Which boxes the refinement moves, and how many of an object's are tracked."""

from __future__ import annotations

import numpy as np
import pytest
from some_tracks import FRAME_NS, cars

from coopsim.agents.graph_lap import GraphLap, GraphLapAOS, GraphLapTSA
from coopsim.types import AgentSpec


def test_boxes_that_one_agent_sees_move_with_the_others_unless_told_otherwise() -> None:
    """The second agent's box lies 0.5 m ahead of the first's; a third box is one agent's alone."""
    groups = [cars(0.0, 40.0), cars(0.6)]
    (whole,), (matched,) = (GraphLapAOS(matched_only=flag).fuse(groups) for flag in (False, True))
    x = [each.boxes.center[:, 0] for each in (whole, matched)]
    np.testing.assert_allclose(x[0][[0, 2]], x[1][[0, 2]])
    assert x[1][1] == 40.0
    lone = GraphLapAOS(matched_only=True).fuse([cars(0.0, 40.0), cars(20.0)])[0]
    assert lone.boxes.center[:, 0].tolist() == [0.0, 40.0, 20.0]


def test_the_shift_of_all_is_the_mean_of_what_agents_differ_by() -> None:
    (whole,) = GraphLapAOS().fuse([cars(0.0, 40.0), cars(0.6, 40.9)])
    # Offsets to the anchors are 0.6, 0.9, -0.6 and -0.9: their mean is zero, so hardly any box moves.
    np.testing.assert_allclose(whole.boxes.center[:, 0], [0, 40, 0.6, 40.9], atol=0.1)


@pytest.mark.parametrize("policy", [GraphLapAOS, GraphLapTSA])
@pytest.mark.parametrize(("agents", "given", "expected"), [(2, None, 2), (3, None, 1), (2, True, 1), (3, False, 3)])
def test_with_more_than_two_agents_an_object_has_one_track(
    policy: type[GraphLap], agents: int, given: bool | None, expected: int
) -> None:
    fused, specs = policy(one_per_object=given), {f"cav_{k}": AgentSpec(f"cav_{k}", "cav", 0.1) for k in range(agents)}
    fused.specs = specs
    fused.begin(specs["cav_0"], np.random.default_rng(0))
    tracker = fused.make_tracker()
    for k in range(5):
        shown = tracker.step_in_turn(fused.fuse([cars(0.1 * agent) for agent in range(agents)]), k * FRAME_NS)
    assert len(shown) == expected


def test_a_track_that_is_missed_takes_no_box_of_a_neighbour_in_a_later_stage() -> None:
    policy = GraphLapTSA(one_per_object=True)
    tracker = policy.make_tracker()
    for k in range(10):
        groups = [cars(0.0, *([6.0] * (k < 5)))] * 3  # two cars in a queue, and one is hidden
        shown = tracker.step_in_turn(policy.fuse(groups), k * FRAME_NS)
    assert shown.boxes.center[:, 0].tolist() == pytest.approx([0.0], abs=0.1)
