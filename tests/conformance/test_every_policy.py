"""What every registered policy withstands, alone and among others; nothing raises from inside or leaves a NaN."""

from __future__ import annotations

import struct
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from representatives import all_of

import coopsim
from coopsim.agents.boxes import AB3DMOTTracking
from coopsim.catalog import policies_on_boxes
from coopsim.comms.codecs.codec import codecs_of
from coopsim.comms.envelope import decode_detections
from coopsim.comms.uplinks.share_detections import ShareDetections
from coopsim.comms.uplinks.uplink import UPLINKS
from coopsim.geometry.boxes import Boxes3D
from coopsim.testing import check_policy
from coopsim.tracking.delayed import DELAYED
from coopsim.types import AgentSpec, Detections, Message, Observation, Odometry, PoseEstimate, Tracks

FRAME_NS = 100_000_000
NAMES = (*policies_on_boxes(), "yoloo")
"""Policies that cannot do without sensor data are in `test_every_learned_policy.py`."""

FAMILIES = ("no_fusion", "late_fusion", "coop_fuse", "graph_lap_tsa", "dmstrack", "track_to_track", "yoloo")
"""One policy of each way to associate and of each content of messages; the others are tried by `make check-long`."""
EVERY = pytest.mark.parametrize("name", all_of(NAMES, *FAMILIES))

WAYS = [(name, late) for name in NAMES for late in DELAYED.names()]
WAYS.remove(("track_to_track", "replay"))  # tracks that others report cannot be tracked again
LISTENING = [name for name in NAMES if coopsim.POLICIES.get(name).needs.uplink != "none"]


def families_first(rows: Sequence[Any], name_of: Callable[[Any], str] = lambda row: row[0]) -> list[Any]:
    """Return parameters, of which `make test` takes those of the representatives."""
    return [
        pytest.param(
            *(row if isinstance(row, tuple) else (row,)), marks=() if name_of(row) in FAMILIES else pytest.mark.long
        )
        for row in rows
    ]


EVERY_WAY = pytest.mark.parametrize(("name", "late"), families_first(WAYS))
EVERY_LISTENER = pytest.mark.parametrize("name", families_first(LISTENING, str))
SWITCHED = families_first([(name, late) for name, late in WAYS if name in LISTENING])


def boxes(xy: object, *, score: object = 0.8, label: object = 0) -> Detections:
    where = np.asarray(xy, dtype=float).reshape(-1, 2)
    rows = np.column_stack([where, np.tile([0.8, 4.5, 1.9, 1.6, 0.3], (len(where), 1))])
    full = (np.broadcast_to(value, len(rows)) for value in (score, label))
    return Detections(Boxes3D.from_array(rows), *full)


def message(name: str, found: Detections, captured_ns: int, sender: str = "rsu_0") -> Message:
    """What a sender that has detected this and nothing before broadcasts, for the policy of that name."""
    heard = UPLINKS.get(listens_to(name))().message(sender, observe(captured_ns, found))
    assert heard is not None
    return heard


def listens_to(name: str) -> str:
    """The policy's uplink; detections, for one that must not mind them."""
    uplink = coopsim.POLICIES.get(name).needs.uplink
    return "detections" if uplink == "none" else uplink


def observe(time_ns: int, found: Detections, *inbox: Message) -> Observation:
    return Observation(time_ns, PoseEstimate(np.zeros(4)), Odometry(np.zeros(4)), found, inbox=inbox)


def make(name: str, **settings: object) -> coopsim.Policy:
    if name == "yoloo":
        from tiny_networks import tiny_looks

        settings = {"weights": tiny_looks(), **settings}
    return coopsim.make_policy(name, **settings)


def begin(name: str, **settings: object) -> coopsim.Policy:
    policy = make(name, **settings)
    policy.reset({"cav_0": AgentSpec("cav_0", "cav", 0.1, listens_to(name))})
    return policy


def play(policy: coopsim.Policy, *observations: Observation) -> list[Tracks]:
    reports = [policy.track("cav_0", observation) for observation in observations]
    for tracks in reports:
        tracks.validate()
    return reports


