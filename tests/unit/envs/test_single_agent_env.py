"""One agent acts, the others follow policies: what they do, with which seeds, and what is refused."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium import spaces
from gymnasium.utils.env_checker import data_equivalence, data_shares_objects
from small_env import SMALL

import coopsim
from coopsim.agents.boxes import LateFusion
from coopsim.comms.uplinks.share_detections import ShareDetections
from coopsim.errors import (
    EpisodeStateError,
    InvalidActionError,
    InvalidValueError,
    PolicyMismatchError,
    UnknownNameError,
)
from coopsim.types import Tracks
from coopsim.types.messages import IDLE, MANEUVERS
from coopsim.wire.actions import pack_tracks

NOTHING = {"tracks": pack_tracks(Tracks.empty())}


def make(environment: str = "crossing", **options: Any) -> Any:
    return coopsim.single_env(environment, **(SMALL | options))


def play(env: Any, action: Any, seed: int | None = None) -> list[Any]:
    """Everything that an episode gives, with the same action in every frame."""
    history: list[Any] = [env.reset(seed=seed)]
    while not (len(history) > 1 and (history[-1][2] or history[-1][3])):
        history.append(env.step(action))
    return history


class Recorder(LateFusion):
    """Says who was asked to track, and with which sweeps."""

    def begin(self, spec: Any, rng: Any) -> None:
        super().begin(spec, rng)
        self.asked: list[str] = []

    def track(self, agent: str, observation: Any) -> Tracks:
        self.asked.append(agent)
        return super().track(agent, observation)


def test_the_first_agent_is_the_ego_unless_another_is_named() -> None:
    assert make().ego == "cav_0"
    env = make(ego="rsu_0")
    assert env.ego == "rsu_0"
    assert env.observation_space["sweeps"] == env.parallel.observation_space("rsu_0")["sweeps"]


def test_action_and_observation_are_the_egos_own() -> None:
    env = make(control="policy")
    assert env.action_space == env.parallel.action_space("cav_0")
    observation, info = env.reset(seed=4)
    parallel = coopsim.parallel_env("crossing", control="policy", **SMALL)
    packed, infos = parallel.reset(seed=4)
    assert data_equivalence(observation, {k: v for k, v in packed["cav_0"].items() if k != "cameras"}, exact=True)
    assert info == infos["cav_0"] and info["seed"] == 4
    assert observation in env.observation_space


def test_no_part_of_the_observation_is_always_empty(recordings: Path) -> None:
    """Gymnasium refuses empty dicts."""
    assert {"sweeps", "cameras"} & set(make().observation_space) == {"sweeps"}
    assert {"sweeps", "cameras"} & set(make(lidar=None).observation_space) == set()
    replay = coopsim.single_env("replay", path=recordings, detections="ego")
    assert {"sweeps", "cameras"} & set(replay.observation_space) == set()


def test_an_ego_that_acts_as_the_others_do_is_their_cooperation() -> None:
    """The same bits as with all agents in one policy's hands, message for message and draw for draw."""
    options = SMALL | {"position_noise_m": 0.3, "latency_s": 0.1, "loss": 0.2}
    whole = coopsim.evaluate("late_fusion", "crossing", seed=5, **options)
    env = make(others="late_fusion", **options)
    mine = coopsim.make_policy("late_fusion")
    observation, _ = env.reset(seed=5)
    mine.reset(env.parallel.agent_specs, seed=5)
    over = False
    while not over:
        observation, _, terminated, over, _ = env.step(mine.act({env.ego: observation})[env.ego])
        assert not terminated
    np.testing.assert_equal(env.parallel.score().to_dict(), whole.score.to_dict())
    assert env.parallel.link_counts == whole.links


def test_a_tracker_leaves_driving_to_the_ego() -> None:
    options = SMALL | {"control": "policy"}
    whole = coopsim.evaluate("late_fusion", "crossing", seed=2, **options)
    env = make(tracker="late_fusion", others="late_fusion", **options)
    assert env.action_space == spaces.Discrete(5)
    play(env, IDLE, seed=2)
    np.testing.assert_equal(env.parallel.score().to_dict(), whole.score.to_dict())


