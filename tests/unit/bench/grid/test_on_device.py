"""The device of networks, in the names of policies and detectors that have some."""

from __future__ import annotations

import json
from typing import Any

import pytest

from coopsim.bench.detect.detect_plan import DetectPlan
from coopsim.bench.engine.job import Job
from coopsim.bench.grid.cell import Cell, Condition
from coopsim.bench.grid.grid import Grid
from coopsim.bench.grid.policies import detector_on, policy_on
from coopsim.bench.store.fingerprint import fingerprint
from coopsim.catalog import PolicySpec
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


def test_the_key_of_a_cell_has_the_arithmetic_of_the_device(monkeypatch: pytest.MonkeyPatch) -> None:
    """On a GPU without bfloat16, beside a processor that multiplies in it."""
    pytest.importorskip("torch")
    from fake_gpu import FakeGpu

    monkeypatch.delenv("COOPSIM_PRECISION", raising=False)
    for home in ("coopsim.support.precision", "coopsim.nn.inference.backend"):
        monkeypatch.setattr(f"{home}.multiplies_bfloat16", lambda: True)
    FakeGpu(monkeypatch)

    def in_key(policy: str, detector: str = "simulated") -> str:
        spec = PolicySpec.parse(policy)
        text = fingerprint(Cell(policy, Condition()), {"detector": detector}, spec)
        found = str(json.loads(text)["code"]["arithmetic"])
        assert found == Job.of(Cell(policy, Condition()), {"detector": detector}, spec).arithmetic
        return found

    assert in_key("no_fusion") == in_key("attfuse") == in_key("no_fusion", "pillars") == "bfloat16"
    assert in_key("attfuse(device=cuda)") == in_key("no_fusion", "pillars(device=auto)") == "float32"
    assert in_key("attfuse(device=cuda)", "pillars") == "bfloat16 and float32"
