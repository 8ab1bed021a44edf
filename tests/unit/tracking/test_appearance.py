"""Found again by its looks: after a long occlusion, and across agents; and nothing of it without embeddings."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from some_tracks import FRAME_NS, cars, tracks

from coopsim.agents.appearance import NIMBLE, DinoCoDTTracking
from coopsim.errors import InvalidValueError
from coopsim.fusion.pooling import pool
from coopsim.geometry.assignment import hungarian
from coopsim.geometry.boxes import Boxes3D
from coopsim.tracking.ab3dmot_tracker import ab3dmot
from coopsim.tracking.affinity import iou_3d
from coopsim.tracking.appearance import Appearance
from coopsim.tracking.by_class import TrackersByClass
from coopsim.tracking.cascade import Cascade, Stage
from coopsim.tracking.delayed import RECEIVER, Measurement, RewindAndReplay
from coopsim.tracking.lifecycle import HitsAndAge, Remembered, VelocityAdaptiveAge
from coopsim.tracking.motion.constant_velocity import ConstantVelocity
from coopsim.tracking.track_states import EmbeddingMemory
from coopsim.tracking.tracker import Tracker
from coopsim.types import Detections, Tracks

RED, BLUE, GREEN = np.eye(3)
NONE = np.zeros(3)


def people(*objects: tuple[float, float, np.ndarray], score: float = 0.9) -> Detections:
    """Pedestrians at (x, y) that look like something."""
    rows = np.array([[x, y, 0.9, 0.6, 0.6, 1.7, 0.0] for x, y, _ in objects]).reshape(-1, 7)
    looks = np.array([look for *_, look in objects]).reshape(-1, 3)
    return Detections(Boxes3D.from_array(rows), np.full(len(rows), score), np.full(len(rows), 7), embedding=looks)


def blind(found: Detections) -> Detections:
    return replace(found, embedding=None)


def run(tracker: TrackersByClass, frames: Sequence[Detections]) -> list[Tracks]:
    return [tracker.step(found, k * FRAME_NS) for k, found in enumerate(frames)]


def ids_from_left(report: Tracks) -> list[int]:
    return report.id[np.argsort(report.boxes.center[:, 0])].tolist()


def same(a: Sequence[Tracks], b: Sequence[Tracks]) -> bool:
    return all(
        np.array_equal(getattr(x, name), getattr(y, name))
        for x, y in zip(a, b, strict=True)
        for name in ("id", "velocity", "score", "label")
    ) and all(np.array_equal(x.boxes.array, y.boxes.array) for x, y in zip(a, b, strict=True))


def behind_a_van(hidden: int = 12) -> list[Detections]:
    """Two people walk behind a van from either side, turn round there, and come out where they went in."""
    walk = [people((0.14 * k, 0, RED), (5 - 0.14 * k, 0, BLUE)) for k in range(12)]
    return walk + [people()] * hidden + walk[::-1]


def test_after_a_long_occlusion_looks_bring_the_id_back() -> None:
    """Boxes alone lose both people; told to wait for them, they take each for the other."""
    frames = behind_a_van()
    reports = run(DinoCoDTTracking().make_tracker(), frames)
    assert [len(report) for report in reports[13:24]] == [0] * 11, "what is only remembered is not reported"
    lost = run(DinoCoDTTracking().make_tracker(), [blind(each) for each in frames])
    swapped = run(DinoCoDTTracking(age=20).make_tracker(), [blind(each) for each in frames])
    before = ids_from_left(reports[11])
    assert len(before) == 2
    assert ids_from_left(reports[-1]) == before
    assert not set(ids_from_left(lost[-1])) & set(before)
    assert ids_from_left(swapped[-1]) == before[::-1]


def test_how_long_a_lost_object_is_known_is_a_time_not_a_number_of_frames() -> None:
    """The same walk and the same 12 hidden frames, seen ten times a second and twice."""
    frames = behind_a_van()
    for frame_ns, known in ((FRAME_NS, True), (5 * FRAME_NS, False)):
        one = tracker()
        reports = [one.step(found, k * frame_ns) for k, found in enumerate(frames)]
        assert (ids_from_left(reports[-1]) == ids_from_left(reports[11])) == known


def test_the_older_id_wins_over_a_track_that_was_not_reported_yet() -> None:
    """Coming out, a person is half hidden at first: for two frames there is a box, and no embedding."""
    frames = behind_a_van()
    for number in (24, 25):
        frames[number] = replace(frames[number], embedding=np.zeros((2, 3)))
    reports = run(tracker(), frames)
    assert ids_from_left(reports[-1]) == ids_from_left(reports[11])
    assert len({number for report in reports for number in report.id.tolist()}) == 2
    frames[26] = replace(frames[26], embedding=np.zeros((2, 3)))  # then the new ids were reported: they stay
    late = run(tracker(), frames)
    assert not set(ids_from_left(late[-1])) & set(ids_from_left(late[11]))


def test_two_that_were_seen_at_once_are_two_however_alike() -> None:
    """A second one, dressed the same, appears beside a person who is then lost."""
    frames = [people((0, 0, RED))] * 8 + [people((0, 0, RED), (2, 0, RED))] + [people((2, 0, RED))] * 4
    reports = run(tracker(), frames)
    assert reports[7].id.tolist() != reports[-1].id.tolist()


def test_too_long_too_far_or_too_different_is_not_the_same() -> None:
    frames = behind_a_van()
    for setting in ({"window_s": 0.8}, {"reach_m": 0.01}, {"similarity": 1.0}):
        first, last = (ids_from_left(run(tracker(**setting), noisy(frames))[k]) for k in (11, -1))
        assert not set(first) & set(last)
    assert ids_from_left(run(tracker(), noisy(frames))[-1]) == ids_from_left(run(tracker(), noisy(frames))[11])


def tracker(**options: float) -> TrackersByClass:
    return DinoCoDTTracking(**options).make_tracker()  # type: ignore[arg-type]


def noisy(frames: list[Detections]) -> list[Detections]:
    rng = np.random.default_rng(0)
    return [replace(each, embedding=each.embedding + rng.normal(0, 0.05, (len(each), 3))) for each in frames]


def test_without_embeddings_boxes_and_age_alone_decide() -> None:
    rng = np.random.default_rng(3)
    crowd = [cars(*(10 * np.arange(6) + 0.2 * k)[rng.random(6) < 0.7]) for k in range(40)]
    rule = VelocityAdaptiveAge(3, 2, 0.2)
    plain = Tracker(ConstantVelocity(), Cascade([Stage(iou_3d, hungarian, 0.01)]), rule)
    expected = run(TrackersByClass(plain, {NIMBLE: ab3dmot()}), crowd)
    assert len(expected[-1]) and same(run(DinoCoDTTracking().make_tracker(), crowd), expected)


def test_one_object_that_two_agents_place_apart_is_one_track() -> None:
    """Pose noise moves the other agent's boxes by a metre: no overlap, but the same looks at the same time."""
    for k, found in enumerate(([RED, RED], [RED, BLUE], [RED, NONE])):
        frames = [pool([people((0.1 * t, 0, found[0])), people((0.1 * t, 1.0, found[1]))]) for t in range(6)]
        assert len(run(DinoCoDTTracking().make_tracker(), frames)[-1]) == (1 if k == 0 else 2)


