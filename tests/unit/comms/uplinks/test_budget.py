"""What is said first when not all fits, and that a message never grows beyond its budget."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from small_env import SMALL

import coopsim
from coopsim.cli.entry import main
from coopsim.comms.decode_once import DecodeOnce
from coopsim.comms.envelope import decode_detections, encode_message
from coopsim.comms.uplinks.budget import SELECTIONS, Selection, WithinBudget, make_selection
from coopsim.comms.uplinks.share_detections import ShareDetections
from coopsim.comms.uplinks.share_tracks import ShareTracks
from coopsim.comms.uplinks.uplink import Silence
from coopsim.errors import CoopsimError, InvalidValueError, UnknownNameError
from coopsim.geometry.boxes import Boxes3D
from coopsim.types import Detections, Message, Observation, Odometry, PoseEstimate

RULES = sorted(set(SELECTIONS.names()) - {"learned"})
"""Rankings without parameters; the learned one has tests of its own."""


def boxes(x: object, score: object) -> Detections:
    where = np.atleast_1d(np.asarray(x, dtype=float))
    rows = np.column_stack([where, np.tile([0.0, 0.8, 4.5, 1.9, 1.6, 0.0], (len(where), 1))])
    full = np.broadcast_to(np.asarray(score, dtype=float), len(where))
    return Detections(Boxes3D.from_array(rows), full, np.zeros(len(where), dtype=int))


def observe(found: Detections, *inbox: Message, x: float = 0.0, time_ns: int = 0) -> Observation:
    pose = PoseEstimate(np.array([x, 0.0, 0.0, 0.0]))
    return Observation(time_ns, pose, Odometry(np.zeros(4)), found, inbox=inbox)


def within(budget_bytes: int, selection: str = "need") -> WithinBudget:
    return WithinBudget(
        ShareDetections(), budget_bytes, lambda agent: make_selection(selection, np.random.default_rng(0))
    )


def said(uplink: WithinBudget, observation: Observation, sender: str = "cav_0") -> list[float]:
    """Where along x the objects of a message are, in the world frame, in order."""
    message = uplink.message(sender, observation)
    assert message is not None
    found = decode_detections(message).boxes.transform(message.pose.world_SE3_base)
    return sorted(found.center[:, 0].round(1).tolist())


@settings(max_examples=30)
@given(count=st.integers(0, 40), budget_bytes=st.integers(1, 2000), selection=st.sampled_from(RULES))
def test_as_many_as_fit_and_not_one_more(count: int, budget_bytes: int, selection: str) -> None:
    observation = observe(boxes(np.arange(count) * 9.0, 0.5))
    message = within(budget_bytes, selection).message("cav_0", observation)
    assert message is not None
    sent, size = len(decode_detections(message)), len(encode_message(message))
    assert size <= budget_bytes or sent == 0
    assert sent == count or size + 33 > budget_bytes


def test_what_fits_is_sent_as_it_is() -> None:
    observation = observe(boxes([30, 20, 10], [0.2, 0.9, 0.4]))
    whole, same = ShareDetections().message("cav_0", observation), within(1000).message("cav_0", observation)
    assert whole is not None and same is not None and whole.payload == same.payload


def test_by_score_the_surest_are_sent() -> None:
    assert said(within(150, "score"), observe(boxes([10, 20, 30, 40], [0.2, 0.9, 0.4, 0.8]))) == [20.0, 40.0]


@pytest.mark.parametrize(("away_m", "unseen"), [(0.0, 0.0), (20.0, 0.22120), (40.0, 0.63212), (80.0, 0.98168)])
def test_by_need_objects_count_by_how_likely_nobody_else_has_them_in_sight(away_m: float, unseen: float) -> None:
    """By the distance to the other: 1 - exp(-(d / 40 m)^2)."""
    need, found = SELECTIONS.get("need")(np.random.default_rng(0)), boxes([100.0], [0.5])
    other = ShareDetections().message("cav_1", observe(Detections.empty(), x=100.0 - away_m))
    assert other is not None
    need.hear(observe(found, other), DecodeOnce())
    assert need.utility("cav_0", observe(found)) == pytest.approx([0.5 * unseen], abs=1e-5)


def test_by_need_an_object_beside_one_of_two_others_counts_for_the_other_one() -> None:
    need, found = SELECTIONS.get("need")(np.random.default_rng(0)), boxes([100.0], [0.5])
    near, far = (
        ShareDetections().message(name, observe(Detections.empty(), x=x)) for name, x in (("a", 100), ("b", 900))
    )
    assert near is not None and far is not None
    need.hear(observe(found, near, far), DecodeOnce())
    assert need.utility("cav_0", observe(found)) == pytest.approx([0.25], abs=1e-5)


def test_by_need_what_is_close_to_another_agent_is_left_to_it() -> None:
    uplink = within(150)
    other = ShareDetections().message("cav_1", observe(Detections.empty(), x=60.0))
    assert other is not None
    found = boxes([10, 20, 50, 55], [0.5, 0.5, 0.6, 0.6])
    assert said(uplink, observe(found)) == [50.0, 55.0]
    uplink = within(150)
    uplink.hear("cav_0", observe(found, other))
    assert said(uplink, observe(found)) == [10.0, 20.0]


def test_of_two_who_see_an_object_the_surer_one_goes_on_reporting_it() -> None:
    """The senders stand at the same place, so neither's distance decides."""
    mine, theirs = boxes([90, 99], [0.5, 0.5]), boxes([90, 81], [0.6, 0.5])
    uplinks, inbox = {"cav_0": within(110), "cav_1": within(110)}, dict.fromkeys(("cav_0", "cav_1"), ())
    for k in range(6):
        seen = {"cav_0": observe(mine, time_ns=k), "cav_1": observe(theirs, time_ns=k)}
        sent = {name: uplinks[name].message(name, seen[name]) for name in uplinks}
        inbox = {"cav_0": (sent["cav_1"],), "cav_1": (sent["cav_0"],)}
        for name, uplink in uplinks.items():
            uplink.hear(name, replace(seen[name], inbox=inbox[name]))
    assert said(uplinks["cav_0"], observe(mine)) == [99.0]
    assert said(uplinks["cav_1"], observe(theirs), "cav_1") == [90.0]


