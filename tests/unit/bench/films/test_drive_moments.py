"""Moments of a drive, in an order that can be: seen, tracked, braked; a track that nobody saw was heard of."""

from __future__ import annotations

import numpy as np

from coopsim.bench.films.drive_moments import Events, closed, find_moments, kept_unseen, last_view, relied_on
from coopsim.types import Mask
from tests.helpers.drives import PEDESTRIAN, Thing, drive, straight


def mask(count: int, *ranges: tuple[int, int]) -> Mask:
    made = np.zeros(count, np.bool_)
    for first, end in ranges:
        made[first:end] = True
    return made


def test_a_glimpse_that_was_lost_is_no_knowledge() -> None:
    sight, known = mask(60, (1, 25), (35, 52)), mask(60, (21, 23), (39, 48))
    assert last_view(sight, 51) == (35, 25)
    assert relied_on(known, [41], 51) == (39, 41), "not the glimpse at 21, before it was in sight again"
    assert not kept_unseen(known, 39, 35, 25, 51)


def test_a_track_that_lasts_while_nothing_is_seen_was_heard_of() -> None:
    sight, known = mask(90, (1, 25), (36, 90)), mask(90, (1, 39), (43, 49))
    seen, hidden = last_view(sight, 80)
    track, brake = relied_on(known, [5, 44], 80)
    assert (seen, hidden, track, brake) == (36, 25, 1, 5)
    assert kept_unseen(known, 1, seen, hidden, 80)
    assert not kept_unseen(mask(90, (0, 30)), 0, 38, 28, 80), "an own track goes on for a moment"


def test_what_was_never_in_sight_can_only_be_heard_of() -> None:
    assert last_view(mask(9), 8) == (None, 0)
    assert relied_on(mask(9), [3], 8) == (None, 3) and relied_on(mask(9, (2, 9)), [], 8) == (2, None)
    assert kept_unseen(mask(9, (2, 9)), 2, None, 0, 8)


def test_gaps_of_a_few_frames_are_no_gaps() -> None:
    assert closed(mask(20, (2, 4), (7, 9), (13, 15))).tolist() == mask(20, (2, 9), (13, 15)).tolist()


def test_moments_come_in_their_order_and_in_words() -> None:
    person = Thing(PEDESTRIAN, straight(30.0, -4.5, 0.0, 1.5), seen_s=1.5, tracked_s=0.8, conflicts=True)
    log = drive([0.0] * 12 + [-6.0] * 12, [person]).drive
    alone = find_moments(log, {}, [frozenset()] * len(log))
    told = find_moments(log, {"cav_2": 3}, [frozenset({"cav_2"})] * len(log))
    assert alone.told_by is None and told.told_by == "cav_2" and not told.again
    assert [text for _, _, text in told.words()] == ["heard of it from cav_2", "brakes hard", "in sight"]
    crash = Events(3.5, True, 3.9, 4.1, 5.1, 16 / 3.6, 51, None)
    assert [text for _, _, text in crash.words()] == [
        "in sight again",
        "has a track",
        "brakes hard",
        "crash at 16 km/h",
    ]
