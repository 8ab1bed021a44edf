"""YOLOO as a policy: who embeds, what is sent, and what happens where there are no looks."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

pytest.importorskip("torch")

from street_scene import CARS, FRAME_NS, observe, spec_of
from tiny_networks import learned, tiny_looks

import coopsim
from coopsim.agents.appearance import Yoloo
from coopsim.comms.envelope import decode_detections
from coopsim.detection.embedder import make_embedder
from coopsim.errors import InvalidValueError, UnknownNameError
from coopsim.geometry.boxes import Boxes3D
from coopsim.types import Detections, Message, Observation

WITH_LOOKS, WITHOUT = "pairs compared by looks and geometry", "pairs compared by geometry alone"
ELSEWHERE = (30.0, 2.0, 0.0, 0.0)
SMALL: dict[str, Any] = {"vehicles": 12, "max_cycles": 8, "lidar_columns": 512}


def make(**settings: Any) -> Yoloo:
    policy = coopsim.make_policy("yoloo", **({"weights": tiny_looks()} | settings))
    assert isinstance(policy, Yoloo)
    return policy


def begin(policy: Yoloo, *agents: str) -> Yoloo:
    policy.reset({name: spec_of(name, uplink="detections") for name in agents or ("cav_0", "cav_1")})
    return policy


def seen(time_ns: int, *inbox: Message, pose: Any = (0, 0, 0, 0), embedding: Any = None) -> Observation:
    """What an agent sees and detects of the street's cars."""
    rows = np.array([[x - pose[0], y - pose[1], 0.9, 4.5, 1.9, 1.6, 0.0] for x, y in CARS])
    boxes = Detections(Boxes3D.from_array(rows), np.full(4, 0.9), np.zeros(4, int), None, embedding)
    return replace(observe(time_ns, *inbox, pose=pose), detections=boxes)


def said(policy: Yoloo, time_ns: int, **settings: Any) -> Message:
    spec = replace(spec_of("cav_1", uplink="detections"), **settings)
    uplink = policy.make_uplink(spec, np.random.default_rng(0))
    uplink.begin(spec, np.random.default_rng(0))
    message = uplink.message("cav_1", seen(time_ns, pose=ELSEWHERE))
    assert message is not None
    return message


def play(policy: Yoloo, *frames: Observation) -> list[list[int]]:
    return [sorted(policy.track("cav_0", each).id.tolist()) for each in frames]


def test_agents_embed_what_they_detect_and_send_the_looks_along() -> None:
    policy = begin(make())
    message = said(policy, 0)
    sent, plain = decode_detections(message), decode_detections(said(begin(make(appearance=False)), 0))
    assert sent.embedding is not None and np.linalg.norm(sent.embedding, axis=1) == pytest.approx(np.ones(4), abs=1e-3)
    assert plain.embedding is None
    more = len(message.payload) - len(said(begin(make(appearance=False)), 0).payload)
    assert more == 2 + 4 * 6 * 2  # the width, and six float16 an object
    play(policy, seen(0, message), seen(FRAME_NS, said(policy, FRAME_NS)))
    assert policy.counts == {WITH_LOOKS: 4, WITHOUT: 0}


def test_uplink_and_policy_embed_once(monkeypatch: pytest.MonkeyPatch) -> None:
    calls = 0
    policy = begin(make())
    assert policy._embed is not None
    embed = policy._embed._embedder.embed

    def counting(*given: Any) -> Any:
        nonlocal calls
        calls += 1
        return embed(*given)

    monkeypatch.setattr(policy._embed._embedder, "embed", counting)
    found = coopsim.evaluate(policy, **SMALL)
    assert calls == (found.frames + 1) * len(found.score.agents)
    assert found.counts[WITH_LOOKS] > 0


def test_looks_that_the_environment_gives_are_taken() -> None:
    policy, looks = begin(make()), np.eye(4)
    play(policy, seen(0, embedding=looks), seen(FRAME_NS, embedding=looks))
    assert policy.counts == {WITH_LOOKS: 4, WITHOUT: 0} and policy._embed is not None and not policy._embed._latest


@pytest.mark.parametrize("case", ["no points", "other length", "codec without looks"])
def test_geometry_stands_in_and_it_is_counted(case: str) -> None:
    policy, plain = begin(make()), begin(make(appearance=False))
    reports = []
    for each in (policy, plain):
        frames = []
        for k in range(3):
            if case == "no points":
                frame = replace(seen(k * FRAME_NS), sweeps={})
            elif case == "other length":
                frame = seen(k * FRAME_NS, embedding=np.eye(4)[:, : 3 + k % 2])
            else:
                frame = replace(
                    seen(k * FRAME_NS, said(each, k * FRAME_NS, codec="compact")), detections=Detections.empty()
                )
            frames.append(frame)
        reports.append(play(each, *frames))
    assert reports[0] == reports[1] and len(reports[0][-1]) == 4
    assert policy.counts[WITHOUT] > 0 and plain.counts == {}


def test_without_appearance_it_is_the_geometric_half() -> None:
    scores = [
        coopsim.evaluate(each, **SMALL, seed=3).score.values
        for each in (make(appearance=False), coopsim.make_policy("yoloo_geometry"))
    ]
    assert scores[0] == pytest.approx(scores[1], nan_ok=True)


def test_agents_without_lidars_take_part() -> None:
    policy = make()
    found = coopsim.evaluate(policy, **SMALL, lidar_agents=["cav"])
    assert found.counts[WITHOUT] > 0 and found.counts[WITH_LOOKS] > 0
    assert coopsim.evaluate(policy, vehicles=12, max_cycles=4, lidar=None).counts[WITH_LOOKS] == 0


def test_as_a_tracker_of_another_policy_it_counts_there() -> None:
    policy = coopsim.make_policy("early", **learned("early"), tracker=f"yoloo(weights='{tiny_looks()}')")
    policy.reset({"cav_0": spec_of("cav_0", uplink="points")})
    for k in range(3):
        policy.track("cav_0", observe(k * FRAME_NS))
    assert policy.counts[WITHOUT] > 0


def test_boxes_that_are_not_finite_or_hold_few_points_have_no_looks() -> None:
    embedder = make_embedder(f"point_identity(weights='{tiny_looks()}')")
    frame = seen(0)
    rows = frame.detections.boxes.array.copy()
    rows[0, 0], rows[1, 6], rows[2, 0] = np.nan, np.inf, 500.0
    found = replace(frame.detections, boxes=Boxes3D.from_array(rows))
    got = embedder.apply(found, frame.view(spec_of("cav_0"))).embedding
    assert got is not None and np.linalg.norm(got, axis=1) == pytest.approx([0, 0, 0, 1])


@pytest.mark.parametrize(
    ("settings", "error", "match"),
    [
        ({"appearance": 1}, InvalidValueError, "appearance must be True or False"),
        ({"weights": "pillars"}, InvalidValueError, "must be weights of the kind 'point_identity'"),
        ({"weights": "point_idenity"}, UnknownNameError, "point_idenity"),
        ({"weights": 3}, InvalidValueError, "weights must be the name or path"),
    ],
)
def test_wrong_settings_are_refused(settings: dict[str, Any], error: type[Exception], match: str) -> None:
    with pytest.raises(error, match=match):
        make(**settings)
