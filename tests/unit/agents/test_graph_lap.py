"""Which boxes the refinement moves."""

from __future__ import annotations

import numpy as np
from some_tracks import cars

from coopsim.agents.graph_lap import GraphLapAOS


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
