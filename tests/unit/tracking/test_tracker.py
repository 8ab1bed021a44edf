"""The tracker's life: birth, report, coasting, death; and what it does with rubbish."""

from __future__ import annotations

import tracemalloc
from collections.abc import Callable
from dataclasses import replace
from typing import ClassVar

import numpy as np
import pytest

from coopsim.errors import InvalidValueError
from coopsim.geometry.assignment import hungarian
from coopsim.geometry.boxes import Boxes3D
from coopsim.geometry.se3 import Floats
from coopsim.tracking.ab3dmot_tracker import ab3dmot
from coopsim.tracking.affinity import center_distance, giou_3d
from coopsim.tracking.cascade import Cascade, Stage, missed, nothing, score_from
from coopsim.tracking.lifecycle import ByScore, HitsAndAge, Latest, Likelihood, ShrunkMean
from coopsim.tracking.motion.constant_velocity import ConstantVelocity
from coopsim.tracking.track_states import TrackStates
from coopsim.tracking.tracker import AssociationRound, Tracker
from coopsim.types import Detections, Mask, Tracks

FRAME_NS = 100_000_000


def cars(*xy: tuple[float, float], score: float = 0.8) -> Detections:
    rows = np.array([[x, y, 0.8, 4.5, 1.9, 1.6, 0.0] for x, y in xy]).reshape(-1, 7)
    return Detections(Boxes3D.from_array(rows), np.full(len(rows), score), np.zeros(len(rows), dtype=int))


def run(frames: list[Detections], **settings: int) -> list[Tracks]:
    tracker = ab3dmot(**settings)  # type: ignore[arg-type]
    return [tracker.step(found, k * FRAME_NS) for k, found in enumerate(frames)]


def test_every_track_is_reported_in_the_first_frames_then_only_confirmed_ones() -> None:
    late = cars((0, 0), (50, 0))
    reports = run([cars((0, 0))] * 5 + [late] * 4)
    assert [len(tracks) for tracks in reports] == [1] * 5 + [1, 1, 2, 2]


def test_a_missed_track_is_carried_on_for_age_less_one_frames() -> None:
    moving = [cars((k * 1.0, 0)) for k in range(10)]
    reports = run([*moving, cars(), cars(), cars()], age=3)
    assert [len(tracks) for tracks in reports[-3:]] == [1, 1, 0]
    np.testing.assert_allclose(reports[-2].boxes.center[0, 0], 11.0, atol=0.3)


def test_ids_are_kept_and_never_used_twice() -> None:
    reports = run([cars((0, 0), (20, 0))] * 5 + [cars()] * 3 + [cars((0, 0))] * 5)
    first, second = set(reports[4].id.tolist()), set(reports[-1].id.tolist())
    assert len(first) == 2 and len(second) == 1 and not first & second


def test_the_score_is_that_of_the_last_detection() -> None:
    reports = run([cars((0, 0), score=0.3), cars((0, 0), score=0.9), cars()])
    assert [tracks.score.tolist() for tracks in reports] == [[0.3], [0.9], [0.9]]


def test_confidence_is_asked_once_a_frame_and_of_all_tracks_whether_they_are_reported_or_not() -> None:
    class OfAll(Latest):
        asked: ClassVar[list[int]] = []

        def confidence(self, tracks: TrackStates) -> Floats:
            self.asked.append(len(tracks))
            share: Floats = tracks.score / tracks.score.sum()
            return share

    tracker = Tracker(ConstantVelocity(), Cascade([Stage(giou_3d, hungarian, -0.2)]), ByScore(0.5), scoring=OfAll())
    both = Detections.concatenate([cars((0, 0), score=0.6), cars((30, 0), score=0.2)])
    reports = [tracker.step(both, k * FRAME_NS) for k in range(3)]
    assert OfAll.asked == [2, 2, 2]
    assert [tracks.score.tolist() for tracks in reports] == [pytest.approx([0.75])] * 3
    assert tracker.state.tracked.confidence.tolist() == pytest.approx([0.75, 0.25])