def require_same(one: list[Tracks], other: list[Tracks], atol_m: float = 0.0) -> None:
    """Require the same tracks in every frame, and some in any."""
    assert any(len(tracks) for tracks in one)
    for a, b in zip(one, other, strict=True):
        np.testing.assert_array_equal(a.id, b.id)
        np.testing.assert_allclose(a.boxes.array, b.boxes.array, rtol=0, atol=atol_m)


@EVERY
def test_policy(name: str) -> None:
    check_policy(lambda: make(name), **({"lidar": "VLP-16"} if name == "yoloo" else {}))


class Telepathic(AB3DMOTTracking):
    """A policy that tells each agent what all others detect, without a message."""

    def track_all(self, observations: Mapping[str, Observation]) -> dict[str, Tracks]:
        found = {name: each.detections.transform(each.pose.world_SE3_base) for name, each in observations.items()}
        everything = Detections.concatenate([found[name] for name in sorted(found)])
        return {
            name: self.track(name, replace(each, detections=everything.transform(each.pose.world_SE3_base.inverse())))
            for name, each in observations.items()
        }


class Overhearing(AB3DMOTTracking):
    """A policy that tells each agent how many messages have reached all of them."""

    def track_all(self, observations: Mapping[str, Observation]) -> dict[str, Tracks]:
        heard = sum(len(each.inbox) for each in observations.values())
        alone = {name: self.track(name, each) for name, each in observations.items()}
        return {name: replace(tracks, score=tracks.score / (1 + heard)) for name, tracks in alone.items()}


@pytest.mark.parametrize("cheat", [Telepathic, Overhearing])
def test_a_policy_that_passes_knowledge_beside_the_channel_is_refused(cheat: type[coopsim.Policy]) -> None:
    message = "without the others' observations, as messages are all it gets: the tracks of "
    with pytest.raises(AssertionError, match=message):
        check_policy(cheat if cheat is Telepathic else cheat())


@EVERY
def test_empty_frames_and_nobody_else(name: str) -> None:
    seen = [boxes([[5, 0]]), boxes([]), boxes([]), boxes([[5, 0]]), boxes([])]
    reports = play(begin(name), *(observe(k * FRAME_NS, found) for k, found in enumerate(seen)))
    assert len(reports[0]) == 1
    assert all(len(tracks) == 0 for tracks in play(begin(name), *(observe(k, boxes([])) for k in range(3))))


@EVERY_WAY
def test_the_same_message_twice_changes_nothing(name: str, late: str) -> None:
    def reports(copies: int) -> list[Tracks]:
        frames = []
        for k in range(9):
            heard = message(name, boxes([[20 + k, 0], [-30, 5]]), k * FRAME_NS)
            frames.append(observe(k * FRAME_NS, boxes([[20 + k, 0]]), *[heard] * copies))
        return play(begin(name, delayed=late), *frames)

    require_same(reports(1), reports(2))


@EVERY
def test_a_message_that_comes_again_and_again_is_no_second_object(name: str) -> None:
    heard = message(name, boxes([[20, 0]]), 0)
    frames = [observe(k * FRAME_NS, boxes([[20, 0]]), *[heard] * (k % 3)) for k in range(9)]
    # The graph keeps both of two agents' boxes, as published; TSA's second stage feeds a track that the first missed.
    assert len(play(begin(name), *frames)[-1]) == (2 if name == "graph_lap_tsa" else 1)


@EVERY_WAY
def test_a_message_older_than_any_track(name: str, late: str) -> None:
    policy = begin(name, delayed=late)
    play(policy, *(observe(k * FRAME_NS, boxes([[20 + k, 0]])) for k in range(30, 36)))
    ancient = message(name, boxes([[-40, 9]]), 0)
    reports = play(policy, observe(36 * FRAME_NS, boxes([[56, 0]]), ancient))
    assert np.isclose(reports[-1].boxes.center[:, 0], 56, atol=0.5).any()


