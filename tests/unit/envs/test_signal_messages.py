"""Roadside units broadcast lights over the channel, and agents hear them beside their inbox."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest
from lit_crossing import crossing

from coopsim.comms import ReceivedLights
from coopsim.comms.codecs.dsrc import decode_mapem, decode_spatem
from coopsim.comms.signal_broadcast import SignalBroadcast
from coopsim.envs.makers import simulation_env
from coopsim.envs.parallel import CooperativeEnv
from coopsim.envs.simulated.simulation import Simulation
from coopsim.envs.simulated.simulation_options import SimulationOptions
from coopsim.errors import InvalidValueError
from coopsim.types import Detections, Observation, Odometry, PoseEstimate, Tracks
from coopsim.types.intersections import IntersectionMap, MapLane, MovementPhase
from coopsim.wire.actions import pack_tracks
from coopsim.world.custom.place import place_from
from coopsim.world.intersections import lit_junctions
from coopsim.world.places.description import MapUnit
from coopsim.world.places.place import Place
from coopsim.world.scenario import SameScenario, make_scenario

pytest.importorskip("asn1tools")
NS = 10**9
NOTHING = {"tracks": pack_tracks(Tracks.empty())}


@cache
def place() -> Place:
    return place_from(replace(crossing(lights=True, cut=False), rsus=(MapUnit((18.0, 18.0), (0.0, 0.0)),)), "lit")


def lit_env(**options: Any) -> CooperativeEnv:
    usual: dict[str, Any] = {"vehicles": 4, "connected_cars": 2, "rsus": 1, "pedestrians": 0, "lidar": None}
    return simulation_env(place(), "lit", **(usual | {"detector": "simulated", "seed": 5} | options))


def frames(env: CooperativeEnv, steps: int) -> list[dict[str, Observation]]:
    """The observations of each frame as agents unpack them, all of which are in their spaces."""
    packed, found = env.reset()[0], list[dict[str, Observation]]()
    for step in range(steps + 1):
        assert all(env.observation_space(name).contains(each) for name, each in packed.items())
        found.append(env._source.format.unpack_all(packed))
        if step < steps:
            packed = env.step(dict.fromkeys(env.agents, NOTHING))[0]
    return found


def test_agents_hear_phases_ten_times_a_second_and_the_map_once() -> None:
    env = lit_env(signal_messages=True)
    heard = ReceivedLights()
    for k, each in enumerate(frames(env, 11)):
        assert each["rsu_0"].signals == ()  # a unit does not hear itself
        heard.hear(each["cav_1"])
        assert [payload[1] for payload in each["cav_1"].signals] == ([4, 5] if k in (0, 10) else [4])
        assert heard.phases[1].time_ns == k * NS // 10 and heard.rejected == 0
    letters = {MovementPhase.GREEN: "G", MovementPhase.GREEN_GIVE_WAY: "g", MovementPhase.RED: "r"}
    state = dict(zip(heard.phases[1].group.tolist(), heard.phases[1].phase.tolist(), strict=True))
    shown = [letters[state[group]] for lane in heard.maps[1].lanes[:8] for _, group in lane.connections if group]
    assert sorted(shown) == sorted(env.road_map.lights)


@pytest.mark.parametrize("options", [{"loss": 0.4, "latency_s": 0.15}, {"uplink": "tracks", "dt_s": 0.25}])
def test_nothing_else_changes(options: dict[str, Any]) -> None:
    """Losses and delays of other messages are what they are without, and only the unit's bytes grow."""
    without, env = lit_env(**options), lit_env(signal_messages=True, **options)
    silent, told = frames(without, 6), frames(env, 6)
    for before, after in zip(silent, told, strict=True):
        for name, each in before.items():
            assert [message.identity for message in each.inbox] == [message.identity for message in after[name].inbox]
            assert each.signals == ()
    assert "signals" not in without.observation_space("cav_0").spaces
    assert env.bytes_per_s("cav_0") == without.bytes_per_s("cav_0")
    assert env.bytes_per_s("rsu_0") > without.bytes_per_s("rsu_0") + 500
    counts = env.channel_counts
    assert counts.sent > without.channel_counts.sent and counts.sent == counts.delivered + counts.lost + counts.pending


def test_what_is_lost_or_out_of_range_is_not_heard() -> None:
    heard = [len(each["cav_0"].signals) for each in frames(lit_env(signal_messages=True, loss=0.5), 12)]
    assert 2 < sum(heard) < 12
    assert not any(each["cav_0"].signals for each in frames(lit_env(signal_messages=True, communication_range_m=1), 2))


