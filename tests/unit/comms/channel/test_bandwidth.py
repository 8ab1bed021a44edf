"""A medium sends one message at a time, in the order it was told, and drops what waited too long."""

from collections import Counter
from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st

from coopsim.comms.channel.bandwidth import Bandwidth, Medium
from coopsim.errors import InvalidValueError, UnknownNameError

MS = 1_000_000


def run(bandwidth: Bandwidth, arrivals_ms: list[int], size_bytes: int = 1000) -> list[tuple[int, int | None]]:
    """(number, when sent in ms or None) of messages that come at those times, in the order in which they leave."""
    medium: Medium[int] = Medium(bandwidth)
    left = []
    for number, at_ms in enumerate(arrivals_ms):
        left += list(medium.departures(at_ms * MS))
        medium.put(number, size_bytes, at_ms * MS)
    left += list(medium.departures(10**15))
    return [(each.content, None if each.sent_ns is None else each.sent_ns // MS) for each in left]


def test_a_message_takes_its_size_over_the_rate() -> None:
    assert Bandwidth(8e6).airtime_ns(100_000) == 100 * MS
    assert run(Bandwidth(8e5), [0, 100]) == [(0, 10), (1, 110)]


def test_who_comes_while_the_medium_is_busy_waits() -> None:
    assert run(Bandwidth(8e5), [0, 1, 2, 3]) == [(0, 10), (1, 20), (2, 30), (3, 40)]


def test_the_newest_may_be_first_but_interrupts_nobody() -> None:
    assert run(Bandwidth(8e5, order="newest_first"), [0, 1, 2, 3]) == [(0, 10), (3, 20), (2, 30), (1, 40)]


def test_what_waits_too_long_is_dropped() -> None:
    assert run(Bandwidth(8e5, max_wait_s=0.01), [0, 1, 2, 3]) == [(0, 10), (1, 20), (2, None), (3, None)]
    newest = run(Bandwidth(8e5, order="newest_first", max_wait_s=0.01), [0, 1, 2, 3])
    assert newest == [(0, 10), (3, 20), (1, None), (2, None)]


@pytest.mark.parametrize(
    ("order", "lags_ms"),
    [
        ("in_order", {"a": 0, "b": 0, "c": 0}),
        ("newest_first", {"a": 0, "b": 0, "c": 0}),
        ("newest_first", {"a": 0, "b": 5, "c": 9}),
    ],
)
def test_nobody_starves_on_a_medium_that_is_too_slow(order: str, lags_ms: dict[str, int]) -> None:
    medium: Medium[str] = Medium(Bandwidth(8e4, order=order, max_wait_s=0.35))  # type: ignore[arg-type]
    for frame in range(120):
        for sender, lag_ms in lags_ms.items():
            medium.put(sender, 1000, (100 * frame + lag_ms) * MS, sender)
    sent = Counter(each.content for each in medium.departures(12_000 * MS) if each.sent_ns is not None)
    assert sum(sent.values()) == 120  # one in each frame, of three
    assert set(sent.values()) == {40}


def test_the_newest_of_each_sender_is_first() -> None:
    medium: Medium[str] = Medium(Bandwidth(8e5, order="newest_first"))
    for number in range(3):
        for sender in "ab":
            medium.put(f"{sender}{number}", 1000, number * MS, sender)
    assert [each.content for each in medium.departures(10**12)] == ["a0", "b2", "a2", "b1", "a1", "b0"]


@given(
    gaps=st.lists(st.integers(0, 30), min_size=1, max_size=30),
    order=st.sampled_from(["in_order", "newest_first"]),
    max_wait_s=st.sampled_from([0.0, 0.02, float("inf")]),
)
def test_the_medium_is_never_used_twice_and_never_idle_while_somebody_waits(
    gaps: list[int], order: str, max_wait_s: float
) -> None:
    arrivals = [sum(gaps[: k + 1]) for k in range(len(gaps))]
    left = run(Bandwidth(8e5, order=order, max_wait_s=max_wait_s), arrivals)  # type: ignore[arg-type]
    assert sorted(number for number, _ in left) == list(range(len(gaps)))
    ends = sorted(sent for _, sent in left if sent is not None)
    assert all(later - sooner >= 10 for sooner, later in pairwise(ends))
    for number, sent in left:
        if sent is not None:
            waited = sent - 10 - arrivals[number]
            assert 0 <= waited <= max_wait_s * 1000
            assert waited == 0 or sent - 10 in ends


@pytest.mark.parametrize(
    ("options", "error", "match"),
    [
        ({"rate_bit_s": 0}, InvalidValueError, "rate_bit_s must be a finite number > 0, got 0"),
        ({"rate_bit_s": 0.5}, InvalidValueError, "rate_bit_s must be >= 1, got 0.5"),
        ({"rate_bit_s": 1e6, "medium": "air"}, UnknownNameError, "unknown medium 'air'"),
        ({"rate_bit_s": 1e6, "order": "random"}, UnknownNameError, "unknown order 'random'"),
        ({"rate_bit_s": 1e6, "max_wait_s": -1}, InvalidValueError, "max_wait_s must be >= 0"),
    ],
)
def test_bad_bandwidth(options: dict, error: type[Exception], match: str) -> None:  # type: ignore[type-arg]
    with pytest.raises(error, match=match):
        Bandwidth(**options)