def test_the_ego_drives() -> None:
    def travelled(maneuver: str, **more: Any) -> float:
        env = make("highway", control="policy", max_cycles=30, lidar=None, **more)
        action: Any = MANEUVERS.index(maneuver)
        history = play(env, action if "tracker" in more else NOTHING | {"maneuver": action}, seed=3)
        return float(sum(each[0]["odometry"][0] for each in history))

    assert travelled("faster") > travelled("slower") + 5
    assert travelled("faster", tracker="no_fusion") == travelled("faster")


def test_a_zero_dimensional_array_is_an_action() -> None:
    """Learners' `predict` returns one, and gymnasium counts it as an element of `Discrete`."""
    env = make(control="policy", tracker="no_fusion")
    env.reset(seed=0)
    assert np.array(3) in env.action_space
    env.step(np.array(3))
    env.step(np.int64(3))


def test_others_without_a_policy_report_nothing() -> None:
    env = make(others={"cav_1": "no_fusion"})
    play(env, NOTHING, seed=0)
    reported = {agent: len(log.flat().track_id) for agent, log in env.parallel.logs.items()}
    assert reported["cav_1"] > 0
    assert {reported[agent] for agent in ("cav_0", "cav_2", "rsu_0")} == {0}


def test_agents_of_one_spec_share_a_policy_and_others_do_not() -> None:
    shared, apart = "late_fusion(hits=2)", "late_fusion(hits=3)"
    env = make(others={"cav_1": shared, "cav_2": "late_fusion( hits = 2 )", "rsu_0": apart})
    assert env.policies["cav_1"] is env.policies["cav_2"]
    assert env.policies["cav_1"] is not env.policies["rsu_0"]
    assert "cav_0" not in env.policies
    env = make(others="late_fusion", tracker="late_fusion", control="policy")
    assert len(set(map(id, env.policies.values()))) == 1


def test_policy_objects_are_copied_and_asked_for_their_agents_only() -> None:
    given = Recorder()
    env = make(others={"cav_1": given, "cav_2": given})
    assert env.policies["cav_1"] is env.policies["cav_2"]
    play(env, NOTHING, seed=0)
    assert env.policies["cav_1"].asked == ["cav_1", "cav_2"] * SMALL["max_cycles"]
    assert not hasattr(given, "asked")


def test_policies_that_are_equal_and_have_no_hash_are_told_apart() -> None:
    @dataclass
    class Plain(coopsim.Policy):
        needs = coopsim.Needs(uplink="none")
        asked: int = 0

        def track(self, agent: str, observation: Any) -> Tracks:
            self.asked += 1
            return Tracks.empty()

    env = make(others={"cav_1": Plain(), "cav_2": Plain()})
    play(env, NOTHING, seed=0)
    assert [env.policies[agent].asked for agent in ("cav_1", "cav_2")] == [SMALL["max_cycles"]] * 2


def test_two_environments_with_one_policy_object_do_not_disturb_each_other() -> None:
    given = LateFusion()
    alone = play(make(others=given), NOTHING, seed=1)
    first, second = make(others=given), make(others=given)
    first.reset(seed=1)
    second.reset(seed=8)
    for expected in alone[1:]:
        assert data_equivalence(first.step(NOTHING), expected, exact=True)
        second.step(NOTHING)


