"""HOTA on cases small enough to count by hand; `tests/golden/test_metric_parity.py` has the others."""

from __future__ import annotations

from math import nan

import pytest
from test_clear import Frame, evaluate

CASES: dict[str, tuple[list[Frame], dict[str, float]]] = {
    "perfect": ([({1: 0}, {9: 0})] * 4, {"HOTA": 100, "DetA": 100, "AssA": 100, "LocA": 100}),
    "nothing reported": ([({1: 0}, {})] * 4, {"HOTA": 0, "DetA": 0, "AssA": 0, "LocA": 100}),
    "nothing at all": ([({}, {})] * 4, {"HOTA": nan, "DetA": nan, "AssA": nan}),
    # Each half's track is there for half of the object's life.
    "a new track half-way": (
        [({1: 0}, {8: 0})] * 5 + [({1: 0}, {9: 0})] * 5,
        {"DetA": 100, "AssA": 50, "HOTA": 100 * 0.5**0.5},
    ),
    "as many false as true": ([({1: 0}, {9: 0, 8: 50})] * 4, {"DetA": 50, "AssA": 100, "HOTA": 100 * 0.5**0.5}),
    # 3 m of 4 m in common, so IoU 3/5: a match at 12 of 19 thresholds.
    "1 m off": ([({1: 0}, {9: 1})] * 4, {"DetA": 100 * 12 / 19, "AssA": 100 * 12 / 19}),
    # Nearness 1 - 1.1 / 2 = 0.45: a match at 9 of 19 thresholds.
    "1.1 m off, by distance": ([({1: 0}, {9: 1.1})] * 4, {"DetA@2m": 100 * 9 / 19, "HOTA@2m": 100 * 9 / 19}),
    "2 m off, by distance": ([({1: 0}, {9: 2})] * 4, {"DetA@2m": 0, "HOTA@2m": 0}),
}


@pytest.mark.parametrize(("frames", "expected"), CASES.values(), ids=CASES)
def test_by_hand(frames: list[Frame], expected: dict[str, float]) -> None:
    _, score = evaluate(frames)
    assert {name: score[name] for name in expected} == pytest.approx(expected, nan_ok=True)


def test_the_alignment_over_the_sequence_decides_between_rivals() -> None:
    """In the last frame track 8 is nearer, but 9 has been the object's all along."""
    _, score = evaluate([({1: 0}, {9: 0})] * 9 + [({1: 0}, {9: 0.2, 8: 0.0})])
    assert score["AssA"] > 99