@EVERY
def test_what_is_not_finite_is_left_out(name: str) -> None:
    rows = np.tile([10.0, 0, 0.8, 4.5, 1.9, 1.6, 0.0], (5, 1))
    rows[1, 0], rows[2, 6], rows[3, 3] = np.nan, np.inf, -1.0
    bad = Detections(Boxes3D.from_array(rows), [0.9, 0.9, 0.9, 0.9, np.nan], np.zeros(5, dtype=int))
    good = boxes([[10, 0]], score=0.9)
    expected = play(begin(name), *(observe(k * FRAME_NS, good) for k in range(6)))
    frames = [observe(k * FRAME_NS, bad, message(name, bad[1:4], k * FRAME_NS)) for k in range(6)]
    assert [len(tracks) for tracks in play(begin(name), *frames)] == [len(tracks) for tracks in expected]


def broken(name: str, good: Message) -> list[Message]:
    """Messages that nobody can read, by three senders."""
    beyond = bytearray(good.payload)
    first = 2 if listens_to(name) == "detections" else 6  # where the box of the first object begins
    struct.pack_into("<f", beyond, first, np.inf)
    payloads = [b"", b"\x07nonsense", good.payload[:-1], good.payload + b"\0", bytes(beyond), bytes(100_000)]
    return [
        *(replace(good, sender="rsu_1", payload=payload) for payload in payloads),
        *(replace(good, sender="cav_1", codec=codec) for codec in ("points", "nobody's", "")),
        replace(good, sender="cav_2", payload=b"\xff\xff"),
    ]


@EVERY
def test_messages_that_cannot_be_read_are_left_out_and_counted(name: str) -> None:
    seen = [boxes([[20 + k, 0]]) for k in range(6)]
    heard = [message(name, boxes([[20 + k, 0], [-30, 5]]), k * FRAME_NS) for k in range(6)]
    expected, policy = begin(name), begin(name)
    good = play(expected, *(observe(k * FRAME_NS, seen[k], heard[k]) for k in range(6)))
    disturbed = (observe(k * FRAME_NS, seen[k], *broken(name, heard[k]), heard[k]) for k in range(6))
    for one, other in zip(good, play(policy, *disturbed), strict=True):
        np.testing.assert_array_equal(one.id, other.id)
        np.testing.assert_array_equal(one.boxes.array, other.boxes.array)
    assert not expected.rejected
    listens = name in LISTENING
    counted = {("cav_0", "rsu_1"): 36, ("cav_0", "cav_1"): 18, ("cav_0", "cav_2"): 6}
    assert policy.rejected == (counted if listens else {})
    policy.reset(policy.specs)
    assert not policy.rejected


@EVERY_LISTENER
def test_numbers_at_float32s_end_do_no_harm(name: str) -> None:
    """What a message can say, and no detector would."""
    rows = np.tile([10.0, 0, 0.8, 4.5, 1.9, 1.6, 0.0], (8, 1))
    most = float(np.finfo(np.float32).max)
    rows[[0, 1, 2, 3, 4], [0, 1, 3, 5, 6]] = most
    rows[5, 3:6], rows[6, :3], rows[7, 3] = most, -most, 1e-40
    wild = Detections(Boxes3D.from_array(rows), np.full(8, most), np.zeros(8, dtype=int))
    found = boxes([[10, 0]])
    frames = [observe(k * FRAME_NS, found, message(name, wild, k * FRAME_NS)) for k in range(4)]
    play(begin(name), *frames)


@pytest.mark.parametrize("name", families_first([name for name in LISTENING if listens_to(name) == "detections"], str))
@pytest.mark.parametrize("codec", codecs_of("detections"))
def test_detections_are_understood_from_every_codec(name: str, codec: str) -> None:
    def reports(by: str) -> list[Tracks]:
        share, frames = ShareDetections(by), []
        for k in range(6):
            heard = share.message("rsu_0", observe(k * FRAME_NS, boxes([[20 + k, 3], [-30, 5]])))
            assert heard is not None
            frames.append(observe(k * FRAME_NS, boxes([]), heard))
        return play(begin(name), *frames)

    require_same(reports("detections"), reports(codec), atol_m=0.1)


@EVERY
def test_a_class_never_seen_before(name: str) -> None:
    policy = begin(name)
    frames = [observe(k * FRAME_NS, boxes([[10, 0]])) for k in range(4)]
    frames += [observe(k * FRAME_NS, boxes([[10, 0], [30, 0]], label=[0, 6])) for k in range(4, 10)]
    assert set(play(policy, *frames)[-1].label.tolist()) == {0, 6}


