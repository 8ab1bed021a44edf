"""Cars tell their planned ways over the channel, beside their detections, and planners get them."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import coopsim
from coopsim import PlannedCar, Planner
from coopsim.comms.codecs.maneuvers import decode_mcm
from coopsim.envs.parallel import CooperativeEnv
from coopsim.errors import InvalidValueError
from coopsim.types import Tracks
from coopsim.wire.actions import pack_tracks

pytest.importorskip("asn1tools")
NOTHING = {"tracks": pack_tracks(Tracks.empty())}


class Listens(Planner):
    """A planner that drives by intents alone, in a line."""

    got: list[float]

    def plan(self, car: PlannedCar) -> float:
        near = bool((np.abs(car.intents.at(np.arange(0.0, 3.0, 0.5))[..., :2]).max(axis=-1) < 20).any())
        type(self).got.append(len(car.intents))
        return -2.0 if near else 0.0


def run(steps: int, **options: Any) -> tuple[CooperativeEnv, list[Any]]:
    usual: dict[str, Any] = {"lidar": None, "penetration": 1.0, "detector": "simulated"}
    env = coopsim.parallel_env("crossing_path", **(usual | options))
    packed, found = env.reset(seed=3)[0], list[Any]()
    for step in range(steps + 1):
        assert all(env.observation_space(name).contains(each) for name, each in packed.items())
        found.append(env._source.format.unpack_all(packed))
        if step < steps:
            packed = env.step(dict.fromkeys(env.agents, NOTHING))[0]
    return env, found


def test_planned_ways_come_beside_detections_and_change_nothing_else() -> None:
    options = {"latency_s": 0.15, "loss": 0.3}
    (without, silent), (env, told) = run(4, **options), run(4, uplink="intents", **options)
    for before, after in zip(silent, told, strict=True):
        for name, each in before.items():
            assert [message.identity for message in each.inbox] == [message.identity for message in after[name].inbox]
            assert each.signals == ()
    cars = [name for name in env.possible_agents if name != "cav_0"]
    ways = {decode_mcm(payload).station for each in told for payload in each["cav_0"].signals}
    assert 1 < len(ways) <= len(cars)
    more = env.bytes_per_s("cav_1") - without.bytes_per_s("cav_1")
    assert 10 * 200 < more < 10 * 300  # an MCM ten times a second, with its envelope


def test_a_told_way_is_where_the_sender_will_be() -> None:
    env, told = run(10, uplink="intents", control="traffic")
    first = {decode_mcm(payload).station: decode_mcm(payload) for payload in told[0]["cav_0"].signals}
    after = {name: agent.body.world_SE3_base.translation[:2] for name, agent in env.episode.frame.agents.items()}
    apart = [
        min(np.hypot(*(way.position[:2] + way.points[5] - place)) for place in after.values()) for way in first.values()
    ]
    assert len(apart) == len(env.possible_agents) - 1 and np.median(apart) < 1.0


def test_a_planner_of_a_users_gets_them() -> None:
    Listens.got = []
    env, _ = run(4, uplink="intents", planner=Listens)
    assert Listens.got == [len(env.possible_agents) - 1] * 4
    Listens.got = []
    run(4, planner=Listens)
    assert Listens.got == [0] * 4


def test_the_same_seed_gives_the_same_bits_beside_another_environment_and_alone() -> None:
    """That workers change no bits is a test of vectors."""
    options = {"lidar": None, "uplink": "intents", "latency_s": 0.1}
    with coopsim.vector("crossing_path", 2, workers=0, **options) as made:
        observations, infos = made.reset(seed=3)
        for _ in range(2):
            observations, *_ = made.step([dict.fromkeys(each, NOTHING) for each in observations])
    for there, info in zip(observations, infos, strict=True):
        seed = next(iter(info.values()))["seed"]
        env = coopsim.parallel_env("crossing_path", **options)
        here, _ = env.reset(seed=seed)
        for _ in range(2):
            here, *_ = env.step(dict.fromkeys(env.agents, NOTHING))
        assert {name: each["signals_payload"].tobytes() for name, each in here.items()} == {
            name: each["signals_payload"].tobytes() for name, each in there.items()
        }
        assert any(each["signals_payload"].size for each in here.values())


def test_policies_of_boxes_send_them_too() -> None:
    policy = coopsim.make_policy("late_fusion", intents=True)
    env, told = run(1, uplink=policy)
    assert len(told[-1]["cav_0"].signals) == len(env.possible_agents) - 1
    with pytest.raises(InvalidValueError, match="intents must be False for a policy that shares no boxes"):
        coopsim.make_policy("no_fusion", intents=True)


def test_wrong_parameters_are_refused() -> None:
    with pytest.raises(InvalidValueError, match="hard_brakes must be True or False, got 1"):
        run(0, uplink="intents(hard_brakes=1)")