def test_time_between_frames_may_be_anything() -> None:
    tracker = ab3dmot()
    time_ns = 0
    for dt_s in (0.0, 0.05, 0.2, 0.1, 0.31, 0.02, 0.1, 0.1):
        time_ns += round(dt_s * 1e9)
        tracks = tracker.step(cars((10.0 * time_ns / 1e9, 0)), time_ns)
    np.testing.assert_allclose(tracks.velocity, [[10.0, 0]], atol=0.5)


def test_time_must_not_go_back() -> None:
    tracker = ab3dmot()
    tracker.step(cars((0, 0)), 5)
    with pytest.raises(InvalidValueError, match="time must not go back, got 4 ns after 5 ns"):
        tracker.step(cars((0, 0)), 4)
    assert len(tracker.step(cars((0, 0)), 5)) == 1


def test_rubbish_is_left_out_and_poisons_nothing() -> None:
    rows = np.tile([0.0, 0, 0.8, 4.5, 1.9, 1.6, 0], (6, 1))
    rows[1, 0], rows[2, 3], rows[3, 4], rows[4, 6] = np.nan, -1.0, 0.0, np.inf
    scores = np.array([0.9, 0.9, 0.9, 0.9, 0.9, np.nan])
    bad = Detections(Boxes3D.from_array(rows), scores, np.zeros(6, dtype=int))
    for tracks in run([bad, bad, cars((0, 0)), bad]):
        assert len(tracks) == 1
        tracks.validate()


def test_thousands_of_boxes_in_a_frame() -> None:
    rng = np.random.default_rng(0)
    crowd = cars(*rng.uniform(-500, 500, (2000, 2)).tolist())
    first, again = run([crowd, crowd])
    assert len(first) == len(again) == 2000
    assert set(first.id) == set(again.id)


def test_reset_forgets() -> None:
    tracker = ab3dmot()
    tracker.step(cars((0, 0)), 10)
    tracker.reset()
    assert tracker.step(cars((0, 0)), 0).id.tolist() == [1]


def test_memory_is_that_of_the_tracks_alive() -> None:
    rng = np.random.default_rng(0)
    tracker = ab3dmot()

    def play(first: int, frames: int) -> None:
        for k in range(first, first + frames):
            tracker.step(cars(*rng.uniform(-50, 50, (5, 2)).tolist()), k * FRAME_NS)

    play(0, 200)
    tracemalloc.start()
    before = tracemalloc.get_traced_memory()[0]
    play(200, 2000)
    grown = tracemalloc.get_traced_memory()[0] - before
    tracemalloc.stop()
    assert grown < 100_000


def test_a_frame_is_one_hit_however_many_groups_see_the_object() -> None:
    tracker = ab3dmot(hits=2)
    for k in range(2):
        tracker.step(cars(), k * FRAME_NS)  # past the frames in which everything is reported
    reports = [tracker.step_in_turn([cars((0, 0))] * 3, k * FRAME_NS) for k in (2, 3)]
    assert [len(tracks) for tracks in reports] == [0, 1]


def test_later_groups_see_what_earlier_ones_began() -> None:
    tracks = ab3dmot().step_in_turn([cars((0, 0)), cars((0.2, 0), (30, 0))], 0)
    assert tracks.id.tolist() == [1, 2]
    assert 0.0 < tracks.boxes.center[0, 0] < 0.2


def test_later_groups_may_be_taken_otherwise() -> None:
    again = AssociationRound(Cascade([Stage(giou_3d, hungarian, -0.2, tracks=missed)]), initiator=nothing)
    first = Cascade([Stage(giou_3d, hungarian, -0.2)])
    tracker = Tracker(ConstantVelocity(), first, HitsAndAge(1, 3), later=again)
    tracker.step(cars((0, 0), (30, 0)), 0)
    tracks = tracker.step_in_turn([cars((0, 0)), cars((1, 0), (30.4, 0), (60, 0))], FRAME_NS)
    # The track at 0 has been seen already, that at 30 is found by the second group, which may begin none.
    np.testing.assert_allclose(tracks.boxes.center[:, 0], [0, 30.4], atol=0.05)