@EVERY
@pytest.mark.parametrize("label", [-1, 9, 999])
def test_a_class_that_no_report_can_name_is_left_out(name: str, label: int) -> None:
    found = boxes([[10, 0], [30, 0]], label=[0, label])
    reports = play(begin(name), *(observe(k * FRAME_NS, found) for k in range(5)))
    assert all(tracks.label.tolist() == [0] for tracks in reports)


@pytest.mark.parametrize("align", [False, True])
@EVERY_LISTENER
@pytest.mark.parametrize("xyz_yaw", [[1e300, 0, 0, 0], [0, -1e160, 0, 0], [0, 0, 1e300, 0], [5e4, 0, 0, 0]])
def test_whoever_says_he_is_beyond_all_radio_is_left_out(name: str, xyz_yaw: list[float], *, align: bool) -> None:
    seen = boxes([[10, 0], [20, 5], [35, -5]])
    absurd = PoseEstimate(np.array(xyz_yaw, dtype=float))
    frames, disturbed = [], []
    for k in range(5):
        heard = replace(message(name, seen, k * FRAME_NS), pose=absurd)
        frames.append(observe(k * FRAME_NS, seen))
        disturbed.append(observe(k * FRAME_NS, seen, heard))
    alone, among = (play(begin(name, align=align), *each) for each in (frames, disturbed))
    require_same(alone, among)


@EVERY
def test_thousands_of_boxes_in_one_frame(name: str) -> None:
    rng = np.random.default_rng(0)
    crowd = boxes(rng.uniform(-900, 900, (1500, 2)), score=rng.uniform(0.3, 0.9, 1500))
    play(begin(name), *(observe(k * FRAME_NS, crowd, message(name, crowd, k * FRAME_NS)) for k in range(2)))


@EVERY
def test_ids_are_unique_and_results_repeat(name: str) -> None:
    def once() -> list[Tracks]:
        rng = np.random.default_rng(1)
        frames = []
        for k in range(25):
            mine, theirs = (boxes(rng.uniform(-40, 40, (rng.integers(0, 9), 2)), score=0.7) for _ in range(2))
            heard = message(name, theirs, max(k - int(rng.integers(0, 4)), 0) * FRAME_NS)
            frames.append(observe(k * FRAME_NS, mine, heard))
        return play(begin(name), *frames)

    require_same(once(), once())


def looking(found: Detections, kind: str, rng: np.random.Generator) -> Detections:
    """The same detections with embeddings, good ones or rubbish."""
    shape = (len(found), 8 if kind == "wide" else 4)
    values = {
        "good": np.ones(shape) + rng.normal(0, 0.2, shape),
        "wide": rng.normal(size=shape),
        "huge": 1e300 * rng.normal(size=shape),
        "nan": np.full(shape, np.nan),
        "infinite": np.full(shape, np.inf),
        "zero": np.zeros(shape),
        "empty": np.zeros((len(found), 0)),
    }
    return replace(found, embedding=values[kind])


def wandering(name: str, kinds: Sequence[str | None]) -> list[Observation]:
    """Cars that come and go, seen by two agents; embeddings of the own and of the heard detections by frame."""
    rng, looks = np.random.default_rng(2), np.random.default_rng(3)
    frames = []
    for k in range(16):
        where = np.column_stack([10.0 * np.arange(5) + k, np.zeros(5)])
        groups = []
        for kind in (kinds[k % len(kinds)], kinds[(k + 1) % len(kinds)]):
            seen = boxes(where[rng.random(5) < 0.7] + rng.normal(0, 0.1, 2))
            groups.append(seen if kind is None else looking(seen, kind, looks))
        frames.append(observe(k * FRAME_NS, groups[0], message(name, groups[1], k * FRAME_NS)))
    return frames


@EVERY_WAY
def test_embeddings_of_any_kind(name: str, late: str) -> None:
    for kinds in (["good"], ["good", "wide"], ["good", "nan", None, "huge", "zero", "wide", "infinite", "empty"]):
        reports = play(begin(name, delayed=late), *wandering(name, kinds))
        assert any(len(tracks) for tracks in reports[3:])


