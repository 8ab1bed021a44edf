"""A receiver's memory of senders: a tracker for those that are asked about, and none for the others."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from some_tracks import FRAME_NS, cars

from coopsim.tracking.ab3dmot_tracker import ab3dmot
from coopsim.tracking.delayed import RECEIVER, Measurement, RewindAndReplay
from coopsim.tracking.senders import Senders
from coopsim.tracking.side_by_side import TrackersSideBySide
from coopsim.types.groups import DetectionGroups


@pytest.fixture
def stepped(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Names of senders, each as often as its tracker has stepped."""
    names: list[str] = []
    step = TrackersSideBySide.step

    def noted(self: Any, sources: Any, *rest: Any) -> Any:
        names.extend(sources)
        return step(self, sources, *rest)

    monkeypatch.setattr(TrackersSideBySide, "step", noted)
    return names


def remembered(frames: range, sources: tuple[str, ...] = ("a", "b")) -> Senders:
    """A memory of senders that see a car at 10 m/s each."""
    senders = Senders(lambda: ab3dmot(hits=2))
    for k in frames:
        groups = DetectionGroups.of(cars(k * 1.0 + 100 * number) for number in range(len(sources)))
        senders.take(sources, groups, k * FRAME_NS)
    return senders


def test_who_is_asked_about_is_followed_from_what_is_remembered(stepped: list[str]) -> None:
    senders = remembered(range(5))
    assert not stepped
    last = senders.newest("b")
    assert stepped == ["b"] * 5
    np.testing.assert_allclose(last.velocity, [[10.0, 0.0]], atol=0.5)
    assert last.at(6 * FRAME_NS).boxes.center[0, 0] == pytest.approx(106.0, abs=0.2)
    assert len(last.confirmed_at(0)) == 1
    senders.take(["a", "b"], DetectionGroups.of([cars(5.0), cars(105.0)]), 5 * FRAME_NS)
    assert stepped == ["b"] * 6, "from then on in every frame, and nobody else"


def test_it_does_not_matter_when_one_asks() -> None:
    early, late = remembered(range(1)), remembered(range(1))
    early.newest("a"), early.newest("b")
    for k in range(1, 9):
        for senders in (early, late):
            senders.take(["a", "b"], DetectionGroups.of([cars(k * 1.0), cars(k * 1.1, 80.0)]), k * FRAME_NS)
    for name in ("a", "b"):
        one, other = early.newest(name), late.newest(name)
        np.testing.assert_array_equal(one.velocity, other.velocity)
        np.testing.assert_array_equal(one.confirmed, other.confirmed)


def test_a_sender_that_was_forgotten_begins_anew(stepped: list[str]) -> None:
    senders = remembered(range(4), ("a",))
    senders.newest("a")
    senders.forget(10 * FRAME_NS)
    assert list(senders) == []
    senders.take(["a"], DetectionGroups.of([cars(30.0)]), 20 * FRAME_NS)
    stepped.clear()
    last = senders.newest("a")
    assert stepped == ["a"] and not last.confirmed.any() and not last.velocity.any()  # type: ignore[union-attr]


def test_replay_follows_those_alone_that_were_silent(stepped: list[str]) -> None:
    replay = RewindAndReplay(ab3dmot)
    for k in range(6):
        names = ["a", "b", "c"] if k != 3 else ["a", "c"]
        heard = [Measurement(name, k * FRAME_NS, cars(k * 1.0, 50.0)) for name in [RECEIVER, *names]]
        replay.step(heard, k * FRAME_NS)
    assert set(stepped) == {"b"} and len(stepped) == 5
