"""CLEAR on cases small enough to count by hand, and against a slow reading of its definition."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.optimize import linear_sum_assignment

from coopsim.errors import InvalidValueError, UnknownNameError
from coopsim.geometry.assignment import cheapest_assignment
from coopsim.geometry.boxes import Boxes3D
from coopsim.geometry.iou import iou_3d
from coopsim.metrics.evaluator import Evaluator, FrameCounts
from coopsim.metrics.score import Score, summarize
from coopsim.types import GroundTruth, Tracks

Frame = tuple[dict[int, float], dict[int, float]]
"""Where objects are along x, by id; where tracks are, by id."""


def boxes(places: dict[int, float]) -> Boxes3D:
    return Boxes3D.from_array(np.array([[x, 0, 0, 4, 2, 1.5, 0] for x in places.values()]).reshape(-1, 7))


def truth(places: dict[int, float], label: int = 0) -> GroundTruth:
    return GroundTruth(np.array(list(places), dtype=int), boxes(places), np.full(len(places), label))


def tracks(places: dict[int, float], label: int = 0, scores: dict[int, float] | None = None) -> Tracks:
    score = np.array([(scores or {}).get(track, 0.5) for track in places])
    ids = np.array(list(places), dtype=int)
    return Tracks(ids, boxes(places), np.zeros((len(places), 2)), score, np.full(len(places), label))


def evaluate(frames: list[Frame], **settings: float) -> tuple[list[FrameCounts], Score]:
    evaluator = Evaluator(**settings)
    counts = [evaluator.update(truth(objects), tracks(found)) for objects, found in frames]
    return counts, summarize([evaluator.log])


CASES: dict[str, tuple[list[Frame], dict[str, float]]] = {
    "perfect": ([({1: 0}, {9: 0})] * 4, {"TP": 4, "FP": 0, "FN": 0, "IDS": 0, "FRAG": 0, "MOTA": 100, "MT": 100}),
    "nothing reported": ([({1: 0}, {})] * 4, {"TP": 0, "FN": 4, "MOTA": 0, "ML": 100, "MOTP": 0}),
    "nothing there": ([({}, {9: 0})] * 4, {"FP": 4, "GT": 0, "objects": 0, "MOTA": np.nan, "ML": np.nan}),
    "nothing at all": ([({}, {})] * 2, {"TP": 0, "FP": 0, "FN": 0, "MOTA": np.nan}),
    "a switch": (
        [({1: 0}, {9: 0})] * 2 + [({1: 0}, {8: 0})] * 2,
        {"TP": 4, "IDS": 1, "FRAG": 0, "MOTA": 75},
    ),
    "a switch over a gap": (
        [({1: 0}, {9: 0}), ({1: 0}, {}), ({1: 0}, {8: 0})],
        {"TP": 2, "FN": 1, "IDS": 1, "FRAG": 1},
    ),
    "a gap without a switch": ([({1: 0}, {9: 0}), ({1: 0}, {}), ({1: 0}, {9: 0})], {"IDS": 0, "FRAG": 1, "FN": 1}),
    "the same pair is kept although another is nearer": (
        [({1: 0}, {9: 0}), ({1: 0}, {9: 1.0, 8: 0.0}), ({1: 0}, {9: 1.0, 8: 0.0})],
        {"TP": 3, "FP": 2, "IDS": 0},
    ),
    "a kept pair that fell below the threshold is given up": (
        [({1: 0}, {9: 0}), ({1: 0}, {9: 3.0, 8: 0.0})],
        {"TP": 2, "FP": 1, "IDS": 1},
    ),
    "two tracks exchange objects": (
        [({1: 0, 2: 20}, {8: 0, 9: 20}), ({1: 0, 2: 20}, {9: 0, 8: 20})],
        {"TP": 4, "IDS": 2},
    ),
}


@pytest.mark.parametrize(("frames", "expected"), CASES.values(), ids=CASES)
def test_by_hand(frames: list[Frame], expected: dict[str, float]) -> None:
    counts, score = evaluate(frames)
    for name, value in expected.items():
        assert score.all_tracks[name] == pytest.approx(value, nan_ok=True), name
    assert sum(c.tp for c in counts) == score.all_tracks["TP"]
    assert sum(c.fp for c in counts) == score.all_tracks["FP"]
    assert sum(c.idsw for c in counts) == score.all_tracks["IDS"]


def test_classes_never_match_and_are_told_apart() -> None:
    evaluator = Evaluator()
    for _ in range(3):
        assert evaluator.update(truth({1: 0}), tracks({9: 0}, label=7)) == FrameCounts(0, 1, 1, 0, 1)
    evaluator.update(truth({2: 5}, label=7), tracks({8: 5}, label=7))
    score = summarize([evaluator.log])
    assert score.classes["car"].all_tracks["FN"] == 3
    assert score.classes["pedestrian"].all_tracks["TP"] == 1
    assert score.classes["pedestrian"].all_tracks["FP"] == 3
    assert score.all_tracks["FP"] == 3 and score.all_tracks["FN"] == 3 and score.all_tracks["TP"] == 1


def test_ignored_false_positives_cost_nothing() -> None:
    evaluator = Evaluator()
    for _ in range(5):
        evaluator.update(truth({1: 0}), tracks({9: 0, 7: 30, 6: 60}))
    count, ignore = (summarize([evaluator.log], false_positives=each) for each in ("count", "ignore"))
    assert count.all_tracks["FP"] == 10 and count.all_tracks["MOTA"] == -100
    assert ignore.all_tracks["FP"] == 0 and ignore.all_tracks["MOTA"] == 100
    assert "ignored" in ignore.table() and "ignored" not in count.table()


def test_ignoring_false_tracks_is_as_if_they_had_not_been_reported() -> None:
    rng = np.random.default_rng(0)
    sure = {5: 0.5, 6: 0.4, 7: 0.9, 8: 0.3}  # of them 5 and 6 are on an object
    with_false, without = {}, {}
    for name in ("cav_0", "cav_1"):
        logs = Evaluator(), Evaluator()
        for _ in range(20):
            places = {k: x for k, x in {5: 0.0, 6: 10.0, 7: 40.0, 8: 60.0}.items() if rng.random() < 0.7}
            right = {k: x for k, x in places.items() if k in (5, 6)}
            for evaluator, reported in zip(logs, (places, right), strict=True):
                evaluator.update(truth({1: 0, 2: 10}), tracks(reported, scores=sure))
        with_false[name], without[name] = (summarize([each.log], bytes_per_s=1.0) for each in logs)
    counted, expected = Score.mean(with_false), Score.mean(without)
    got = counted.ignoring_false_positives()
    parts = [(got, expected), (got.classes["car"], expected.classes["car"]), (got.bands["0-30 m"], expected)]
    for ours, theirs in [*parts, *((got.agents[name], without[name]) for name in without)]:
        assert ours.all_tracks == theirs.all_tracks and ours.false_positives == "ignore"
        for name in ("sAMOTA", "AMOTA", "AMOTP", "MOTA", "MT", "IDS", "FP", "FN", "precision"):
            assert ours[name] == theirs[name]
    assert counted["FP"] > 0 and counted["MOTA"] < got["MOTA"]
    for name in ("HOTA", "IDF1", "AP3D@0.5", "AMOTA@2m", "bytes_per_s"):  # these count them in any case
        assert got[name] == counted[name]
    with pytest.raises(InvalidValueError, match="ask the whole score"):
        counted.classes["car"].ignoring_false_positives()


def test_sequences_are_pooled_and_ids_are_their_own() -> None:
    logs = []
    for _ in range(2):
        evaluator = Evaluator()
        for _ in range(3):
            evaluator.update(truth({1: 0}), tracks({9: 0}))
        logs.append(evaluator.log)
    score = summarize(logs)
    assert score["objects"] == 2 and score["TP"] == 6 and score["IDS"] == 0


def test_unknown_metrics_are_named() -> None:
    _, score = evaluate([({1: 0}, {9: 0})])
    with pytest.raises(UnknownNameError, match=r"unknown metric 'MOTTA'. Did you mean 'MOTA'"):
        score["MOTTA"]


def slow_clear(frames: list[Frame], threshold: float) -> dict[str, int]:
    """CLEAR as it is written down, one object at a time, with SciPy's assignment."""
    last: dict[int, int] = {}
    before: dict[int, int] = {}
    total = {"TP": 0, "FP": 0, "FN": 0, "IDS": 0, "FRAG": 0}
    runs: dict[int, int] = {}
    for objects, found in frames:
        overlap = iou_3d(boxes(objects).array, boxes(found).array)
        gain = np.where(overlap >= threshold, overlap, 0)
        for i, object_ in enumerate(objects):
            for j, track in enumerate(found):
                if gain[i, j] > 0 and before.get(object_) == track:
                    gain[i, j] += 1000
        now = {}
        for i, j in zip(*linear_sum_assignment(gain, maximize=True), strict=True):
            if gain[i, j] > 0:
                now[list(objects)[i]] = list(found)[j]
        for object_, track in now.items():
            total["IDS"] += object_ in last and last[object_] != track
            runs[object_] = runs.get(object_, 0) + (object_ not in before)
        total["TP"] += len(now)
        total["FP"] += len(found) - len(now)
        total["FN"] += len(objects) - len(now)
        last |= now
        before = now
    total["FRAG"] = sum(count - 1 for count in runs.values())
    return total