@EVERY
@pytest.mark.parametrize("kind", ["nan", "infinite", "zero", "empty"])
def test_what_is_no_embedding_changes_nothing(name: str, kind: str) -> None:
    expected, got = (play(begin(name), *wandering(name, [each])) for each in (None, kind))
    require_same(expected, got)


@EVERY
def test_a_typo_in_a_setting_is_answered_with_what_is_accepted(name: str) -> None:
    with pytest.raises(coopsim.errors.CoopsimError, match=r"hits|least_chance"):
        coopsim.make_policy(name, hitz=3)
    with pytest.raises(coopsim.errors.CoopsimError, match="Did you mean 'predict'"):
        make(name, delayed="predikt")


@pytest.mark.parametrize(("name", "late"), SWITCHED)
def test_with_everything_switched_on_bad_input_does_no_harm(name: str, late: str) -> None:
    """Nobody else, empty frames, one message twice, one from the future, and numbers that are none."""
    rows = np.tile([10.0, 0, 0.8, 4.5, 1.9, 1.6, 0.0], (4, 1))
    rows[1, 0], rows[2, 6], rows[3, 3] = np.nan, np.inf, -1.0
    bad = Detections(Boxes3D.from_array(rows), np.full(4, 0.9), np.zeros(4, dtype=int))
    good, policy = boxes([[10, 0], [20, 5], [35, -5]]), begin(name, delayed=late, align=True)
    frames = [observe(0, good), observe(FRAME_NS, boxes([]))]
    for k, found in enumerate([good, bad, boxes([]), good, good, good], start=2):
        heard = message(name, bad if k == 3 else found, k * FRAME_NS)
        ahead = message(name, found, (k + 9) * FRAME_NS, "cav_9")
        frames.append(observe(k * FRAME_NS, found, heard, heard, *[ahead] * (k == 6)))
    reports = play(policy, *frames, observe(8 * FRAME_NS, bad))
    assert np.isclose(reports[7].boxes.center[:, 0], 35, atol=0.5).any()


@EVERY_LISTENER
def test_a_sender_with_a_wrong_pose_is_put_right_where_the_policy_aligns(name: str) -> None:
    """A car that only the sender sees, told by a sender who is a metre off: it is where the shared cars say."""
    shared, hidden = [[10, 0], [20, 5], [35, -5], [28, 14]], [[45.0, 8]]
    off = {}
    for align in (False, True):
        policy, frames = begin(name, align=align), []
        for k in range(8):
            heard = message(name, boxes([*shared, *hidden]), k * FRAME_NS)
            wrong = replace(heard, pose=PoseEstimate(np.array([0.7, -0.7, 0.0, 0.0])))
            frames.append(observe(k * FRAME_NS, boxes(shared), wrong))
        center = play(policy, *frames)[-1].boxes.center[:, :2]
        off[align] = np.hypot(*(center - hidden[0]).T).min()
    assert off[False] > 0.5 and off[True] < 0.15


class Copy(coopsim.Policy):
    """A sound policy: reports what it detects, numbered as it was first seen."""

    needs = coopsim.Needs(uplink="none")

    def begin(self, spec: AgentSpec, rng: np.random.Generator) -> None:
        self.count = 0

    def track(self, agent: str, observation: Observation) -> Tracks:
        found = observation.detections
        self.count += len(found)
        still = np.zeros((len(found), 2))
        return Tracks(np.arange(len(found)), found.boxes, still, found.score, found.label)


class Reader(Copy):
    """Sound, too: adds what others report."""

    needs = coopsim.Needs()

    def track(self, agent: str, observation: Observation) -> Tracks:
        heard = self.read(agent, observation.inbox, decode_detections)
        found = Detections.concatenate([observation.detections, *(each for _, each in heard)])
        return super().track(agent, replace(observation, detections=found))


class ReadsOnlyWhatIsWhole(Reader):
    def track(self, agent: str, observation: Observation) -> Tracks:
        for message in observation.inbox:
            decode_detections(message)
        return super().track(agent, observation)


class NotFinite(Copy):
    def track(self, agent: str, observation: Observation) -> Tracks:
        tracks = super().track(agent, observation)
        return replace(tracks, velocity=np.full((len(tracks), 2), np.nan))