def test_rules_by_class_and_by_score_make_a_tracker() -> None:
    def of_class(label: int) -> Callable[[Detections], Mask]:
        return lambda found: found.label == label

    stages = [
        Stage(center_distance, hungarian, gate, detections=of_class(label)) for label, gate in ((0, -4.0), (7, -0.5))
    ]
    tracker = Tracker(ConstantVelocity(), Cascade(stages), ByScore(report=0.5, drop=0.2, age=3, coast=0))

    def both(x: float, score: float) -> Detections:
        return replace(cars((x, 0), (x, 20), score=score), label=np.array([0, 7]))

    assert tracker.step(both(0.0, 0.6), 0).id.tolist() == [1, 2]
    again = tracker.step(both(2.0, 0.7), FRAME_NS)  # near enough for a car, too far for a pedestrian
    assert again.id.tolist() == [1, 3]
    assert len(tracker.step(both(4.0, 0.4), 2 * FRAME_NS)) == 0  # doubtful: kept, not reported
    assert 1 in tracker.step(both(6.0, 0.6), 3 * FRAME_NS).id
    assert len(tracker.step(both(8.0, 0.1), 4 * FRAME_NS)) == 0  # given up
    assert 1 not in tracker.step(both(10.0, 0.9), 5 * FRAME_NS).id


def test_who_may_begin_a_track_and_how_its_score_follows() -> None:
    first = Cascade([Stage(giou_3d, hungarian, -0.2)])
    tracker = Tracker(
        ConstantVelocity(), first, HitsAndAge(1, 3), scoring=ShrunkMean(0.2, 10), initiator=score_from(0.5)
    )
    assert len(tracker.step(cars((0, 0), score=0.4), 0)) == 0
    reports = [
        tracker.step(cars(*[(0, 0)] * (score > 0), score=score), k) for k, score in enumerate((0.6, 0.3, 0.0), 1)
    ]
    expected = [(2 + 0.6) / 11, (2 + 0.6 + 0.3) / 12, (2 + 0.6 + 0.3) / 13]
    assert [tracks.score[0] for tracks in reports] == pytest.approx(expected)


def test_a_track_is_as_likely_as_its_life_says() -> None:
    def odds(*scores: float, young: float = 0.0, missed: float = 0.0) -> float:
        stages = Cascade([Stage(giou_3d, hungarian, -0.2)])
        scoring = Likelihood(bias=-2, mean=4, latest=1, young=young, missed=missed)
        tracker = Tracker(ConstantVelocity(), stages, HitsAndAge(1, 9, coast=9), scoring=scoring)
        for k, score in enumerate(scores):
            tracks = tracker.step(cars(*[(0, 0)] * (score > 0), score=score), k * FRAME_NS)
        return float(np.log(tracks.score[0] / (1 - tracks.score[0])))

    assert odds(0.6) == pytest.approx(-2 + 4 * (2 + 0.6) / 11 + 0.6)
    assert odds(0.6, 0.9) == pytest.approx(-2 + 4 * (2 + 1.5) / 12 + 0.9)
    assert odds(0.6, 0.9, 0.0) == pytest.approx(-2 + 4 * (2 + 1.5) / 13)
    assert odds(0.6, 0.9, 0.0, 0.9) > odds(0.6, 0.9, 0.0)
    assert odds(0.6, 0.9, young=-0.5, missed=-3) == pytest.approx(odds(0.6, 0.9) - 0.5 / 2)
    assert odds(0.6, 0.9, 0.0, young=-0.5, missed=-3) == pytest.approx(odds(0.6, 0.9, 0.0) - 0.5 / 2 - 3)
