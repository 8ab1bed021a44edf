"""Measurements that come late: taken as they are, moved on, or put back in their place."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
from some_tracks import FRAME_NS, cars

from coopsim.errors import InvalidValueError
from coopsim.fusion.pooling import merge_duplicates
from coopsim.tracking.ab3dmot_tracker import ab3dmot
from coopsim.tracking.delayed import DELAYED, RECEIVER, AsIfCurrent, Measurement, PredictForward, RewindAndReplay
from coopsim.types import Detections, Tracks

SPEED_M_S = 12.0


def merged(groups: Sequence[Detections]) -> Sequence[Detections]:
    return [merge_duplicates(Detections.concatenate(groups), 0.2)]


def same(a: Tracks, b: Tracks) -> bool:
    return np.array_equal(a.id, b.id) and same_but_for_ids(a, b)


def same_but_for_ids(a: Tracks, b: Tracks) -> bool:
    parts = ((x.boxes.array, x.velocity, x.score, x.label) for x in (a, b))
    return all(np.array_equal(*pair) for pair in zip(*parts, strict=True))


def seen(source: str, frame: int, rng: np.random.Generator) -> Measurement:
    """Two moving cars and a parked one, a little noisy, some missed, something now and then that is not there."""
    x = np.array([SPEED_M_S * 0.1 * frame, 40 - SPEED_M_S * 0.1 * frame, 80.0]) + rng.normal(0, 0.1, 3)
    x = x[rng.random(3) < 0.85]
    ghost = rng.uniform(-50, 50, int(rng.random() < 0.2))
    return Measurement(source, frame * FRAME_NS, cars(*x, *ghost, score=float(rng.uniform(0.3, 0.9))))


@pytest.mark.parametrize("fusion", [lambda groups: groups, merged])
@pytest.mark.parametrize("seed", range(5))
def test_rewind_and_replay_is_exact_once_all_has_arrived(fusion: object, seed: int) -> None:
    rng = np.random.default_rng(seed)
    frames = 40
    taken = [seen(source, k, rng) for k in range(frames) for source in (RECEIVER, "rsu_0", "cav_1")]
    on_time = RewindAndReplay(ab3dmot, fusion)  # type: ignore[arg-type]
    late = RewindAndReplay(ab3dmot, fusion)  # type: ignore[arg-type]
    arrives = [
        m.captured_ns // FRAME_NS + (0 if m.source == RECEIVER or k > 3 * (frames - 8) else int(rng.integers(0, 7)))
        for k, m in enumerate(taken)
    ]
    differed = False
    for now in range(frames):
        expected = on_time.step([m for m in taken if m.captured_ns == now * FRAME_NS], now * FRAME_NS)
        due = [m for m, arrival in zip(taken, arrives, strict=True) if arrival == now]
        rng.shuffle(due)  # type: ignore[arg-type]
        got = late.step(due, now * FRAME_NS)
        differed |= not same_but_for_ids(got, expected)
    assert differed, "nothing was late enough to matter"
    assert len(got) and same_but_for_ids(got, expected)


def test_the_same_measurement_twice_counts_once() -> None:
    once, twice = RewindAndReplay(lambda: ab3dmot(hits=2)), RewindAndReplay(lambda: ab3dmot(hits=2))
    for k in range(4):
        own = Measurement(RECEIVER, k * FRAME_NS, cars(k * 1.0))
        heard = Measurement("cav_1", max(k - 1, 0) * FRAME_NS, cars(30.0))
        expected = once.step([own, heard], k * FRAME_NS)
        assert same(twice.step([own, heard, heard], k * FRAME_NS), expected)
        assert same(twice.step([own], k * FRAME_NS), expected)


def test_what_is_older_than_the_window_is_left_out_and_memory_stays() -> None:
    tracks = RewindAndReplay(lambda: ab3dmot(hits=1), window_s=0.5)
    for k in range(100):
        shown = tracks.step([Measurement(RECEIVER, k * FRAME_NS, cars(0.0))], k * FRAME_NS)
        old = tracks.step([Measurement("cav_1", (k - 8) * FRAME_NS, cars(50.0))], k * FRAME_NS)
        assert same(shown, old) and len(shown) == 1
    assert len(tracks._moments) == 6


@pytest.mark.parametrize("late_frames", [1, 3, 5])
def test_strategies_differ_by_how_far_tracks_lag(late_frames: int) -> None:
    """One car that only another agent sees: its position error is the delay times its speed, or next to nothing."""
    lag_m = {}
    for name in DELAYED:
        tracks = DELAYED.get(name)(ab3dmot)
        for k in range(60):
            heard = [Measurement("rsu_0", (k - late_frames) * FRAME_NS, cars(SPEED_M_S * 0.1 * (k - late_frames)))]
            shown = tracks.step([Measurement(RECEIVER, k * FRAME_NS, cars()), *heard], k * FRAME_NS)
        lag_m[name] = SPEED_M_S * 0.1 * k - float(shown.boxes.center[0, 0])
    assert lag_m["as_current"] == pytest.approx(SPEED_M_S * 0.1 * late_frames, abs=0.3)
    assert abs(lag_m["predict"]) < 0.3
    assert abs(lag_m["replay"]) < 0.3


def test_predicting_moves_what_its_own_source_saw_move() -> None:
    seen: list[Sequence[Detections]] = []

    def watch(groups: Sequence[Detections]) -> Sequence[Detections]:
        seen.append(groups)
        return groups

    tracks = PredictForward(ab3dmot, watch)
    for k in range(3, 13):
        then = k - 3  # a car at 10 m/s, one that stands, and one that comes into view in the end
        found = cars(1.0 * then, 30.0, *([60.0] * (k == 12)))
        tracks.step([Measurement("rsu_0", then * FRAME_NS, found)], k * FRAME_NS)
    np.testing.assert_allclose(seen[-1][0].boxes.center[:, 0], [12.0, 30.0, 60.0], atol=0.1)


def test_what_was_overtaken_by_newer_of_its_source_is_left_out() -> None:
    tracks = PredictForward(lambda: ab3dmot(hits=1))
    tracks.step([Measurement("rsu_0", 5 * FRAME_NS, cars(0.0))], 6 * FRAME_NS)
    tracks.step([Measurement("rsu_0", 3 * FRAME_NS, cars(50.0))], 7 * FRAME_NS)
    assert len(tracks.tracker.state.tracked) == 1


def test_who_is_silent_for_long_is_forgotten_and_what_is_far_too_old_left_out() -> None:
    tracks = PredictForward(lambda: ab3dmot(hits=1))
    for k in range(1, 300):
        source = f"pseudonym {k // 10}"
        tracks.step([Measurement(source, (k - 1) * FRAME_NS, cars(0.1 * k))], k * FRAME_NS)
    assert 1 <= len([*tracks._senders]) <= 6
    assert len(tracks.step([Measurement("rsu_0", 200 * FRAME_NS, cars(90.0))], 300 * FRAME_NS)) == 1
    assert "rsu_0" not in tracks._senders


@pytest.mark.parametrize("name", DELAYED.names())
@pytest.mark.parametrize(("first", "order"), [(RECEIVER, [9, 3, 7]), ("b", [7, 9, 3])])
def test_the_newest_of_each_source_the_most_trusted_first(name: str, first: str, order: list[int]) -> None:
    seen: list[float] = []

    def watch(groups: Sequence[Detections]) -> Sequence[Detections]:
        seen[:] = [float(group.score[0]) for group in groups]
        return groups

    def taken(source: str, score: float) -> Measurement:
        return Measurement(source, 0, replace(cars(0.0), score=np.array([score])))

    tracks = DELAYED.get(name)(ab3dmot, watch, first)
    tracks.step([taken("b", 7), taken("a", 3), taken(RECEIVER, 9)], 0)
    assert seen == order


def test_of_one_source_only_the_newest_counts() -> None:
    tracks = AsIfCurrent(lambda: ab3dmot(hits=1))
    arrived = [Measurement("b", captured_ns, cars(float(captured_ns))) for captured_ns in (5, 90, 30)]
    assert tracks.step(arrived, 90).boxes.center[:, 0].tolist() == [90.0]


@pytest.mark.parametrize("name", DELAYED.names())
def test_time_that_goes_back_is_refused_and_changes_nothing(name: str) -> None:
    tracks = DELAYED.get(name)(ab3dmot)
    expected = [tracks.step([Measurement(RECEIVER, k, cars(0))], k) for k in (0, FRAME_NS)][-1]
    with pytest.raises(InvalidValueError, match="time must not go back"):
        tracks.step([Measurement(RECEIVER, 5, cars(9))], 5)
    assert same(tracks.tracker.report(), expected)


@pytest.mark.parametrize("name", DELAYED.names())
def test_a_measurement_from_the_future_counts_as_one_of_now(name: str) -> None:
    ahead, now = DELAYED.get(name)(ab3dmot), DELAYED.get(name)(ab3dmot)
    for k in range(3):
        future = Measurement("cav_1", (k + 5) * FRAME_NS, cars(0.0))
        current = Measurement("cav_1", k * FRAME_NS, cars(0.0))
        assert same(ahead.step([future], k * FRAME_NS), now.step([current], k * FRAME_NS))


def test_as_if_current_is_the_plain_tracker() -> None:
    wrapped, plain = AsIfCurrent(ab3dmot), ab3dmot()
    for k in range(6):
        own, other = cars(1.0 * k), cars(30.0)
        measured = [Measurement("b", 0, other), Measurement(RECEIVER, k * FRAME_NS, own)]
        assert same(wrapped.step(measured, k * FRAME_NS), plain.step_in_turn([own, other], k * FRAME_NS))


def test_predicting_is_the_plain_tracker_until_a_message_is_late_and_then_knows_velocities() -> None:
    wrapped, plain = PredictForward(ab3dmot), AsIfCurrent(ab3dmot)

    def heard(frame: int) -> Measurement:
        return Measurement("b", frame * FRAME_NS, cars(SPEED_M_S * 0.1 * frame))

    for k in range(20):
        measured = [Measurement(RECEIVER, k * FRAME_NS, cars(80.0)), heard(k)]
        assert same(wrapped.step(measured, k * FRAME_NS), plain.step(measured, k * FRAME_NS))
    shown = wrapped.step([Measurement(RECEIVER, 24 * FRAME_NS, cars(80.0)), heard(21)], 24 * FRAME_NS)
    assert np.abs(shown.boxes.center[:, 0] - SPEED_M_S * 2.4).min() < 0.3


def test_replay_misses_nothing_before_news_of_it_can_have_arrived_and_waits_for_nobody_longer_than_its_window() -> None:
    """A car that only another agent sees, which falls silent: the track ends a window after its last message."""
    tracks, shown = RewindAndReplay(ab3dmot, window_s=0.6), []
    for k in range(30):
        late = k - 3
        heard = [Measurement("rsu_0", late * FRAME_NS, cars(SPEED_M_S * 0.1 * late))] if 0 <= late < 10 else []
        shown.append(len(tracks.step([Measurement(RECEIVER, k * FRAME_NS, cars()), *heard], k * FRAME_NS)))
    assert shown[6:15] == [1] * 9 and shown[20:] == [0] * 10


def test_replay_ends_what_the_receiver_alone_saw_as_soon_as_the_receiver_misses_it() -> None:
    """False boxes come and go: a track that waits for senders, who never said anything of it, is one more."""
    shown = {name: [] for name in ("predict", "replay")}
    for name, lengths in shown.items():
        tracks = DELAYED.get(name)(ab3dmot)
        for k in range(20):
            own = cars(5.0, *([60.0] if k < 10 else []))
            heard = [Measurement("rsu_0", (k - 5) * FRAME_NS, cars(30.0))] if k >= 5 else []
            lengths.append(len(tracks.step([Measurement(RECEIVER, k * FRAME_NS, own), *heard], k * FRAME_NS)))
    assert shown["replay"][9:] == [3, 3, *[2] * 9] == shown["predict"][9:]


def test_replay_confirms_nothing_that_a_sender_saw_once() -> None:
    tracks, late = RewindAndReplay(ab3dmot), 5
    for k in range(20):
        then = k - late
        heard = [Measurement("rsu_0", then * FRAME_NS, cars(30.0, *([70.0] * (then == 6))))] if then >= 0 else []
        shown = tracks.step([Measurement(RECEIVER, k * FRAME_NS, cars(5.0)), *heard], k * FRAME_NS)
        assert not (shown.boxes.center[:, 0] > 50).any(), f"frame {k}"
    assert len(shown) == 2


@pytest.mark.parametrize("late_frames", [4, 6])
def test_an_object_keeps_its_id_while_the_past_is_tracked_again(late_frames: int) -> None:
    """The sender's news of other objects changes, in the past, how many tracks began before this one."""
    rng, tracks, ids = np.random.default_rng(late_frames), RewindAndReplay(ab3dmot), dict[int, set[int]]()
    for k in range(60):
        then, sent = k - late_frames, cars(*(200.0 + 10 * rng.permutation(12)[: rng.integers(5)]))
        own = cars(*(10.0 * np.arange(k // 10 + 1)))  # every ten frames one more comes into view
        heard = [Measurement("cav_1", then * FRAME_NS, sent)] if then >= 0 else []
        shown = tracks.step([Measurement(RECEIVER, k * FRAME_NS, own), *heard], k * FRAME_NS)
        assert len(np.unique(shown.id)) == len(shown)
        for x, each in zip(shown.boxes.center[:, 0], shown.id.tolist(), strict=True):
            if x < 100:
                ids.setdefault(round(x / 10), set()).add(each)
    assert len(ids) == 6 and {len(each) for each in ids.values()} == {1}


def test_late_boxes_are_moved_by_the_velocities_that_they_were_sent_with() -> None:
    """At once, with no frame before: a receiver's tracker of the sender would have no velocity yet."""
    sent = replace(cars(10.0, 60.0, 90.0), velocity=np.array([[20.0, -5.0], [np.nan, np.nan], [0.0, 0.0]]))
    told: list[Sequence[Detections]] = []
    strategy = PredictForward(ab3dmot, lambda groups: told.append(groups) or groups)
    strategy.step([Measurement("cav_1", 0, sent)], 3 * FRAME_NS)
    (group,) = told[0]
    np.testing.assert_allclose(group.boxes.center[:, :2] - sent.boxes.center[:, :2], [[6.0, -1.5], [0, 0], [0, 0]])
