"""Feature flow as a policy: what is sent, and that late messages are moved."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

pytest.importorskip("torch")
from street_scene import FRAME_NS, observe, spec_of
from tiny_networks import learned

import coopsim
from coopsim.comms.envelope import decode_features
from coopsim.errors import InvalidValueError
from coopsim.types import Message, Observation

MOVED = ((14.0, 4.0), (27.0, -6.0), (-16.0, 3.0), (40.0, 12.0))


def make(**settings: Any) -> Any:
    return coopsim.make_policy("ff_tracking", **learned("ff_tracking", **settings))


def said(policy: Any) -> list[Message]:
    """What a mast broadcasts of cars that drive, in two frames."""
    spec, rng = spec_of("rsu_0", "rsu"), np.random.default_rng(0)
    uplink = policy.make_uplink(spec, rng)
    uplink.begin(spec, rng)
    seen = observe(0, pose=(20.0, 0, 0, 0)), observe(FRAME_NS, pose=(20.0, 0, 0, 0), cars=MOVED)
    return [uplink.message("rsu_0", each) for each in seen]


def test_the_second_message_has_derivatives_and_the_same_map_as_without() -> None:
    first, second = (decode_features(each).values for each in said(make()))
    still, second_still = (decode_features(each).values for each in said(make(flow=False)))
    assert len(second) == 2 * len(first) == 2 * len(second_still)
    np.testing.assert_array_equal(first, still)
    np.testing.assert_array_equal(second[: len(first)], second_still)
    assert second[len(first) :].any()


def fused(policy: Any, heard: Message, now: Observation) -> list[np.ndarray]:
    policy.reset({name: spec_of(name, kind) for name, kind in (("cav_0", "cav"), ("rsu_0", "rsu"))})
    policy.track("cav_0", replace(now, inbox=(heard,)))
    found = policy.detections("cav_0")
    return [found.boxes.array, found.score]


def test_derivatives_matter_when_a_message_is_late_and_only_then() -> None:
    policy = make(least_score=0.05)
    _, with_flow = said(policy)
    _, without = said(make(flow=False))
    for delay_ns, alike in ((0, True), (3 * FRAME_NS, False)):
        now = observe(FRAME_NS + delay_ns)
        one, other = (fused(policy, heard, now) for heard in (with_flow, without))
        assert all(np.array_equal(a, b) for a, b in zip(one, other, strict=True)) == alike


def test_what_is_wrong_is_refused() -> None:
    with pytest.raises(InvalidValueError, match="flow must be True or False, got 'yes'"):
        make(flow="yes")
