"""Plans: which frames are measured, and what a row's environment is given."""

from __future__ import annotations

import pytest

from coopsim.bench.detect.detect_plan import DetectPlan, Disturbance, pace_of
from coopsim.bench.detect.episode import Pace
from coopsim.errors import CoopsimError


@pytest.mark.parametrize(
    ("every_s", "delay_s", "fixed_s", "step_s", "every", "warm_up"),
    [
        (0.5, 0.0, None, 0.5, 1, 1),
        (0.5, 0.5, None, 0.5, 1, 3),
        (0.5, 0.1, None, 0.1, 5, 3),
        (0.5, 0.2, None, 0.2, 3, 3),
        (0.1, 0.3, None, 0.1, 1, 7),
        (0.5, 0.3, 0.1, 0.1, 5, 7),
        (0.05, 0.0, 0.1, 0.1, 1, 1),
    ],
)
def test_a_delay_is_a_whole_number_of_frames(
    every_s: float, delay_s: float, fixed_s: float | None, step_s: float, every: int, warm_up: int
) -> None:
    made, pace = pace_of(10, every_s, delay_s, fixed_s)
    assert made == pytest.approx(step_s) and pace == Pace(10, every, warm_up)


def test_the_frames_of_a_pace() -> None:
    pace = Pace(3, 2, 1)
    assert [frame for frame in range(10) if pace.measures(frame)][:3] == [1, 3, 5] and pace.cycles == 6


def test_rows_are_noises_times_delays() -> None:
    plan = DetectPlan(noises=((0, 0), (0.4, 0.4)), delays_ms=(0, 200))
    assert len(list(plan.rows())) == 2 * 2 * 2
    assert Disturbance(0.4, 0.4, 200).options == pytest.approx(
        {"position_noise_m": 0.4, "heading_noise_rad": 0.00698131700797, "latency_s": 0.2}
    )
    assert Disturbance().options == {}


def test_the_detector_is_of_policies_that_have_none() -> None:
    plan = DetectPlan(policies=("no_fusion",), detector="simulated", options={"lidar": None})
    (job, _) = plan.jobs_of("no_fusion", "crossing", Disturbance())
    assert job.options == {"threads": 1, "lidar": None, "detector": "simulated", "dt_s": 0.5}


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
    ],
)
def test_wrong_values_are_refused(wrong: dict[str, object]) -> None:
    with pytest.raises(CoopsimError):
        DetectPlan(**wrong)  # type: ignore[arg-type]
