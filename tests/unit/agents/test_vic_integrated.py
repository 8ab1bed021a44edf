"""Integrated tracking in use: ids over frames, its options, and other trackers behind its detection branch."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import pytest

pytest.importorskip("torch")

from street_scene import FRAME_NS, observe, spec_of
from tiny_networks import learned

import coopsim
from coopsim.agents.perceiving_policy import PerceivingPolicy
from coopsim.errors import InvalidValueError, UnknownNameError
from coopsim.types import Observation, Sweep, Tracks

SURE: dict[str, Any] = {"detection_score": 0.3, "track_score": 0.3, "hits": 1}


def make(**settings: Any) -> PerceivingPolicy:
    policy = coopsim.make_policy("vic_integrated", **learned("vic_integrated", **(SURE | settings)))
    assert isinstance(policy, PerceivingPolicy)
    policy.reset({name: spec_of(name, "cav", policy.needs.uplink) for name in ("cav_0", "rsu_0")})
    return policy


def play(policy: PerceivingPolicy, *observations: Observation) -> list[Tracks]:
    reports = [policy.track("cav_0", each) for each in observations]
    for tracks in reports:
        tracks.validate()
    return reports


@pytest.mark.parametrize("settings", [{}, {"stages": 1}, {"affinity": "giou"}])
def test_ids_are_carried_over_frames_and_over_frames_without_sensors(settings: dict[str, Any]) -> None:
    frames = [replace(observe(k * FRAME_NS), sensed=k != 2) for k in range(5)]
    reports = play(make(**settings), *frames)
    assert all(len(tracks) for tracks in reports)
    assert {*reports[4].id.tolist()} & {*reports[0].id.tolist()} == {*reports[0].id.tolist()}
    assert {*reports[2].id.tolist()} <= {*reports[1].id.tolist()}


def test_what_is_not_seen_is_kept_and_found_again() -> None:
    policy = make()
    hidden = [replace(observe(k * FRAME_NS), sweeps={"lidar": Sweep.empty()}) for k in (1, 2, 3)]
    reports = play(policy, observe(0), *hidden, observe(4 * FRAME_NS))
    assert len(reports[0]) and len(reports[3]) == 0
    assert {*reports[4].id.tolist()} & {*reports[0].id.tolist()}
    forgets = play(make(keep=2), observe(0), *hidden, observe(4 * FRAME_NS))
    assert not {*forgets[4].id.tolist()} & {*forgets[0].id.tolist()}


def test_an_episode_that_begins_anew_knows_nothing_of_the_last() -> None:
    policy = make()
    first = play(policy, observe(0), observe(FRAME_NS))
    policy.reset(policy.specs)
    again = play(policy, observe(0), observe(FRAME_NS))
    assert all(len(tracks) for tracks in first)
    for a, b in zip(first, again, strict=True):
        assert a.id.tolist() == b.id.tolist() and a.boxes.array.tolist() == b.boxes.array.tolist()


def test_another_tracker_follows_what_the_detection_branch_finds() -> None:
    integrated, filtered = make(), make(tracker="vic_fscm_association(detection_score=0.3, hits=1)")
    reports = [play(each, *(observe(k * FRAME_NS) for k in range(3))) for each in (integrated, filtered)]
    assert len(reports[0][0]) == len(reports[1][0])
    assert integrated.detections("cav_0").score.tolist() == filtered.detections("cav_0").score.tolist()


@pytest.mark.parametrize(
    ("settings", "error", "match"),
    [
        ({"stages": 2}, InvalidValueError, "stages must be 1 or 4, got 2"),
        ({"affinity": "iou"}, UnknownNameError, "unknown affinity 'iou'"),
        ({"gate": 2.0}, InvalidValueError, r"gate must be in \[0, 1\]"),
        ({"keep": 0}, InvalidValueError, "keep must be"),
        ({"tracker": "integratde"}, UnknownNameError, "integratde"),
    ],
)
def test_wrong_settings_are_refused(settings: dict[str, Any], error: type[Exception], match: str) -> None:
    with pytest.raises(error, match=match):
        make(**settings)
