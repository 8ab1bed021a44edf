"""What every policy with a network withstands; the networks are tiny and random, what is around them is real."""

from __future__ import annotations

import gc
import struct
import weakref
from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

pytest.importorskip("torch")

from representatives import all_of
from street_scene import CARS, FRAME_NS, observe, spec_of, sweep_from
from tiny_networks import FUSIONS, QUERIES, learned, tiny_detector

import coopsim
from coopsim.agents.perceiving_policy import PerceivingPolicy
from coopsim.catalog import policies_on_boxes
from coopsim.comms.codecs.query_codec import QueriesCodec
from coopsim.comms.envelope import decode_features, decode_queries
from coopsim.comms.uplinks.uplink import Uplink
from coopsim.episode import run_episode
from coopsim.errors import CoopsimError, InvalidValueError, PolicyMismatchError, UnknownNameError
from coopsim.geometry.boxes import Boxes3D
from coopsim.provided import listening_env
from coopsim.testing import check_policy, check_uplink
from coopsim.types import BevGrid, Detections, FeatureMap, Message, Observation, Odometry, PoseEstimate, Sweep, Tracks

NAMES = sorted({*coopsim.POLICIES.names()} - {*policies_on_boxes(), "truth", "yoloo"})
FAMILIES = ("cooptrack", "dino_codt", "early", "ff_tracking", "vic_integrated", "where2comm")
"""One policy of each kind of message and of tracking. The other maps differ by their fusion alone."""
EVERY = pytest.mark.parametrize("name", all_of(NAMES, *FAMILIES))
OF_EACH_MESSAGE = pytest.mark.parametrize("name", all_of(NAMES, "cooptrack", "dino_codt", "early", "where2comm"))
"""For what takes whole episodes, one policy of each kind of message."""
BY_EPISODES = pytest.mark.parametrize("name", all_of(NAMES, "cooptrack", "where2comm"))
"""For what takes several, of which the loop of episodes does most: one that tracks queries, and one with maps."""
ALIGNED_IN_BOTH = pytest.mark.parametrize(
    ("align", "arithmetic"),
    [
        (False, "float32"),
        (True, "bfloat16"),
        pytest.param(False, "bfloat16", marks=pytest.mark.long),
        pytest.param(True, "float32", marks=pytest.mark.long),
    ],
    indirect=["arithmetic"],
)
IN_BOTH_IF_LONG = pytest.mark.parametrize("arithmetic", all_of(["float32", "bfloat16"], "float32"), indirect=True)
EVERY_FUSION = pytest.mark.parametrize("name", all_of(FUSIONS, "ff_tracking", "where2comm"))
EVERY_QUERY = pytest.mark.parametrize("name", all_of(QUERIES, "cooptrack"))
ELSEWHERE, HIDDEN = (30.0, 2.0, 0.0, 1.0), (20.0, -18.0)
SMALL: dict[str, Any] = {"vehicles": 8, "lidar": "VLP-16", "lidar_columns": 256, "max_cycles": 3, "detector": "none"}


