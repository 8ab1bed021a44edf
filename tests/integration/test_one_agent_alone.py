"""What policies on instances and moved features find when nobody is there to hear: what the agent's detector finds."""

from __future__ import annotations

import pytest

pytest.importorskip("torch")

from coopsim.bench.detect.detect import EVERYWHERE, measure_detection
from coopsim.bench.detect.detect_plan import DetectPlan
from coopsim.bench.engine.engine import Engine

POLICIES = ("cooptrack", "ff_tracking", "univ2x", "vic_integrated")
PLACES = ("crossing", "roundabout")

pytestmark = pytest.mark.long  # whole networks that ship, over whole scenes


@pytest.fixture(scope="module")
def precision() -> dict[str, float]:
    """The average precision of a car that is alone, by policy, over two places that no network was trained in."""
    alone = {"connected_cars": 1, "rsus": 0}
    plan = DetectPlan(("no_fusion", *POLICIES), PLACES, (0,), frames=12, options=alone)
    rows = measure_detection(plan, engine=Engine(workers=1))
    return {row["policy"]: row["APBEV@0.5"] for row in rows if row["environment"] == EVERYWHERE}


@pytest.mark.parametrize("policy", POLICIES)
def test_it_is_no_worse_than_the_agents_own_detector_by_more_than_a_point(
    precision: dict[str, float], policy: str
) -> None:
    assert precision[policy] >= precision["no_fusion"] - 0.01
