"""The kernels fuse as the numpy reference in `slow_fusion` does."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from slow_fusion import trust_likelier as slowly

from coopsim.agents.coop_fuse import DOUBT, HEARSAY, LEAST_CHANCE, MERGE_GATE
from coopsim.fusion.box_fusion import trust_likelier
from coopsim.fusion.fused_boxes import FusedBoxes
from coopsim.geometry.boxes import Boxes3D
from coopsim.geometry.se3 import Floats
from coopsim.types import Detections


def agents(seed: int, *, reach_m: float = 60.0) -> list[Detections]:
    """A street as up to seven agents detect it: noise, poses that are off and tilted, misses, clutter."""
    rng = np.random.default_rng(seed)
    count, classes = int(rng.integers(0, 30)), int(rng.integers(1, 4))
    places = np.column_stack([rng.uniform(-reach_m, reach_m, (count, 2)), rng.normal(0.8, 0.2, count)])
    sizes = np.array([[4.5, 1.9, 1.6], [0.7, 0.7, 1.8], [11.0, 2.8, 3.3]])
    label = rng.integers(0, classes, count)
    world = np.column_stack([places, sizes[label], rng.uniform(-np.pi, np.pi, count)])
    return [
        detected(world, label, classes, rng, reach_m) if rng.random() < 0.9 else Detections.empty()
        for _ in range(rng.integers(0, 8))
    ]


def detected(world: Floats, label: Floats, classes: int, rng: np.random.Generator, reach_m: float) -> Detections:
    seen = rng.random(len(world)) < rng.uniform(0.2, 1)
    rows = world[seen] + rng.normal(0, 1, (seen.sum(), 7)) * [0.4, 0.4, 0.3, 0.3, 0.1, 0.1, 0.1]
    turn, tilt = rng.normal(0, 0.01), rng.normal(0, 0.02, 2)
    x, y = rows[:, 0].copy(), rows[:, 1].copy()
    rows[:, :2] += np.column_stack([-turn * y, turn * x]) + rng.normal(0, 0.5, 2)
    rows[:, 2] += np.column_stack([x, y]) @ tilt
    extra = int(rng.integers(0, 5))
    clutter = np.column_stack(
        [rng.uniform(-reach_m, reach_m, (extra, 2)), np.ones(extra), rng.uniform(0.5, 5, (extra, 3)), np.zeros(extra)]
    )
    rows, labels = np.concatenate([rows, clutter]), np.concatenate([label[seen], rng.integers(0, classes, extra)])
    rows[:, 3:6] = np.maximum(rows[:, 3:6], 0.2)
    return Detections(Boxes3D.from_array(rows), rng.uniform(0.05, 1, len(rows)), labels)


def assert_equal(found: FusedBoxes, expected: FusedBoxes, atol: float = 1e-9) -> None:
    assert len(found.detections) == len(expected.detections)
    np.testing.assert_array_equal(found.detections.label, expected.detections.label)
    pairs = [
        (found.detections.boxes.array, expected.detections.boxes.array),
        (found.detections.score, expected.detections.score),
        (found.chance, expected.chance),
        (found.nearest_m, expected.nearest_m),
        (found.score, expected.score),
        (found.away_m, expected.away_m),
    ]
    for one, other in pairs:
        np.testing.assert_allclose(one, other, rtol=1e-9, atol=atol)
    for name in ("covariance", "embedding"):
        one, other = getattr(found.detections, name), getattr(expected.detections, name)
        if other is None:
            assert one is None
        else:
            np.testing.assert_array_equal(one, other)


@pytest.mark.parametrize("hearsay", [HEARSAY, None])
@pytest.mark.parametrize("least_chance", [0.0, LEAST_CHANCE, 1.0])
@pytest.mark.parametrize("gate", [MERGE_GATE, -1.0])
def test_many_scenes(hearsay: object, least_chance: float, gate: float) -> None:
    for seed in range(40):
        groups = agents(seed, reach_m=(15.0, 60.0, 200.0)[seed % 3])
        settings = (gate, DOUBT, hearsay, least_chance)
        assert_equal(trust_likelier(groups, *settings), slowly(groups, *settings))  # type: ignore[arg-type]


@pytest.mark.parametrize(("offset_m", "atol"), [(9_000.0, 1e-7), (2e5, 1e-5)])
def test_far_from_the_origin(offset_m: float, atol: float) -> None:
    for seed in range(20):
        groups = []
        for each in agents(seed):
            rows = each.boxes.array
            rows[:, :3] += offset_m
            groups.append(replace(each, boxes=Boxes3D.from_array(rows)))
        settings = (MERGE_GATE, DOUBT, HEARSAY, LEAST_CHANCE)
        assert_equal(trust_likelier(groups, *settings), slowly(groups, *settings), atol)


@pytest.mark.parametrize("where", [1e6, 1e150, 1e300])
def test_a_box_beyond_reason_among_others(where: float) -> None:
    for seed in range(20):
        groups = agents(seed)
        for number, each in enumerate(groups):
            if len(each) and number % 2:
                rows = each.boxes.array
                rows[0, :3] = where, -where, where
                groups[number] = replace(each, boxes=Boxes3D.from_array(rows))
        settings = (MERGE_GATE, DOUBT, HEARSAY, LEAST_CHANCE)
        found = trust_likelier(groups, *settings)
        assert np.isfinite(found.detections.boxes.array).all()
        if where <= 1e6:  # farther away rounding decides which of two boxes is likelier
            assert_equal(found, slowly(groups, *settings))


def test_invalid_boxes_are_dropped_first() -> None:
    rng = np.random.default_rng(0)
    for seed in range(30):
        groups = []
        for each in agents(seed):
            rows, score = each.boxes.array, each.score.copy()
            rows[rng.random(rows.shape) < 0.02] = rng.choice([np.nan, np.inf, -1.0])
            score[rng.random(len(score)) < 0.1] = np.nan
            groups.append(Detections(Boxes3D.from_array(rows), score, each.label))
        settings = (MERGE_GATE, DOUBT, HEARSAY, LEAST_CHANCE)
        assert_equal(trust_likelier(groups, *settings), slowly(groups, *settings))


@pytest.mark.parametrize("share", [0.5, 1.0])
def test_covariances_and_embeddings_that_some_agents_state(share: float) -> None:
    for seed in range(30):
        rng, groups = np.random.default_rng(seed), []
        for each in agents(seed):
            count = len(each)
            covariance = rng.normal(size=(count, 7, 7)) if rng.random() < share else None
            embedding = rng.normal(size=(count, rng.integers(1, 4))) if rng.random() < 0.6 else None
            if covariance is not None and count and rng.random() < 0.2:
                covariance[0, 0, 0] = np.nan
            groups.append(replace(each, covariance=covariance, embedding=embedding))
        settings = (MERGE_GATE, DOUBT, HEARSAY, LEAST_CHANCE)
        assert_equal(trust_likelier(groups, *settings), slowly(groups, *settings))