def test_two_objects_that_one_agent_sees_are_two_however_alike() -> None:
    both = people((0, 0, RED), (2, 0, RED))
    assert len(run(tracker(), [pool([both])] * 4)[-1]) == 2
    assert len(run(tracker(), [pool([both, people((0, 1, RED))])] * 4)[-1]) == 2
    between = pool([people((0, 0, RED), (0, 2, RED), score=0.9), people((0, 1, RED), score=0.95)])
    assert len(run(tracker(), [between] * 4)[-1]) == 2


def repeated(rule: Appearance, found: Detections, *matched: int) -> list[bool]:
    shown = rule.repeats(found, np.array(matched, dtype=np.int64))
    return (shown != np.arange(len(found))).tolist()


def test_which_detections_repeat_others() -> None:
    rule = Appearance(cross_reach_m=5.0)
    found = pool([people((0, 0, RED), (9, 0, BLUE), score=0.5), people((1, 0, RED), (20, 0, BLUE), score=0.9)])
    assert repeated(rule, found) == [True, False, False, False]  # the surer stands, 11 m are too far
    assert repeated(rule, found, 0) == [False, False, True, False]  # whatever has a track stands
    assert repeated(rule, found, 0, 1, 2, 3) == [False] * 4
    assert repeated(rule, replace(found, seen_by=None)) == [False] * 4
    assert repeated(rule, replace(found, embedding=None)) == [False] * 4
    assert repeated(rule, found[:0]) == []
    assert repeated(Appearance(cross_reach_m=np.inf), found) == [True, True, False, False]