def test_every_agent_broadcasts_what_its_policy_makes() -> None:
    class Marked(LateFusion):
        def make_uplink(self, spec: Any, rng: Any) -> Any:
            uplink = MarkedUplink("detections")
            uplink.maker = self
            return uplink

    class MarkedUplink(ShareDetections):
        maker: Any

        def content_of(self, sender: str, observation: Any) -> Any:
            senders.setdefault(id(self.maker), set()).add(sender)
            return super().content_of(sender, observation)

    senders: dict[int, set[str]] = {}
    env = make(others={"cav_1": Marked(), "cav_2": Marked(), "rsu_0": "no_fusion"})
    env.reset(seed=0)
    assert senders[id(env.policies["cav_2"])] == {"cav_2"}
    assert senders[id(env.policies["cav_1"])] == {"cav_0", "cav_1", "rsu_0"}  # those without a say follow the first


@pytest.mark.parametrize(
    ("options", "sent"),
    [
        ({}, "detections"),
        ({"others": "no_fusion"}, "detections"),
        ({"uplink": "tracks"}, "tracks"),
        ({"uplink": "none", "others": "no_fusion"}, "none"),
        ({"others": "track_to_track"}, "tracks"),
        ({"others": "no_fusion", "tracker": "track_to_track", "control": "policy"}, "tracks"),
        ({"others": "late_fusion", "uplink": "detections"}, "detections"),
    ],
)
def test_policies_decide_what_is_broadcast_and_else_the_option(options: dict[str, Any], sent: str) -> None:
    assert {spec.uplink for spec in make(**options).parallel.agent_specs.values()} == {sent}


def test_same_seed_same_bits_and_the_next_episodes_too() -> None:
    def episodes() -> list[Any]:
        env = make(others="late_fusion", position_noise_m=0.2, latency_s=0.1, loss=0.1)
        return [play(env, NOTHING, seed=11), play(env, NOTHING), play(env, NOTHING)]

    first, again = episodes(), episodes()
    assert data_equivalence(first, again, exact=True)
    seeds = [episode[0][1]["seed"] for episode in first]
    assert seeds[0] == 11 and len(set(seeds)) == 3


def test_without_any_seed_episodes_differ() -> None:
    assert make().reset()[1]["seed"] != make().reset()[1]["seed"]


def test_the_option_seed_is_of_every_episode_without_one() -> None:
    env = make(seed=6)
    assert [env.reset(seed=seed)[1]["seed"] for seed in (None, 3, None)] == [6, 3, 6]


def test_another_seed_draws_other_numbers_for_the_policies() -> None:
    class Draws(LateFusion):
        drawn: dict[str, float]

        def begin(self, spec: Any, rng: Any) -> None:
            super().begin(spec, rng)
            self.drawn = getattr(self, "drawn", {}) | {spec.name: rng.random()}

    env = make(others=Draws())
    drawn = []
    for seed in (1, 2, 1):
        env.reset(seed=seed)
        drawn.append(dict(env.policies["cav_1"].drawn))
    assert drawn[0] == drawn[2] and drawn[0] != drawn[1]
    assert len(set(drawn[0].values())) == 4


def test_observations_share_nothing_with_the_recording(recordings: Path) -> None:
    env = coopsim.single_env("replay", path=recordings, detections=("ego", "1"), ego="1", others="late_fusion")
    first, _ = env.reset(seed=0)
    again, _ = env.reset(seed=0)
    assert len(first["detections"]["box"]) == 1
    assert not data_shares_objects(first, again)
    first["detections"]["box"][:] = 0
    assert env.reset(seed=0)[0]["detections"]["box"][0, 0] != 0


def test_a_recording_ends_truncated_and_another_can_be_asked_for(recordings: Path) -> None:
    env = coopsim.single_env("replay", path=recordings, detections=("ego", "1"), others="late_fusion")
    history = play(env, NOTHING, seed=0)
    assert [each[3] for each in history[1:]] == [False] * 5 + [True]
    assert not any(each[2] for each in history[1:])
    assert history[-1][0] in env.observation_space
    env.reset(seed=0, options={"sequence": "0001"})
    with pytest.raises(UnknownNameError, match="unknown sequence '0007'"):
        env.reset(options={"sequence": "0007"})


