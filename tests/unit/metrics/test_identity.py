"""IDF1 on cases small enough to count by hand; `tests/golden/test_metric_parity.py` has the others."""

from __future__ import annotations

from math import nan

import pytest
from test_clear import Frame, evaluate

CASES: dict[str, tuple[list[Frame], dict[str, float]]] = {
    "perfect": ([({1: 0}, {9: 0})] * 4, {"IDF1": 100, "IDP": 100, "IDR": 100}),
    "nothing reported": ([({1: 0}, {})] * 4, {"IDF1": 0, "IDP": 0, "IDR": 0}),
    "nothing at all": ([({}, {})] * 4, {"IDF1": nan}),
    "a new track after 7 of 10": ([({1: 0}, {8: 0})] * 7 + [({1: 0}, {9: 0})] * 3, {"IDF1": 70, "IDP": 70, "IDR": 70}),
    "half is missed": ([({1: 0}, {9: 0}), ({1: 0}, {})] * 2, {"IDP": 100, "IDR": 50, "IDF1": 100 * 2 / 3}),
    # Track 8 is as long on one object as on the other; most is won when object 1 gets track 9: 2 + 3, and not 3 + 0.
    "what is best for all": (
        [({1: 0}, {8: 0})] * 3 + [({1: 0, 2: 20}, {9: 0, 8: 20})] * 2 + [({2: 20}, {8: 20})],
        {"IDR": 100 * 5 / 8, "IDP": 100 * 5 / 8},
    ),
    "a new id in every frame": ([({1: 0, 2: 20}, {k: 0, 1000 + k: 20}) for k in range(100)], {"IDF1": 1}),
}


@pytest.mark.parametrize(("frames", "expected"), CASES.values(), ids=CASES)
def test_by_hand(frames: list[Frame], expected: dict[str, float]) -> None:
    _, score = evaluate(frames)
    assert {name: score[name] for name in expected} == pytest.approx(expected, nan_ok=True)