@pytest.fixture(autouse=True)
def arithmetic(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    """Compute in float32 on any machine, and where a test asks for it in bfloat16 as well."""
    monkeypatch.setenv("COOPSIM_PRECISION", getattr(request, "param", "float32"))


def make(name: str, **settings: Any) -> PerceivingPolicy:
    policy = coopsim.make_policy(name, **learned(name, **settings))
    assert isinstance(policy, PerceivingPolicy)
    return policy


def begin(policy: PerceivingPolicy, kind: str = "cav") -> PerceivingPolicy:
    policy.reset({name: spec_of(name, kind, policy.needs.uplink) for name in ("cav_0", "rsu_0")})
    return policy


def uplink_of(policy: PerceivingPolicy) -> Uplink:
    spec = spec_of("rsu_0", "rsu", policy.needs.uplink)
    uplink = policy.make_uplink(spec, np.random.default_rng(0))
    uplink.begin(spec, np.random.default_rng(0))
    return uplink


def said(policy: PerceivingPolicy, time_ns: int, pose: Any = ELSEWHERE, **seen: Any) -> Message:
    """What a mast elsewhere broadcasts of the same cars, and of one more."""
    message = uplink_of(policy).message("rsu_0", observe(time_ns, pose=pose, **({"cars": (*CARS, HIDDEN)} | seen)))
    assert message is not None
    return message


def play(policy: PerceivingPolicy, *observations: Observation) -> list[Tracks]:
    reports = [policy.track("cav_0", observation) for observation in observations]
    for tracks in reports:
        tracks.validate()
    return reports


def frames(policy: PerceivingPolicy, messages: Callable[[int], list[Message]], count: int = 5) -> list[Tracks]:
    return play(begin(policy), *(observe(k * FRAME_NS, *messages(k)) for k in range(count)))


def require_same(one: list[Tracks], other: list[Tracks]) -> None:
    for a, b in zip(one, other, strict=True):
        np.testing.assert_array_equal(a.id, b.id)
        np.testing.assert_array_equal(a.boxes.array, b.boxes.array)


@pytest.mark.heavy("a check plays eight episodes, here with a network for each agent")
@IN_BOTH_IF_LONG
@OF_EACH_MESSAGE
def test_policy(name: str) -> None:
    check_policy(lambda: make(name), max_cycles=3, vehicles=6)


@EVERY
def test_its_uplink(name: str) -> None:
    check_uplink(make(name))


@EVERY
def test_somebody_else_makes_a_difference_and_empty_frames_none(name: str) -> None:
    policy = make(name, tracker="ab3dmot(hits=1)")
    alone = frames(policy, lambda k: [])
    together = frames(policy, lambda k: [said(policy, k * FRAME_NS)])
    assert len(alone[-1]) and not np.array_equal(alone[-1].score, together[-1].score)
    nothing = [observe(k * FRAME_NS, sweep=Sweep.empty()) for k in range(3)]
    assert all(len(tracks) == 0 for tracks in play(begin(policy), *nothing))
    blind = replace(observe(0), sweeps={})
    assert len(play(begin(policy), blind)[0]) == 0


@EVERY
@ALIGNED_IN_BOTH
def test_the_same_message_twice_and_older_ones_change_nothing(name: str, align: bool) -> None:
    policy = make(name, align=align)
    heard = [said(policy, k * FRAME_NS) for k in range(5)]
    once = frames(policy, lambda k: [heard[k]])
    require_same(once, frames(policy, lambda k: [heard[k], heard[k]]))
    require_same(once, frames(policy, lambda k: [*heard[: k + 1]]))


@EVERY
def test_the_last_message_is_used_until_it_is_too_old(name: str) -> None:
    policy = begin(make(name, memory_s=0.25))
    heard, remembered = said(policy, 0), []
    for k in range(5):
        play(policy, observe(k * FRAME_NS, *[heard] * (k == 0)))
        remembered.append(list(policy._received["cav_0"]))
    assert remembered == [["rsu_0"]] * 3 + [[], []]


def broken(good: Message) -> Iterator[Message]:
    for payload in (b"", b"\x07nonsense", good.payload[:-1], good.payload + b"\0", bytes(100_000), b"\xff" * 80):
        yield replace(good, sender="rsu_1", payload=payload)
    for codec in ("tracks", "nobody's", ""):
        yield replace(good, sender="cav_1", codec=codec)


@EVERY
def test_messages_that_cannot_be_read_are_left_out_and_counted(name: str) -> None:
    policy = make(name)
    heard = [said(policy, k * FRAME_NS) for k in range(3)]
    good = frames(policy, lambda k: [heard[k]], 3)
    require_same(good, frames(policy, lambda k: [*broken(heard[k]), heard[k]], 3))
    assert policy.rejected == {("cav_0", "rsu_1"): 18, ("cav_0", "cav_1"): 9}


def foreign(good: Message) -> Iterator[Message]:
    """Maps of other networks, and such as no network makes."""
    sent, encode = decode_features(good), coopsim.comms.codecs.feature_codec.FeaturesCodec("float32").encode
    wild = sent.values.copy()
    wild[0, 0, 0] = 3e38
    for content in (
        replace(sent, space=sent.space ^ 1),
        replace(sent, space=0),
        replace(sent, values=sent.values[:-1]),
        replace(sent, values=wild),
        FeatureMap(np.zeros((3, 1024, 1024)), BevGrid((0, 1024), (0, 1024), 1.0), space=sent.space),
        FeatureMap(np.zeros((3, 2, 2)), BevGrid((0, 1e6), (0, 1e6), 5e5), space=sent.space),
    ):
        yield replace(good, codec="features", payload=encode(replace(content, request=None, priority=None)))
    yield replace(good, codec="features", payload=struct.pack("<f", np.nan) * 1000)


@EVERY_FUSION
def test_features_of_other_networks_are_refused(name: str) -> None:
    policy = make(name)
    heard = said(policy, 0)
    require_same(frames(policy, lambda k: [], 1), frames(policy, lambda k: [*foreign(heard)], 1))
    assert policy.rejected == {("cav_0", "rsu_0"): 7}


@EVERY_QUERY
def test_queries_of_other_networks_are_refused_and_none_or_many_are_read(name: str) -> None:
    policy = make(name)
    heard = said(policy, 0)
    sent = decode_queries(heard)
    wild, far = sent.feature.copy(), sent.boxes.array.copy()
    wild[0, 0], far[0, 0] = 3e38, 1e30
    encode = QueriesCodec("float32").encode
    refused = [
        replace(heard, payload=encode(content))
        for content in (
            replace(sent, space=sent.space ^ 1),
            replace(sent, space=0),
            replace(sent, feature=sent.feature[:, :-1]),
            replace(sent, feature=wild),
            replace(sent, boxes=Boxes3D.from_array(far)),
        )
    ]
    alone = frames(policy, lambda k: [], 1)
    require_same(alone, frames(policy, lambda k: refused, 1))
    assert policy.rejected == {("cav_0", "rsu_0"): 5}
    require_same(alone, frames(policy, lambda k: [replace(heard, payload=encode(sent[:0]))], 1))
    many = sent[np.arange(300) % len(sent)]
    assert len(frames(policy, lambda k: [replace(heard, payload=encode(many))], 1)[0])
    assert not policy.rejected


@EVERY_QUERY
def test_a_closed_gate_keeps_what_others_say_apart(name: str) -> None:
    policy = make(name, least_affinity=1.5)
    heard = said(policy, 0)
    one = len(play(begin(policy), observe(0))[0])
    policy.perceive("cav_0", observe(FRAME_NS, heard))
    apart = policy._chains["cav_0"].now  # type: ignore[attr-defined]
    assert apart is not None and len(apart.instances) >= one


@EVERY_QUERY
def test_ids_are_carried_over_frames_and_over_frames_without_sensors(name: str) -> None:
    policy = make(name)
    reports = play(begin(policy), *(replace(observe(k * FRAME_NS), sensed=k != 2) for k in range(5)))
    assert len(reports[0]) and all(len(tracks) for tracks in reports)
    assert {*reports[4].id.tolist()} <= {*reports[0].id.tolist()}
    assert {*reports[2].id.tolist()} & {*reports[1].id.tolist()}


@EVERY_QUERY
def test_an_agent_that_falls_silent_is_forgotten_with_its_objects(name: str) -> None:
    policy = make(name, memory_s=0.15)
    heard = said(policy, 0, cars=((-30.0, -15.0),))
    reports = frames(policy, lambda k: [heard] if k == 0 else [], 9)
    alone = frames(policy, lambda k: [], 9)
    assert len(reports[0]) > len(alone[0]) and len(reports[-1]) == len(alone[-1])


@EVERY_FUSION
def test_a_map_on_another_grid_is_warped(name: str) -> None:
    policy = make(name)
    heard = said(policy, 0)
    sent = decode_features(heard)
    encode = coopsim.comms.codecs.feature_codec.FeaturesCodec("float32").encode
    rows = slice(4, -8)
    (x, (low, high)), cell_m = (sent.grid.x_m, sent.grid.y_m), sent.grid.cell_m
    part = BevGrid(x, (low + 4 * cell_m, high - 8 * cell_m), cell_m)
    assert sent.confidence is not None
    smaller = FeatureMap(sent.values[:, rows], part, sent.confidence[rows], space=sent.space)
    coarse = FeatureMap(sent.values[:, ::2, ::2], sent.grid.coarser(2), space=sent.space)
    dense = replace(sent, sent=None, request=None)
    whole = frames(policy, lambda k: [replace(heard, codec="features", payload=encode(dense))], 2)
    require_same(whole, frames(policy, lambda k: [replace(heard, codec="features", payload=encode(smaller))], 2))
    frames(policy, lambda k: [replace(heard, codec="features", payload=encode(coarse))], 2)
    assert not policy.rejected


@EVERY
@pytest.mark.parametrize("xyz_yaw", [[1e300, 0, 0, 0], [0, -1e160, 0, 0], [5e4, 0, 0, 0], [900, 0, 0, 2.0]])
def test_whoever_is_far_away_changes_nothing(name: str, xyz_yaw: list[float]) -> None:
    policy = make(name)
    heard = replace(said(policy, 0), pose=PoseEstimate(np.array(xyz_yaw, dtype=float)))
    require_same(frames(policy, lambda k: [], 2), frames(policy, lambda k: [heard], 2))


@EVERY
def test_messages_from_the_future_count_as_new(name: str) -> None:
    policy = make(name)
    heard = said(policy, 0)
    ahead = [replace(heard, captured_ns=(k + 9) * FRAME_NS) for k in range(3)]
    require_same(
        frames(policy, lambda k: [replace(heard, captured_ns=k * FRAME_NS)], 3), frames(policy, lambda k: [ahead[k]], 3)
    )


@EVERY
def test_senders_without_end_are_not_all_remembered(name: str) -> None:
    policy = make(name)
    heard = said(policy, 0, sweep=Sweep.empty())
    play(begin(policy), observe(0, *(replace(heard, sender=f"cav_{k}") for k in range(1, 40))))
    assert len(policy._received["cav_0"]) == 32


@EVERY
def test_the_order_of_messages_does_not_matter(name: str) -> None:
    policy = make(name)
    heard = [replace(said(policy, 0, pose=(20.0, y, 0.0, 0.3)), sender=f"rsu_{y}") for y in (-5, 0, 9)]
    require_same(frames(policy, lambda k: heard, 2), frames(policy, lambda k: heard[::-1], 2))


@EVERY
@pytest.mark.parametrize("kind", ["rsu", "drone"])
def test_agents_that_do_not_drive(name: str, kind: str) -> None:
    policy = make(name, tracker="ab3dmot(hits=1)")
    assert len(play(begin(policy, kind), observe(0, said(policy, 0)))[0])


@EVERY
def test_no_agent_is_its_own_object(name: str) -> None:
    policy = make(name)
    over = Boxes3D.from_array([[1.0, 0.3, 0.8, 4.5, 1.9, 1.6, 0.2], [20.0, 0.3, 0.8, 4.5, 1.9, 1.6, 0.2]])
    policy.find = lambda *args: Detections(over, np.ones(2), np.zeros(2, int))  # type: ignore[method-assign]
    assert [len(begin(policy, kind).perceive("cav_0", observe(0))) for kind in ("cav", "rsu")] == [1, 2]


@EVERY
def test_no_agent_is_its_own_object_where_it_was_when_late_messages_were_captured(name: str) -> None:
    policy = make(name)
    behind = Boxes3D.from_array([[x, 0.3, 0.8, 4.5, 1.9, 1.6, 0.2] for x in (-6.0, -12.0)])
    policy.find = lambda *args: Detections(behind, np.ones(2), np.zeros(2, int))  # type: ignore[method-assign]
    for captured, left in ((0, 1), (2, 2)):
        begin(policy)
        for k in range(3):  # 3 m forward in each frame
            inbox = [said(policy, captured * FRAME_NS)] if k == 2 else []
            moved = replace(observe(k * FRAME_NS, *inbox), odometry=Odometry(np.array([3.0 * (k > 0), 0, 0, 0])))
            policy.track("cav_0", moved)
        assert len(policy.detections("cav_0")) == left


@IN_BOTH_IF_LONG
@OF_EACH_MESSAGE
def test_no_truth_reaches_a_network(name: str) -> None:
    def tracks(truth: str, seed: int) -> list[Any]:
        policy, rng = make(name), np.random.default_rng(seed)
        env = coopsim.parallel_env("crossing", uplink=policy, expose_ground_truth=truth == "shown", **SMALL)
        observations, infos = env.reset(seed=3)
        policy.reset(env.agent_specs, seed=3)
        reports = []
        while env.agents:
            if truth == "shown":
                for info in infos.values():
                    rng.shuffle(info["ground_truth"]["id"])
            actions = policy.act(observations)
            reports += [action["tracks"]["box"].copy() for action in actions.values()]
            observations, _, _, _, infos = env.step(actions)
        return reports

    for hidden, shown in zip(tracks("hidden", 0), tracks("shown", 1), strict=True):
        np.testing.assert_array_equal(hidden, shown)
    policy, sweep = begin(make(name)), sweep_from((0, 0, 0, 0))
    marked = [replace(sweep, instance=np.random.default_rng(seed).integers(0, 5, len(sweep.points))) for seed in (0, 1)]
    require_same(*(play(begin(policy), *(observe(k * FRAME_NS, sweep=each) for k in range(4))) for each in marked))


@EVERY
def test_turning_the_agent_turns_nothing_in_the_world(name: str) -> None:
    """Networks see the world's axes: who stands elsewhere turned sees the same."""
    policy, found = make(name, tracker="ab3dmot(hits=1)", region_m=(40.0, 40.0)), []
    heard = said(policy, 0)
    for heading_rad in (0.0, np.pi / 2, np.pi):
        tracks = play(begin(policy, "rsu"), observe(0, heard, pose=(0, 0, 0, heading_rad)))[0]
        turn = coopsim.geometry.se3.SE3.from_xyz_yaw(np.zeros(3), heading_rad)
        center = turn.apply(tracks.boxes.center)
        found.append(center[np.argsort(tracks.score)[::-1]])
    assert len(found[0])
    for other in found[1:]:
        np.testing.assert_allclose(other, found[0], atol=0.05)


@BY_EPISODES
def test_messages_keep_within_a_budget(name: str, sizes: list[int]) -> None:
    for budget_bytes in (1000, 3000):
        sizes.clear()
        result = coopsim.evaluate(make(name), seed=1, budget_bytes=budget_bytes, **SMALL)
        assert sizes and 0.7 * budget_bytes < max(sizes) <= budget_bytes
        assert result.messages.delivered and not result.messages.rejected
    sizes.clear()
    coopsim.evaluate(make(name), seed=1, **SMALL)  # and without a budget as before
    assert max(sizes) > 1000


@EVERY_FUSION
def test_a_codec_that_was_asked_for_is_taken(name: str) -> None:
    policy = make(name)
    coopsim.evaluate(policy, seed=1, codec="sparse_features(most_cells=50, number=float16)", **SMALL)
    with pytest.raises(InvalidValueError, match="not for ShareMaps; accepted codecs: sparse_features"):
        coopsim.evaluate(policy, seed=1, codec="features", budget_bytes=1000, **SMALL)


@BY_EPISODES
def test_points_are_encoded_and_messages_decoded_once(name: str) -> None:
    """And the boxes by which poses are corrected are found in a message once, whoever receives it."""
    policy = make(name, align=True)
    counts = {"encode": 0, "decode": 0, "found_by": 0}

    def count(method: str) -> None:
        kept = getattr(policy, method)
        setattr(policy, method, lambda *given: counts.update({method: counts[method] + 1}) or kept(*given))

    count("decode")
    count("found_by")
    if name in FUSIONS:
        perceiver = policy._perceiver  # type: ignore[attr-defined]
        encode = perceiver.encode
        perceiver.encode = lambda frames: counts.update(encode=counts["encode"] + 1) or encode(frames)
    coopsim.evaluate(policy, seed=1, **SMALL)
    agents, steps = len(policy.specs), SMALL["max_cycles"] + 1
    assert counts["decode"] == counts["found_by"] <= agents * steps and agents > 1
    assert counts["encode"] <= steps


@EVERY
def test_recordings_have_no_lidar(name: str) -> None:
    policy = make(name)
    with pytest.raises(PolicyMismatchError, match=r"needs a LiDAR, but cav_0 has none.* or in a replay"):
        coopsim.evaluate(policy, seed=1, **{**SMALL, "lidar": None})


@EVERY
@pytest.mark.parametrize(
    ("settings", "error", "match"),
    [
        ({"hitz": 3}, UnknownNameError, "unknown parameter 'hitz'"),
        ({"tracker": "dino_cod"}, UnknownNameError, "Did you mean 'dino_codt"),
        ({"tracker": "track_to_track"}, InvalidValueError, "tracker must be a policy that tracks boxes .*late_fusion"),
        ({"tracker": "attfuse"}, InvalidValueError, "tracker must be a policy that tracks boxes"),
        ({"region_m": 3}, InvalidValueError, "region_m must be two numbers"),
        ({"region_m": (1e9, 4)}, InvalidValueError, r"region_m\[0\] must be in \[5, 300\]"),
        ({"delayed": "replay"}, InvalidValueError, "delayed must be left at 'as_current'"),
        ({"memory_s": 0}, InvalidValueError, "memory_s must be"),
        ({"least_score": 2}, InvalidValueError, r"least_score must be in \[0, 1\]"),
        ({"weights": "nobodys"}, UnknownNameError, "unknown weights 'nobodys'"),
    ],
)
def test_wrong_settings_are_refused(name: str, settings: dict[str, Any], error: type[CoopsimError], match: str) -> None:
    with pytest.raises(error, match=match):
        make(name, **settings)


@pytest.mark.parametrize(
    "tracker", all_of(sorted({*policies_on_boxes()} - {"track_to_track"}), "coop_fuse", "late_fusion")
)
def test_any_tracker_tracks_what_a_network_finds(tracker: str) -> None:
    policy = make("fcooper", tracker=tracker, least_score=0.1)
    assert len(frames(policy, lambda k: [said(policy, k * FRAME_NS)])[-1])


@pytest.mark.parametrize("policy", ["no_fusion", "late_fusion(merge=nms)", "coop_fuse"])
def test_policies_on_boxes_run_on_the_networks(policy: str) -> None:
    result = coopsim.evaluate(policy, seed=1, **{**SMALL, "detector": tiny_detector()})
    assert result.score["TP"] + result.score["FP"] > 0


@EVERY
def test_alignment_follows_a_moving_agent_once_a_frame(name: str) -> None:
    """Random networks see nothing in common that poses could be corrected by: they stay as stated."""
    policy, step_m = begin(make(name, align=True)), 1.5
    policy.found_by = lambda *args: Detections.empty()  # type: ignore[method-assign]
    for k in range(6):
        at = observe(k * FRAME_NS, said(policy, k * FRAME_NS), pose=(k * step_m, 0, 0, 0))
        policy.track("cav_0", replace(at, odometry=Odometry(np.array([step_m if k else 0.0, 0, 0, 0]))))
    (heard,) = policy._received["cav_0"].values()
    np.testing.assert_allclose(heard.odom_SE3_sender.translation[:2], ELSEWHERE[:2], atol=1e-3)


@BY_EPISODES
def test_a_policy_ends_when_nobody_has_it_any_more(name: str) -> None:
    """With all its maps, without waiting for Python to look for cycles, after an episode with messages."""
    policy = make(name)
    env = listening_env("crossing", policy, {name: each for name, each in SMALL.items() if name != "detector"})
    gc.collect()
    gc.disable()
    try:
        run_episode(env, policy, seed=0)
        env.close()
        kept = weakref.ref(policy)
        del policy, env
        assert kept() is None
    finally:
        gc.enable()