def crowd(step: float) -> st.SearchStrategy[dict[int, float]]:
    """Places that differ a little from id to id: equally good matchings would leave the choice open."""
    places = st.dictionaries(st.integers(0, 5), st.floats(0, 12), max_size=5)
    return places.map(lambda found: {k: round(x, 3) + step * (k + 1) ** 1.5 for k, x in found.items()})


@given(st.lists(st.tuples(crowd(0.00137), crowd(0.00071)), min_size=1, max_size=12), st.sampled_from([0.1, 0.25, 0.5]))
def test_crowds_as_the_definition_says(frames: list[Frame], threshold: float) -> None:
    counts, score = evaluate(frames, match_iou=threshold)
    expected = slow_clear(frames, threshold)
    assert {name: score.all_tracks[name] for name in expected} == expected
    assert sum(c.idsw for c in counts) == expected["IDS"]


@given(st.integers(1, 7), st.integers(0, 4), st.integers(0, 2**31))
def test_the_compiled_assignment_is_optimal(rows: int, more: int, seed: int) -> None:
    cost = np.random.default_rng(seed).normal(size=(rows, rows + more))
    got = cheapest_assignment(cost)
    best = cost[linear_sum_assignment(cost)].sum()
    assert len(set(got)) == rows
    np.testing.assert_allclose(cost[np.arange(rows), got].sum(), best)
