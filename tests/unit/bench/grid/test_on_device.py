"""The device of networks, in the names of policies and detectors that have some."""

from __future__ import annotations

from typing import Any

import pytest

from coopsim.bench.detect.detect_plan import DetectPlan
from coopsim.bench.grid.grid import Grid
from coopsim.bench.grid.policies import detector_on, policy_on
from coopsim.errors import InvalidValueError


@pytest.mark.parametrize(
    ("given", "on_gpu"),
    [
        ("attfuse", "attfuse(device='cuda:1')"),
        ("cooptrack(device=cpu, memory_s=0.5)", "cooptrack(device=cpu, memory_s=0.5)"),
        ("late_fusion(hits=2)", "late_fusion(hits=2)"),
        ("coopsim.agents.early_fusion:EarlyFusion", "coopsim.agents.early_fusion:EarlyFusion(device='cuda:1')"),
    ],
)
def test_policies_with_networks_get_the_device(given: str, on_gpu: str) -> None:
    assert policy_on("cuda:1", given) == on_gpu
    assert policy_on("cpu", given) == given


@pytest.mark.parametrize(
    ("given", "on_gpu"),
    [
        ("pillars(threads=1)", "pillars(device=cuda, threads=1)"),
        ("lift_splat", "lift_splat(device=cuda)"),
        ("simulated(max_recall=0.9)", "simulated(max_recall=0.9)"),
        ("nobody's", "nobody's"),
        (None, None),
    ],
)
def test_detectors_with_networks_get_the_device(given: Any, on_gpu: Any) -> None:
    assert detector_on("cuda", given) == on_gpu
    assert detector_on("cpu", given) == given


def test_grids_and_plans_have_one() -> None:
    grid = Grid(["no_fusion", "early"], options={"detector": "pillars"}, device="cuda")
    assert grid.policies == ("no_fusion", "early(device=cuda)") and grid.options == {"detector": "pillars(device=cuda)"}
    plan = DetectPlan(("early", "no_fusion"), detector="pillars", device="auto")
    assert plan.policies == ("early(device=auto)", "no_fusion") and plan.box_detector == "pillars(device=auto)"
    for make in (lambda: Grid(["no_fusion"], device="gpu"), lambda: DetectPlan(device="gpu")):
        with pytest.raises(InvalidValueError, match=r"device must be cpu, cuda, cuda:1, \.\.\. or auto, got 'gpu'"):
            make()
