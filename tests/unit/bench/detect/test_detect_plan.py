"""Plans: their rows, and what a row's environment is given."""

from __future__ import annotations

import pytest

from coopsim.bench.detect.detect_plan import DetectPlan, own_condition
from coopsim.bench.grid.cell import Cell, environment_options
from coopsim.errors import CoopsimError


def test_rows_are_noises_times_delays() -> None:
    plan = DetectPlan(noises=((0, 0), (0.4, 0.4)), delays_ms=(0, 200))
    assert len(list(plan.rows())) == 2 * 2 * 2
    lying = DetectPlan(noises=((0.4, 0.4),), delays_ms=(200,), attacks=("cav_1=ghost",))
    made = dict(next(lying.rows())[1].settings)
    assert (made["position_noise_m"], made["latency_s"], made["attacks"]) == (0.4, 0.2, "cav_1=ghost")
    assert made["heading_noise_rad"] == pytest.approx(0.00698131700797)
    own = Cell("no_fusion", own_condition("crossing"), 0, None)
    assert environment_options(own, {"loss": 0.3}) == {"threads": 1, "loss": 0.3}


def test_the_detector_is_of_policies_that_have_none() -> None:
    plan = DetectPlan(policies=("no_fusion",), detector="simulated", options={"lidar": None})
    (job, _) = plan.jobs()
    made = {"threads": 1, "lidar": None, "detector": "simulated", "dt_s": 0.5, "max_cycles": job.pace.cycles}
    assert environment_options(job.cell, job.options) == made


@pytest.mark.parametrize(
    "wrong",
    [
        {"frames": 0},
        {"every_s": 0},
        {"noises": ((-1, 0),)},
        {"delays_ms": (-1,)},
        {"receivers": "masts"},
        {"boxes": "box"},
        {"protocol": "kitti"},
        {"seeds": 5},
        {"seeds": ()},
        {"seeds": (-1,)},
        {"seeds": (1, 1)},  # the rows would never be complete
        {"seeds": range(10**12)},
        {"seeds": range(50_001)},  # of two policies each
    ],
)
def test_wrong_values_are_refused(wrong: dict[str, object]) -> None:
    with pytest.raises(CoopsimError):
        DetectPlan(**wrong)  # type: ignore[arg-type]