@pytest.mark.parametrize(("new_score", "sent_m"), [(0.58, 10.0), (0.62, 300.0)])
def test_an_object_of_the_last_message_counts_three_times(new_score: float, sent_m: float) -> None:
    uplink = within(110)
    assert said(uplink, observe(boxes([10], 0.2))) == [10.0]
    assert said(uplink, observe(boxes([10, 300], [0.2, new_score]), time_ns=1)) == [sent_m]


def test_what_was_said_long_ago_or_cannot_be_read_binds_nobody() -> None:
    uplink, found = within(110), boxes([10, 20], [0.5, 0.4])
    theirs = ShareDetections().message("cav_1", observe(boxes([-390], 0.9), x=400.0))
    assert theirs is not None
    uplink.hear("cav_0", observe(found, replace(theirs, payload=b"\x07nonsense")))
    assert said(uplink, observe(found)) == [10.0]
    uplink = within(110)
    uplink.hear("cav_0", observe(found, theirs))
    assert said(uplink, observe(found)) == [20.0]
    uplink = within(110)
    uplink.hear("cav_0", observe(found, theirs))
    uplink.hear("cav_0", observe(found, time_ns=2_000_000_000))
    assert said(uplink, observe(found)) == [10.0]


def test_what_is_not_accepted_is_named() -> None:
    def selection(agent: str) -> Selection:
        return SELECTIONS.get("score")(np.random.default_rng(0))

    with pytest.raises(InvalidValueError, match=r"budget_bytes is for uplinks.*not for ShareTracks"):
        WithinBudget(ShareTracks(), 100, selection)
    with pytest.raises(InvalidValueError, match="budget_bytes must be an integer >= 1"):
        coopsim.parallel_env("crossing", budget_bytes=0)
    with pytest.raises(UnknownNameError, match="score"):
        coopsim.parallel_env("crossing", budget_bytes=100, selection="scores")
    with pytest.raises(InvalidValueError, match="not for ShareTracks"):
        coopsim.parallel_env("crossing", budget_bytes=100, uplink="tracks")
    assert WithinBudget(Silence(), 100, selection).message("cav_0", observe(boxes([1], 1))) is None


@pytest.mark.parametrize("selection", RULES)
def test_in_an_episode_no_agent_sends_more_than_its_budget(selection: str) -> None:
    first, again = (
        coopsim.evaluate("late_fusion", **SMALL, budget_bytes=150, selection=selection, seed=1).score for _ in "ab"
    )
    assert 0 < first["bytes_per_s"] <= 1500
    assert first.values == again.values


@pytest.mark.parametrize(
    ("selection", "match"),
    [
        ("learned(wights=x)", "unknown parameter 'wights' of selection 'learned'"),
        ("learned(weights=/etc/passwd)", "unknown weights '/etc/passwd'"),
        ("learned(weights={folder}/random.safetensors)", "random.safetensors"),
        ("nobody", "unknown selection 'nobody'"),
    ],
)
def test_a_wrong_selection_is_refused_before_the_first_episode(
    selection: str, match: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    pytest.importorskip("torch")
    (tmp_path / "random.safetensors").write_bytes(bytes(range(256)))
    selection = selection.format(folder=tmp_path)
    with pytest.raises(CoopsimError, match=match):
        coopsim.parallel_env("crossing", lidar=None, budget_bytes=200, selection=selection)
    out, words = tmp_path / "out", ("--option", f"selection={selection}", "--option", "budget_bytes=200")
    assert main(["bench", "--policies", "late_fusion", "--seeds", "0", "--frames", "2", "--out", str(out), *words]) == 2
    assert capsys.readouterr().err.count("\n") == 1 and not out.exists()
