"""What policies on instances and moved features find when nobody is there to hear: what the agent's detector finds."""

from __future__ import annotations

from functools import cache

import pytest

pytest.importorskip("torch")

from coopsim.bench.detect.detect_plan import DetectPlan
from coopsim.bench.detect.detect_rows import Measured, row_of

POLICIES = ("cooptrack", "ff_tracking", "univ2x", "vic_integrated")
PLACES = ("crossing", "roundabout")


@cache
def precision(policy: str) -> float:
    """Return the average precision of a car that is alone, over two places that no network was trained in."""
    plan = DetectPlan((policy,), PLACES, (0,), frames=12, options={"connected_cars": 1, "rsus": 0})
    measured = []
    for place in plan.rows():
        (job,) = plan.jobs_of(*place)
        outcome = job.run()
        assert outcome.perceived is not None, outcome
        measured.append(Measured.of(outcome.perceived, plan.protocol))
    row = row_of(plan, (policy, "all", plan.disturbances[0]), {}, measured)
    return float(row["APBEV@0.5"])


@pytest.mark.parametrize("policy", POLICIES)
def test_it_is_no_worse_than_the_agents_own_detector_by_more_than_a_point(policy: str) -> None:
    assert precision(policy) >= precision("no_fusion") - 0.01