def test_an_ego_that_leaves_is_truncated_with_its_last_observation(monkeypatch: pytest.MonkeyPatch) -> None:
    env = make(others="no_fusion")
    env.reset(seed=0)
    advance = env.parallel._source.advance

    def without_ego(*given: Any) -> Any:
        frame = advance(*given)
        return replace(frame, agents={name: each for name, each in frame.agents.items() if name != "cav_0"})

    before, *_ = env.step(NOTHING)
    monkeypatch.setattr(env.parallel._source, "advance", without_ego)
    observation, reward, terminated, truncated, info = env.step(NOTHING)
    assert data_equivalence(observation, before, exact=True) and not data_shares_objects(observation, before)
    assert (terminated, truncated) == (False, True) and np.isfinite(reward) and "counts" in info
    with pytest.raises(EpisodeStateError, match="the episode is over"):
        env.step(NOTHING)


def test_steps_out_of_order_are_refused() -> None:
    env = make(others="late_fusion", max_cycles=1)
    with pytest.raises(EpisodeStateError, match="there is no episode yet: call reset"):
        env.step(NOTHING)
    play(env, NOTHING, seed=0)
    with pytest.raises(EpisodeStateError, match="the episode is over: call reset"):
        env.step(NOTHING)


def test_a_refused_action_leaves_everything_as_it_was() -> None:
    expected = play(make(others="late_fusion"), NOTHING, seed=1)
    env = make(others="late_fusion")
    env.reset(seed=1)
    for each in expected[1:]:
        with pytest.raises(InvalidActionError, match="cav_0: an action is a dict with \\['tracks'\\], got 3"):
            env.step(3)
        assert data_equivalence(env.step(NOTHING), each, exact=True)


def test_an_error_of_a_policy_ends_the_episode() -> None:
    class Breaks(LateFusion):
        def track(self, agent: str, observation: Any) -> Tracks:
            raise ZeroDivisionError

    env = make(others=Breaks())
    env.reset(seed=0)
    with pytest.raises(ZeroDivisionError):
        env.step(NOTHING)
    with pytest.raises(EpisodeStateError, match="ended halfway in an error: call reset"):
        env.step(NOTHING)
    env.reset(seed=0)


@pytest.mark.parametrize("maneuver", [7, -1, 1.0, "idle", None, np.array([1])])
def test_a_maneuver_that_is_none_is_refused(maneuver: Any) -> None:
    env = make(tracker="no_fusion", control="policy")
    env.reset(seed=0)
    with pytest.raises(InvalidActionError, match="maneuver must be one of 0 lane_left, 1 idle"):
        env.step(maneuver)


