"""Trackers of many sources in arrays of all tracks: each acts as by itself, and none costs by the number of others."""

from __future__ import annotations

import numpy as np
import pytest
from some_tracks import FRAME_NS, cars

from coopsim.agents.appearance import DinoCoDTTracking
from coopsim.agents.boxes import VicFSCMAssociation
from coopsim.agents.coop_fuse import CoopFuse
from coopsim.geometry.boxes import Boxes3D
from coopsim.tracking.ab3dmot_tracker import ab3dmot
from coopsim.tracking.side_by_side import TrackersInTurn, TrackersSideBySide, source_trackers
from coopsim.tracking.tracker import Tracker
from coopsim.types import Detections
from coopsim.types.estimates import diagonals
from coopsim.types.groups import DetectionGroups

SOURCES = [f"cav_{k}" for k in range(9)]


def seen(frame: int, rng: np.random.Generator, *, stated: bool) -> Detections:
    """Up to six moving objects of two classes around one place, so that sources would meet if they were compared."""
    count = int(rng.integers(0, 7))
    middle = np.array([[1.0 * frame, 12.0 * k, 0.8] for k in range(count)]).reshape(-1, 3)
    shape = np.tile([4.5, 1.9, 1.6, 0.1], (count, 1))
    boxes = Boxes3D.from_array(np.column_stack([middle + rng.normal(0, 0.4, (count, 3)), shape]))
    covariance = diagonals(rng.uniform(0.05, 0.5, (count, 7))) if stated and count else None
    return Detections(boxes, rng.random(count), rng.integers(0, 2, count), covariance)


@pytest.mark.parametrize("stated", [False, True])
@pytest.mark.parametrize("make", [ab3dmot, CoopFuse().make_tracker])
def test_each_source_has_the_tracker_that_it_has_by_itself_to_the_bit(make: object, stated: bool) -> None:
    """Some sources are silent in each frame, some start late, and some are forgotten and come back."""
    rng, apart = np.random.default_rng(7), TrackersInTurn(make)  # type: ignore[arg-type]
    together, some = TrackersSideBySide(make()), 0  # type: ignore[operator]
    for frame in range(40):
        sources = [name for k, name in enumerate(SOURCES) if frame >= k and rng.random() < 0.8]
        groups = DetectionGroups.of([seen(frame, rng, stated=stated) for _ in sources])
        expected, got = (each.step(sources, groups, frame * FRAME_NS) for each in (apart, together))
        for one, other in zip(expected, got, strict=True):
            np.testing.assert_array_equal(one, other)
        some += np.count_nonzero(got[1])
        if frame == 25:
            apart.keep(SOURCES[2:])
            together.keep(SOURCES[2:])
    assert some > 50


def test_trackers_that_compare_more_than_the_boxes_of_one_source_run_in_turn() -> None:
    assert isinstance(source_trackers(ab3dmot), TrackersSideBySide)
    assert isinstance(source_trackers(CoopFuse().make_tracker), TrackersSideBySide)
    for policy in (DinoCoDTTracking(), VicFSCMAssociation()):
        assert isinstance(source_trackers(policy.make_tracker), TrackersInTurn)


@pytest.mark.parametrize("agents", [4, 40])
def test_a_frame_of_many_sources_takes_the_calls_of_one(agents: int, monkeypatch: pytest.MonkeyPatch) -> None:
    calls = {"update": 0, "match": 0}
    tracker = ab3dmot()

    def counted(name: str, of: object, method: str) -> None:
        call = getattr(of, method)

        def count(*args: object) -> object:
            calls[name] += 1
            return call(*args)

        monkeypatch.setattr(type(of), method, lambda _, *args: count(*args))

    counted("match", tracker.first_round.association, "match_within")
    counted("update", tracker, "finish")
    trackers = TrackersSideBySide(tracker)
    assert isinstance(tracker, Tracker)
    for frame in range(3):
        groups = DetectionGroups.of([cars(1.0 * frame, 30.0 * k) for k in range(agents)])
        trackers.step([f"cav_{k}" for k in range(agents)], groups, frame * FRAME_NS)
    assert calls == {"update": 3, "match": 3}
