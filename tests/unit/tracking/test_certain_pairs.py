"""The matching without all pairs against the plain one."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from coopsim.geometry.assignment import hungarian
from coopsim.tracking import affinity
from coopsim.tracking.affinity import BoxAffinity
from coopsim.tracking.certain_pairs import hungarian_by_rows, of_one_class

AFFINITIES: dict[str, BoxAffinity] = {
    **{name: getattr(affinity, name) for name in ("iou_3d", "giou_3d", "giou_bev", "xiou", "axial_xiou")},
    "giou_3d and score": replace(affinity.giou_3d, score_weight=0.6),
}
GATES = {"iou_3d": 0.01, "giou_3d": -0.2, "giou_bev": -0.2, "xiou": 0.4, "axial_xiou": 0.4, "giou_3d and score": -0.2}


def street(rng: np.random.Generator, count: int, width_m: float) -> np.ndarray:
    """Cars, trucks and people, some of them close together."""
    size = np.array([[4.5, 1.9, 1.6], [12.0, 2.5, 3.5], [0.6, 0.6, 1.7]])[rng.integers(3, size=count)]
    place = rng.uniform(-width_m, width_m, (count, 2))
    yaw, score = rng.choice([0.0, 1.6, 3.1], count), rng.uniform(size=count)
    return np.column_stack([place, size[:, 2] / 2, size, yaw, score])


@pytest.mark.parametrize("name", GATES)
@pytest.mark.parametrize("width_m", [8.0, 30.0, 150.0])
def test_pairs_are_those_of_all_affinities(name: str, width_m: float) -> None:
    of = AFFINITIES[name]
    assert of.clipping is not None
    rng = np.random.default_rng(7)
    for _ in range(60):
        tracks = street(rng, int(rng.integers(1, 40)), width_m)
        seen = np.flatnonzero(rng.random(len(tracks)) < 0.7)
        noisy = tracks[seen] + rng.normal(scale=[0.5, 0.5, 0.1, 0.2, 0.1, 0.1, 0.05, 0.1], size=(len(seen), 8))
        found = np.concatenate([noisy, street(rng, int(rng.integers(0, 20)), width_m)])
        found[:, 3:6] = np.maximum(found[:, 3:6], 0.1)
        classes = rng.integers(2, size=len(tracks)), rng.integers(2, size=len(found))
        for gate in (GATES[name], of.clipping.floor - 0.1, of.clipping.lowest, 0.7):
            expected = hungarian(of_one_class(of.compare(tracks, found), *classes), gate)
            rows, columns = hungarian_by_rows(of, tracks, found, classes, gate)
            if name == "iou_3d":  # pairs without overlap are all alike
                value = of.compare(tracks, found)
                assert value[rows, columns].sum() == pytest.approx(value[expected].sum())
                continue
            np.testing.assert_array_equal(rows, expected[0])
            np.testing.assert_array_equal(columns, expected[1])


def test_a_box_that_is_not_a_number_is_left_out_as_ever() -> None:
    tracks = street(np.random.default_rng(0), 5, 50.0)
    found, classes = tracks.copy(), (np.zeros(5, dtype=int), np.zeros(5, dtype=int))
    found[2, 0] = np.nan
    rows, columns = hungarian_by_rows(affinity.giou_3d, tracks, found, classes, -0.2)
    assert rows.tolist() == columns.tolist() == [0, 1, 3, 4]


@pytest.mark.parametrize("seed", range(20))
def test_a_track_that_shrank_through_zero_is_matched_as_ever(seed: int) -> None:
    rng = np.random.default_rng(seed)
    tracks, found = street(rng, 6, 4.0), street(rng, 6, 4.0)
    tracks[rng.integers(6), 4] = -1.0
    classes = np.zeros(6, dtype=int), np.zeros(6, dtype=int)
    expected = hungarian(affinity.giou_3d.compare(tracks, found), -0.2)
    rows, columns = hungarian_by_rows(affinity.giou_3d, tracks, found, classes, -0.2)
    np.testing.assert_array_equal(rows, expected[0])
    np.testing.assert_array_equal(columns, expected[1])
