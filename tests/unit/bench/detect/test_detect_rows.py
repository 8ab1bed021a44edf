"""Rows: what they pool, and how they are shown."""

from __future__ import annotations

from dataclasses import replace

import pytest
from perceived_frames import detections, objects

from coopsim.bench.detect.detect import Measured, markdown_table, row_of
from coopsim.bench.detect.detect_plan import EVERYWHERE, DetectPlan, own_condition
from coopsim.bench.detect.perceived import Perceived
from coopsim.errors import InvalidValueError

GOOD = Perceived.of([detections((0, 0.9))], [objects(0)], messages=3, sent_bytes=300, ms={"policy": 10.0})
EMPTY = Perceived.of([detections()] * 3, [objects()] * 3, messages=1, sent_bytes=20, ms={"policy": 2.0})
PLACE = "no_fusion", own_condition(EVERYWHERE, position_noise_m=0.4, heading_noise_deg=0.2)


def test_episodes_count_by_their_frames() -> None:
    measured = [Measured.of(each, "coopsim") for each in (GOOD, EMPTY)]
    row = row_of(DetectPlan(), PLACE, {"lidar": "VLP-16"}, measured)
    assert row["frames"] == row["receiver_frames"] == 4 and row["objects"] == 1
    assert row["bytes_per_message"] == 80 and row["ms_policy"] == 4
    assert row["APBEV@0.5"] == 1 and row["APBEV@0.3 people"] is None and row["intervals"] == {}
    assert (row["noise"], row["delay_ms"], row["options"]) == ("0.4/0.2", None, {"lidar": "VLP-16"})


def test_what_is_farther_away_is_neither_found_nor_missed() -> None:
    """Cars at 10 and 50 m, of which the near one is found; one false box at 40 m."""
    found = [detections((40, 0.9), (10, 0.8)), detections(), detections((-10, 0.7))]
    perceived = Perceived.of(found, [objects(10, 50), objects(-12), objects()])
    everywhere, near, nearest = (
        row_of(DetectPlan(within_m=within_m), PLACE, {}, [Measured.of(perceived, "coopsim", within_m)])
        for within_m in (None, 30.0, 11.0)
    )
    assert [row["objects"] for row in (everywhere, near, nearest)] == [3, 2, 1]
    assert [row["within_m"] for row in (everywhere, near, nearest)] == [None, 30.0, 11.0]
    assert [row["APBEV@0.5"] for row in (everywhere, near, nearest)] == pytest.approx([1 / 6, 1 / 2, 1], abs=1e-6)
    assert [row["false_per_frame"] for row in (everywhere, near)] == pytest.approx([2 / 3, 1 / 3], abs=1e-6)
    assert markdown_table([near]).startswith("protocol coopsim, within 30 m of the receiver")
    with pytest.raises(InvalidValueError, match="within_m must be a finite number > 0, got 0"):
        DetectPlan(within_m=0)


def test_the_table_says_in_which_numbers_networks_multiply(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("COOPSIM_PRECISION", "bfloat16")
    for detector, arithmetic in (("simulated", None), ("pillars(least_score=0.2)", "bfloat16")):
        row = row_of(DetectPlan(detector=detector), PLACE, {}, [Measured.of(GOOD, "coopsim")])
        assert row["arithmetic"] == arithmetic
        assert ("coopsim, networks multiply in bfloat16\n" in markdown_table([row])) == (arithmetic is not None)
    plan = DetectPlan(("no_fusion", "attfuse"), detector="simulated")
    assert [plan.arithmetic(policy) for policy in plan.policies] == [None, "bfloat16"]


def test_without_messages_there_are_no_bytes() -> None:
    silent = replace(GOOD, messages=0, sent_bytes=0)
    row = row_of(DetectPlan(), PLACE, {}, [Measured.of(silent, "coopsim")])
    assert row["bytes_per_message"] == 0


def test_the_table_shows_intervals_and_leaves_out_empty_columns() -> None:
    row = row_of(DetectPlan(protocol="opencood"), PLACE, {}, [Measured.of(GOOD, "opencood")] * 3)
    text = markdown_table([row])
    assert text.startswith("protocol opencood") and "1.000 (1.00-1.00)" in text and "0.4/0.2" in text
    assert "delay_ms" not in text
    assert markdown_table([]) == "no results"


def test_hits_are_told_apart_by_returns_and_shown_in_two_protocols() -> None:
    """Cars: one that one agent sees well, one that only both together do, one with 5, one with 4 returns."""
    truth = objects(0, 20, 40, 60, returns=[[30, 0], [6, 5], [3, 2], [4, 0]])
    perceived = Perceived.of([detections((0, 0.9), (20, 0.8), (40, 0.7))], [truth])
    row = row_of(DetectPlan(), PLACE, {}, [Measured.of(perceived, "coopsim")])
    assert row["only_together"] == 1 / 4
    assert (row["APBEV@0.5"], row["APBEV@0.5 5_returns"]) == (3 / 4, 1)
    assert row["opencood"]["APBEV@0.5"] == 3 / 4
    assert markdown_table([row]).count("protocol ") == 2
    unknown = row_of(DetectPlan(), PLACE, {}, [Measured.of(GOOD, "coopsim")])
    assert unknown["only_together"] is None and unknown["APBEV@0.5 5_returns"] is None
