"""Maps of features are shared with requests, and what others ask for is sent first."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pytest

from coopsim.comms.envelope import decode_features
from coopsim.comms.uplinks.budget import SELECTIONS, WithinBudget
from coopsim.comms.uplinks.once_per_frame import EncodeOnce
from coopsim.comms.uplinks.share_features import ShareMaps
from coopsim.errors import InvalidValueError
from coopsim.types import AgentSpec, BevGrid, Detections, FeatureMap, Message, Observation, Odometry, PoseEstimate

GRID = BevGrid((-16, 16), (-16, 16), 2.0)
FRAME_NS = 100_000_000


@dataclass
class Encoded:
    message: FeatureMap


def uplink(sure: dict[str, Any], codec: str = "sparse_features(most_cells=4)", **options: Any) -> ShareMaps:
    """An uplink of maps with these confidences, by agent."""

    def encode(view: Any) -> Encoded:
        confidence = np.asarray(sure[view.agent], np.float32)
        return Encoded(FeatureMap(np.ones((2, *GRID.shape)), GRID, confidence, space=9))

    made = ShareMaps(EncodeOnce(encode), codec, **options)
    for name in sure:
        made.begin(AgentSpec(name, "cav", 0.1), np.random.default_rng(0))
    return made


def observe(time_ns: int, xy: Any = (0, 0), *inbox: Message) -> Observation:
    pose = PoseEstimate(np.array([*xy, 0.0, 1.0]))  # maps are in the world's axes: the heading does not matter
    return Observation(time_ns, pose, Odometry(np.zeros(4)), Detections.empty(), inbox=inbox)


def said(made: ShareMaps, sender: str, seen: Observation) -> Message:
    message = made.message(sender, seen)
    assert message is not None
    return message


def test_what_others_do_not_know_is_sent_first() -> None:
    sender = np.full(GRID.shape, 0.5)
    sender[2, 2], sender[12, 13] = 0.9, 0.6  # the receiver knows the first one
    receiver = np.zeros(GRID.shape)
    receiver[:8, :8] = 0.95
    made = uplink({"cav_0": sender, "cav_1": receiver}, "sparse_features(most_cells=1)", request_block=8)
    first = decode_features(said(made, "cav_0", observe(0)))
    assert first.sent is not None and first.sent[2, 2] and first.request is not None and first.space == 9
    asked = said(made, "cav_1", observe(0))
    request = decode_features(asked).request
    assert request is not None
    np.testing.assert_allclose(request, [[0.05, 1], [1, 1]], atol=0.01)
    made.hear("cav_0", observe(0, (0, 0), asked))
    second = decode_features(said(made, "cav_0", observe(FRAME_NS)))
    assert second.sent is not None and second.sent[12, 13] and second.sent.sum() == 1
    assert second.confidence is not None and second.confidence[12, 13] == pytest.approx(0.6, abs=0.003)


def test_a_request_is_for_places_in_the_world() -> None:
    sender = np.full(GRID.shape, 0.1)
    sender[4, 1], sender[4, 14] = 0.9, 0.8
    receiver = np.full(GRID.shape, 0.95)  # who stands 16 m to the west knows the sender's west
    made = uplink({"cav_0": sender, "cav_1": receiver}, "sparse_features(most_cells=1)", request_block=8)
    made.hear("cav_0", observe(0, (0, 0), said(made, "cav_1", observe(0, (-16, 0)))))
    sent = decode_features(said(made, "cav_0", observe(FRAME_NS))).sent
    assert sent is not None and sent[4, 14]


def test_old_foreign_and_broken_requests_do_not_count() -> None:
    sure = {"cav_0": np.eye(16) * 0.9, "cav_1": np.full(GRID.shape, 0.95)}
    made = uplink(sure, request_block=8)
    asked = said(made, "cav_1", observe(0))
    without = said(uplink(sure), "cav_1", observe(0))
    broken = [replace(asked, payload=asked.payload[:30]), replace(asked, codec="nobody's"), without]
    for heard in ([], broken):
        made.hear("cav_0", observe(0, (0, 0), *heard))
        assert not made._asked["cav_0"]
    made.hear("cav_0", observe(FRAME_NS, (0, 0), asked))
    made.hear("cav_0", observe(2 * FRAME_NS))
    assert set(made._asked["cav_0"]) == {"cav_1"}
    made.hear("cav_0", observe(12 * FRAME_NS))
    assert not made._asked["cav_0"]


@pytest.mark.parametrize("axis", [0, 1])
@pytest.mark.parametrize("side", [-1, 1])
@pytest.mark.parametrize(("away_m", "counts"), [(9_999.0, True), (10_001.0, False), (1e300, False)])
def test_requests_count_up_to_ten_kilometres_away(axis: int, side: int, away_m: float, counts: bool) -> None:
    made = uplink({"cav_0": np.eye(16) * 0.9, "cav_1": np.full(GRID.shape, 0.95)}, request_block=8)
    here, there = np.array([4_000.0, -6_000.0]), np.array([4_000.0, -6_000.0])
    there[axis] += side * away_m
    asked = replace(said(made, "cav_1", observe(0)), pose=PoseEstimate(np.array([*there, 0.0, 0.0])))
    made.hear("cav_0", observe(0, here, asked))
    assert set(made._asked["cav_0"]) == ({"cav_1"} if counts else set())


def test_under_a_budget_the_thrifty_codec_is_taken() -> None:
    made = uplink({"cav_0": np.eye(16) * 0.9}, "features(number=int8)", thrifty="sparse_features(number=int8)")
    assert said(made, "cav_0", observe(0)).codec == "features"
    select = SELECTIONS.get("score")
    within = WithinBudget(made, 300, lambda agent: select(np.random.default_rng(0)))
    message = within.message("cav_0", observe(0))
    assert message is not None and message.codec == "sparse_features"
    asked_for = uplink({"cav_0": np.eye(16)}, "features(number=int8)")
    with pytest.raises(InvalidValueError, match="not for ShareMaps"):
        WithinBudget(asked_for, 300, lambda agent: select(np.random.default_rng(0)))
