"""Situations say what is in conflict, so that an episode has lead times whether or not the car reacts."""

from __future__ import annotations

import math

from coopsim.bench.evaluate import evaluate
from coopsim.metrics.driving import DRIVING


def test_a_situation_has_all_metrics_of_driving() -> None:
    values = evaluate("truth", "occluded_pedestrian-v3", seed=1000, max_cycles=80).score.values
    assert set(DRIVING) <= set(values)
    assert values["crash"] == values["phantom_brakes"] == 0
    assert values["lead_time"] > 1.0
    assert values["lead_time"] > values["lead_time_braked"] > 0
    assert {name for name in DRIVING if math.isnan(values[name])} == {
        "impact_speed",
        "route_completion",
        "success",
    }


def test_an_ordinary_run_has_none() -> None:
    assert not set(DRIVING) & set(evaluate("no_fusion", "crossing-v3", seed=0, max_cycles=3, lidar=None).score.values)