def standing(x: float, y: float, heading: float, time_ns: int, signals: tuple[bytes, ...] = ()) -> Observation:
    pose = PoseEstimate(np.array([x, y, 0.0, heading]))
    return Observation(time_ns, pose, Odometry(np.zeros(4)), Detections.empty(), signals=signals)


def test_a_car_knows_the_lights_of_its_own_lane_and_how_long_they_last() -> None:
    signals = frames(lit_env(signal_messages=True), 0)[0]["cav_0"].signals
    heard = ReceivedLights()
    heard.hear(standing(0, 0, 0, 0, (*signals, *signals[:1], signals[0][:-1], b"")))
    assert heard.rejected == 2
    lights = heard.ahead(standing(40.0, 1.6, np.pi, NS))  # from the east, towards the junction
    assert [light.stop_m for light in lights] == [pytest.approx(26.0, abs=0.1)] * 3
    assert sorted(light.phase for light in lights) == [MovementPhase.GREEN_GIVE_WAY] + [MovementPhase.GREEN] * 2
    assert {round(light.left_s, 6) for light in lights} == {11.0}  # twelve seconds of green
    assert {light.phase for light in heard.ahead(standing(-1.6, 40.0, -np.pi / 2, 0))} == {MovementPhase.RED}
    for away in (standing(40.0, 1.6, 0.0, 0), standing(40.0, -1.6, np.pi, 0), standing(0.0, 1.6, np.pi, 0)):
        assert heard.ahead(away) == ()  # against the lane, on another one, on the junction
    assert heard.ahead(standing(40.0, 1.6, np.pi, 3 * NS)) == ()  # heard too long ago


def test_a_unit_that_stands_elsewhere_says_nothing_of_a_junction() -> None:
    lit = lit_junctions(place().make_layout())
    broadcast = SignalBroadcast(lit, ("rsu_0", "rsu_1"))
    poses = {name: PoseEstimate(np.zeros(4)) for name in ("rsu_0", "rsu_1")}
    near, far = np.array([30.0, 0.0, 0.0]), np.array([60.0, 0.0, 0.0])
    sent = broadcast.messages(0, {"rsu_0": far, "rsu_1": near}, poses)
    assert list(sent) == ["rsu_1"] and [message.codec for message in sent["rsu_1"]] == ["spatem", "mapem"]
    assert decode_spatem(sent["rsu_1"][0].payload)[0].intersection == 1
    assert decode_mapem(sent["rsu_1"][1].payload)[0].intersection == 1
    assert broadcast.messages(NS // 20, {"rsu_0": far, "rsu_1": near}, poses) == {}
    assert SignalBroadcast(lit, ("rsu_0",)).messages(0, {"rsu_0": far}, poses) == {}


def test_a_junction_that_no_message_holds_is_left_out_with_a_warning() -> None:
    class Large:
        map = IntersectionMap(1, np.zeros(3), tuple(MapLane(k, "other", np.eye(2), True, False) for k in range(256)))
        phases = lit_junctions(place().make_layout())[0].phases

    broadcast = SignalBroadcast([Large()], ("rsu_0",))  # type: ignore[list-item]
    with pytest.warns(UserWarning, match="junction 1 is not broadcast by rsu_0: the kind of a lane must be one of"):
        assert broadcast.messages(0, {"rsu_0": np.zeros(3)}, {}) == {}


def test_wrong_options_are_refused() -> None:
    with pytest.raises(InvalidValueError, match="signal_messages needs a roadside unit that sends them: accepted"):
        lit_env(signal_messages=True, rsus=0)
    with pytest.raises(InvalidValueError, match="signal_messages must be True or False, got 'yes'"):
        lit_env(signal_messages="yes")
    log = replace(make_scenario(place(), rsus=1), played=object())  # type: ignore[arg-type]
    with pytest.raises(InvalidValueError, match="needs lights with known programs, got a log's or SUMO's traffic"):
        Simulation("log", SameScenario(log), SimulationOptions(lidar=None, detector="none", signal_messages=True))


def test_lights_are_heard_with_messages_as_actions_too() -> None:
    env = lit_env(signal_messages=True, uplink="action", attacks=None)
    packed, _ = env.reset()
    for _ in range(2):
        packed = env.step({name: env.action_space(name).sample() | NOTHING for name in env.agents})[0]
        assert len(packed["cav_0"]["signals"]["payload_bytes"]) in (1, 2)