@pytest.mark.parametrize("matched", [(), (0,), (1,)])
def test_an_object_that_three_agents_see_is_one(matched: tuple[int, ...]) -> None:
    found = pool([people((x, 0, RED)) for x in (0, 1, 2)])
    assert sum(repeated(Appearance(), found, *matched)) == 2


def test_the_id_lives_on_in_another_agents_boxes_however_they_are_placed() -> None:
    """The receiver loses what it tracks; the same looks, 4.4 m off by the sender's pose, carry the id over."""
    for first, then in (("own", "other"), ("other", "own")):
        frames = []
        for k in range(24):
            seen = {first} if k < 12 else {then}
            own, other = people((0.1 * k, 0, RED)), people((0.1 * k + 4.4, 0, RED))
            frames.append(pool([own if "own" in seen else people(), other if "other" in seen else people()]))
        reports = run(DinoCoDTTracking().make_tracker(), frames)
        assert [len(report) for report in reports[2:]] == [1] * 22
        assert len({int(report.id[0]) for report in reports[2:]}) == 1, f"{first}, then {then}"


def test_both_see_it_and_then_the_other_alone() -> None:
    both = [pool([people((0.1 * k, 0, RED)), people((0.1 * k + 4.4, 0, RED))]) for k in range(12)]
    alone = [pool([people(), people((0.1 * k + 4.4, 0, RED))]) for k in range(12, 24)]
    reports = run(DinoCoDTTracking().make_tracker(), both + alone)
    assert reports[11].id.tolist() == reports[-1].id.tolist()


def test_a_repeated_view_refreshes_the_memory() -> None:
    """From its own side the other agent sees another colour; after one frame of both, the track is known by both."""
    turned = 0.95 * RED + np.sqrt(1 - 0.95**2) * BLUE
    both = [pool([people((0, 0, RED)), people((1, 0, turned))]) for _ in range(4)]
    trackers = DinoCoDTTracking().make_tracker()
    run(trackers, both)
    memory = trackers.state[1].tracked.appearance
    assert len(memory) == 1
    np.testing.assert_allclose(memory.similarity(np.array([RED, turned])), 1.0, atol=1e-6)


def test_what_looks_like_the_memory_repeats_its_track_though_not_what_is_seen_of_it_now() -> None:
    side = 0.6 * RED + 0.8 * BLUE
    memory = EmbeddingMemory.blank(0, 3, 4).begin([BLUE], 0).update(np.array([0]), np.array([side]), 1)
    found = pool([people((0, 0, side)), people((1, 0, BLUE))])
    matched = np.array([0])
    assert Appearance().repeats(found, matched).tolist() == [0, 1]
    assert Appearance().repeats(found, matched, memory).tolist() == [0, 0]


@given(st.integers(0, 2**31))
def test_no_agents_view_is_lost_by_another_view_of_its_own(seed: int) -> None:
    """Per agent, at most as many are repeated as others saw; one agent's alone never."""
    rng = np.random.default_rng(seed)
    groups = [people(*((*rng.uniform(0, 6, 2), rng.normal(size=3)) for _ in range(rng.integers(0, 5)))) for _ in "abc"]
    rule, found = Appearance(cross_similarity=-1.0, cross_reach_m=np.inf), pool(groups)
    largest = max(len(group) for group in groups)
    assert repeated(rule, found).count(False) >= largest
    assert not any(repeated(rule, pool(groups[:1])))


