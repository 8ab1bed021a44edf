"""An agent near which there is nothing to track says nothing about a tracker: undefined is not 0."""

from __future__ import annotations

import json
import math

import numpy as np
import pytest
from test_clear import Frame, evaluate

from coopsim.metrics.built_in import BUILT_IN, BYTES
from coopsim.metrics.deception import DECEPTION
from coopsim.metrics.driving import DRIVING
from coopsim.metrics.finding import FINDING
from coopsim.metrics.score import Score

PERFECT: list[Frame] = [({1: 0}, {9: 0})] * 100
GHOSTS: list[Frame] = [({}, {9: 0})] * 100
SILENT: list[Frame] = [({}, {})] * 100

COUNTS = {"IDS", "FRAG", "TP", "FP", "FN", "GT", "objects"}
DEFINED = COUNTS | {BYTES}
"""The metrics that are defined without objects."""

ELSEWHERE = {*DRIVING, *FINDING, *DECEPTION}
"""The metrics of runs in which cars are driven, senders are judged, or agents lie."""


def mean_of(*agents: list[Frame]) -> Score:
    return Score.mean({f"cav_{k}": evaluate(frames)[1] for k, frames in enumerate(agents)})


@pytest.mark.parametrize("lonely", [GHOSTS, SILENT])
def test_an_agent_without_objects_stays_out_of_the_mean(lonely: list[Frame]) -> None:
    alone, both = mean_of(PERFECT), mean_of(PERFECT, lonely)
    for name in set(BUILT_IN) - DEFINED - ELSEWHERE:
        assert both[name] == alone[name], name
        assert math.isnan(both.agents["cav_1"][name]), name
    assert both.all_tracks["MOTA"] == 100 and math.isnan(both.agents["cav_1"].all_tracks["MOTA"])
    assert both["FP"] == (50 if lonely is GHOSTS else 0) and both["GT"] == 50, "counts are over all agents"
    ignored = both.ignoring_false_positives()
    assert ignored["sAMOTA"] == 100 and ignored["FP"] == 0


def test_without_any_object_nothing_is_defined_but_counts() -> None:
    score = mean_of(GHOSTS, SILENT)
    undefined = {name for name, value in score.values.items() if math.isnan(value)}
    assert undefined == set(BUILT_IN) - DEFINED - ELSEWHERE and score["FP"] == 50
    row = score.table().splitlines()[2].split()
    assert row[:2] == ["all", "-"] and "nan" not in score.table()
    content = json.loads(json.dumps(score.to_dict(), allow_nan=False))
    assert content["sAMOTA"] is None and content["FP"] == 50 and content["agents"]["cav_0"]["MOTA"] is None


def test_a_value_that_is_undefined_for_an_agent_stays_out() -> None:
    one, other = (Score({"mine": value}, {}, "count") for value in (3.0, np.nan))
    assert Score.mean({"cav_0": one, "cav_1": other})["mine"] == 3
    assert math.isnan(Score.mean({"cav_0": other, "cav_1": other})["mine"])