class SameIds(Copy):
    def track(self, agent: str, observation: Observation) -> Tracks:
        tracks = super().track(agent, observation)
        return replace(tracks, id=np.zeros(len(tracks), dtype=int))


class NoTracks(Copy):
    def track(self, agent: str, observation: Observation) -> Any:
        return observation.detections


class Remembering(Copy):
    """Does not forget the last episode."""

    def begin(self, spec: AgentSpec, rng: np.random.Generator) -> None:
        if not hasattr(self, "count"):
            super().begin(spec, rng)

    def track(self, agent: str, observation: Observation) -> Tracks:
        tracks = super().track(agent, observation)
        return replace(tracks, id=tracks.id + self.count)


class Dice(Copy):
    """Draws from no stream of its own."""

    def track(self, agent: str, observation: Observation) -> Tracks:
        tracks = super().track(agent, observation)
        return replace(tracks, score=np.random.default_rng().random(len(tracks)))


class InTurn(Copy):
    """One count for all agents, so that it matters who is asked first."""

    def track(self, agent: str, observation: Observation) -> Tracks:
        tracks = super().track(agent, observation)
        return replace(tracks, id=tracks.id + self.count)


class Meddling(Copy):
    def act(self, observations: Mapping[str, Mapping[str, Any]]) -> dict[str, dict[str, Any]]:
        actions = super().act(observations)
        for packed in observations.values():
            packed["detections"]["box"][...] += 1
        return actions


class Alone(Reader):
    """Takes it for granted that somebody sends."""

    def track(self, agent: str, observation: Observation) -> Tracks:
        assert observation.inbox
        return super().track(agent, observation)


def test_sound_policies_pass() -> None:
    for policy in (Copy, Copy(), Reader, "late_fusion(delayed=replay)"):
        check_policy(policy)
    check_policy(Copy, "highway", lidar=None)
    with pytest.raises(coopsim.errors.UnknownNameError, match="Did you mean 'late_fusion'"):
        check_policy("late_fusoin")


@pytest.mark.parametrize(
    ("policy", "match"),
    [
        (ReadsOnlyWhatIsWhole, "ReadsOnlyWhatIsWhole must report tracks, got CodecError"),
        (NotFinite, "NotFinite must report valid tracks: .*velocity must be finite"),
        (SameIds, "SameIds must report valid tracks: .*ids must be unique"),
        (NoTracks, "NoTracks must report tracks, got InvalidActionError"),
        (Remembering, "Remembering must report the same again after reset"),
        (Dice, "Dice must report the same again after reset"),
        (InTurn, "InTurn must not depend on the order in which agents are asked"),
        (Meddling, "Meddling must leave its observations as they are|read-only"),
        (Alone, "Alone must report tracks, got AssertionError"),
    ],
)
def test_what_is_wrong_is_found(policy: type[coopsim.Policy], match: str) -> None:
    with pytest.raises(AssertionError, match=match):
        check_policy(policy)


@pytest.mark.parametrize("name", coopsim.POLICIES.names())
def test_it_says_which_method_of_a_paper_it_is(name: str) -> None:
    assert coopsim.POLICIES.get(name).method or coopsim.make_policy(name).method


@pytest.mark.parametrize(("name", "made"), [("concat", "early"), ("hungarian", "hungarian")])
def test_the_baselines_of_feature_flow_have_their_names(name: str, made: str) -> None:
    """Points of all in one network, and boxes that are matched and fused; both tracked by AB3DMOT."""
    baseline = coopsim.POLICIES.get(name)
    assert baseline is coopsim.POLICIES.get(made)
    assert baseline.needs.uplink == {"early": "points", "hungarian": "detections"}[made]
    assert issubclass(baseline, AB3DMOTTracking) or baseline.tracker == "ab3dmot"  # type: ignore[attr-defined]


def test_a_variant_says_what_it_leaves_out() -> None:
    geometry, fixed, blind = (
        coopsim.make_policy(name).method for name in ("yoloo_geometry", "sequential_kf", "dino_codt_tracking")
    )
    assert coopsim.make_policy("yoloo", appearance=False).method == geometry
    assert coopsim.make_policy("dmstrack", covariance=None).method == fixed
    assert "without Re-ID" in blind