@pytest.mark.parametrize(
    ("options", "error", "message"),
    [
        ({"ego": "cav0"}, UnknownNameError, "unknown ego 'cav0'. Did you mean 'cav_0'"),
        ({"ego": 0}, UnknownNameError, "unknown ego 0.*Accepted: cav_0, cav_1, cav_2, rsu_0"),
        ({"others": "late_fuson"}, UnknownNameError, "others: unknown policy 'late_fuson'. Did you mean 'late_fusion'"),
        ({"others": "late_fusion(hit=2)"}, UnknownNameError, "others: unknown parameter 'hit'.*Did you mean 'hits'"),
        ({"others": "late_fusion(hits=-2)"}, InvalidValueError, "others: hits must be"),
        ({"others": LateFusion}, InvalidValueError, "others must be an object, got the class LateFusion: write"),
        (
            {"others": 7},
            InvalidValueError,
            "others must be a policy's name or spec.*a mapping of agents to these, or None; got 7",
        ),
        ({"others": ["no_fusion"]}, InvalidValueError, "others must be a policy's name or spec.*got \\['no_fusion'\\]"),
        ({"others": {"cav1": "no_fusion"}}, UnknownNameError, "agent in others 'cav1'. Did you mean 'cav_1'"),
        ({"others": {"cav_0": "no_fusion"}}, InvalidValueError, "others must not have the ego 'cav_0'"),
        ({"others": {"cav_1": 3}}, InvalidValueError, "others\\['cav_1'\\] must be a policy's name or spec.*; got 3"),
        ({"others": {"cav_1": "nofusion"}}, UnknownNameError, "others\\['cav_1'\\]: unknown policy 'nofusion'"),
        ({"tracker": "late_fuson"}, UnknownNameError, "tracker: unknown policy 'late_fuson'"),
        ({"tracker": 1.5}, InvalidValueError, "tracker must be a policy's name or spec.*; got 1.5"),
        ({"tracker": "no_fusion"}, InvalidValueError, 'cav_0 does not drive.*control="policy"'),
        ({"tracker": "no_fusion", "control": "policy", "ego": "rsu_0"}, InvalidValueError, "rsu_0 does not drive"),
        ({"vehicels": 3}, UnknownNameError, "unknown option 'vehicels'. Did you mean 'vehicles'"),
        ({"other": "no_fusion"}, UnknownNameError, "unknown option 'other'. Did you mean 'others'"),
        ({"trackers": "no_fusion"}, UnknownNameError, "unknown option 'trackers'. Did you mean 'tracker'"),
        ({"render_mode": "rgb"}, UnknownNameError, "unknown render_mode 'rgb'"),
        (
            {"others": {"cav_1": "late_fusion", "cav_2": "track_to_track"}},
            PolicyMismatchError,
            "uplink is one for all.*others\\['cav_1'\\] 'detections', others\\['cav_2'\\] 'tracks'",
        ),
        (
            {"others": "late_fusion", "uplink": "tracks"},
            PolicyMismatchError,
            "others \\(LateFusion\\) needs uplink 'detections', but the agents broadcast 'tracks': leave out",
        ),
    ],
)
def test_a_wrong_argument_is_named(options: dict[str, Any], error: type[Exception], message: str) -> None:
    with pytest.raises(error, match=message):
        make(**options)


def test_a_policy_that_cannot_be_copied_is_refused() -> None:
    policy = LateFusion()
    policy.stream = (k for k in range(3))  # type: ignore[attr-defined]
    with pytest.raises(InvalidValueError, match=r"others must be a policy that can be copied.*LateFusion cannot"):
        make(others=policy)


def test_sensors_that_a_policy_needs_are_there_or_missed() -> None:
    class Looks(LateFusion):
        needs = coopsim.Needs(uplink="none", lidar=True)

    with pytest.raises(PolicyMismatchError, match="others: Looks needs a LiDAR"):
        make(others=Looks(), lidar=None)


def test_cameras_come_with_a_policy_that_needs_them(recordings: Path) -> None:
    pytest.importorskip("moderngl")

    class Sees(LateFusion):
        needs = coopsim.Needs(uplink="none", cameras="front")

    class SeesAll(LateFusion):
        needs = coopsim.Needs(uplink="none", cameras=True)

    with pytest.raises(PolicyMismatchError, match="others \\(Sees\\) needs cameras 'front', and 'replay' has none"):
        coopsim.single_env("replay", path=recordings, detections=("ego", "1"), others=Sees())
    with pytest.raises(PolicyMismatchError, match=r"cameras is one for all agents.*'front'.*'surround'"):
        make(others={"cav_1": Sees(), "cav_2": SeesAll()})


@pytest.mark.parametrize("seed", [-1, 1.5, "seven", True])
def test_a_wrong_seed_is_refused(seed: Any) -> None:
    env = make()
    with pytest.raises(InvalidValueError, match="seed must be an integer >= 0"):
        env.reset(seed=seed)
    env.reset(seed=np.int64(3))


def test_a_picture_is_drawn_and_closing_twice_is_fine() -> None:
    env = gymnasium.make("coopsim/crossing-v3", render_mode="rgb_array", **SMALL)
    env.reset(seed=0)
    picture = env.render()
    assert isinstance(picture, np.ndarray) and picture.dtype == np.uint8 and picture.shape[2] == 3
    env.close()
    env.close()