@pytest.mark.parametrize("seed", range(3))
def test_rewind_and_replay_is_exact_with_embeddings(seed: int) -> None:
    rng = np.random.default_rng(seed)
    scene = [[each[rng.random(len(each)) < 0.8] for _ in "ab"] for each in noisy(behind_a_van())]
    on_time, late = (RewindAndReplay(DinoCoDTTracking().make_tracker, DinoCoDTTracking().fuse) for _ in "ab")
    delayed: list[Measurement] = []
    differed = False
    for k, (mine, theirs) in enumerate(scene):
        own, heard = Measurement(RECEIVER, k * FRAME_NS, mine), Measurement("cav_1", k * FRAME_NS, theirs)
        expected = on_time.step([own, heard], k * FRAME_NS)
        arrived = [*delayed, own, heard] if k == len(scene) - 1 else [own, *delayed[: k % 3]]
        got = late.step(arrived, k * FRAME_NS)
        delayed = [*delayed[k % 3 :], heard]
        differed |= not same([got], [expected])
    assert differed, "nothing was late enough to matter"
    assert same([got], [expected]) and len(got)


def test_memory_is_that_of_the_tracks_alive_and_states_do_not_change() -> None:
    rng = np.random.default_rng(0)
    trackers = tracker()
    for k in range(300):
        crowd = people(*((x, 0, rng.normal(size=3)) for x in rng.uniform(-40, 40, 5)))
        before = trackers.state
        kept = [state.tracked.appearance.vectors.copy() for state in before]
        trackers.step(crowd, k * FRAME_NS)
        for state, vectors in zip(before, kept, strict=True):
            np.testing.assert_array_equal(state.tracked.appearance.vectors, vectors)
    alive = [state.tracked for state in trackers.state]
    assert all(each.appearance.vectors.shape[:2] == (len(each), 30) for each in alive)
    assert sum(map(len, alive)) < 5 * 30


def test_the_first_width_stands_while_a_track_is_known_by_it() -> None:
    wide = replace(people((0, 0, RED)), embedding=np.ones((1, 5)))
    memory = EmbeddingMemory.blank(2, dim=0, window=3)
    assert memory.ready_for(blind(wide)) is memory
    ready = memory.ready_for(wide)
    assert (ready.dim, len(ready), ready.known.tolist()) == (5, 2, [False, False])
    assert ready.ready_for(people((0, 0, RED))).dim == 3
    known = ready.update(np.array([0]), wide.embedding, 0)
    assert known.ready_for(people((0, 0, RED))) is known
    assert np.isnan(known.readable(people((0, 0, RED)))).all()
    assert np.isneginf(Appearance().affinity(tracks(0, 9, memory=known), people((0, 0, RED)))).all()


def test_what_is_remembered_is_not_reported_and_not_compared_by_boxes() -> None:
    rule = Remembered(HitsAndAge(hits=3, age=2), hits=3)
    memory = EmbeddingMemory.blank(0, 3, 1).begin([RED, RED, RED, NONE, RED], 5)
    memory = memory.update(np.arange(4), [RED, RED, RED, NONE], 7).since(6)
    known = tracks(*range(5), memory=memory, hits=[3, 3, 2, 3, 3], misses=[0, 5, 5, 5, 5])
    assert rule.alive(known).tolist() == [True, True, False, False, False]
    assert rule.reported(known, frame=50).tolist() == [True, False, False, False, False]
    expected = tracks(*range(5), memory=memory, hits=3, misses=[1, 2, 3, 9, 6])
    assert rule.in_view(expected).tolist() == [True, True, False, True, False]


@pytest.mark.parametrize(
    ("setting", "message"),
    [
        ({"views": 0}, "views must be an integer >= 1"),
        ({"window_s": 0}, "window_s must be a finite number > 0"),
        ({"similarity": 1.5}, r"similarity must be in \[-1, 1\]"),
        ({"cross_similarity": float("nan")}, r"cross_similarity must be in \[-1, 1\]"),
        ({"reach_m": 0}, r"reach_m must be > 0 \(inf: no limit\)"),
        ({"cross_reach_m": "far"}, r"cross_reach_m must be > 0 \(inf: no limit\)"),
    ],
)
def test_bad_settings(setting: dict[str, float], message: str) -> None:
    with pytest.raises(InvalidValueError, match=message):
        Appearance(**setting)  # type: ignore[arg-type]
    if "views" not in setting:
        with pytest.raises(InvalidValueError, match=message):
            DinoCoDTTracking(**setting)  # type: ignore[arg-type]
