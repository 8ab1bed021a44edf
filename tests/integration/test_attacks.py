"""Lies in the loop: what they change, what they leave as it is, and where they are recorded."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import coopsim
from coopsim.comms.envelope import decode_detections, decode_tracks
from coopsim.errors import InvalidValueError, UnknownNameError
from coopsim.testing.harness import digest
from coopsim.types import Message, Observation
from coopsim.types.lies import Lie
from coopsim.wire.observation_format import ObservationFormat

LIAR, VICTIM = "cav_1", "cav_0"
SWEEPS = {"lidar": "VLP-16", "lidar_columns": 256}


class Episode:
    """An episode's observations, infos and lies by frame, and its environment afterwards."""

    def __init__(self, attacks: Any, policy: str = "late_fusion", frames: int = 12, **options: Any) -> None:
        tracker = coopsim.make_policy(policy)
        uplink = options.pop("uplink_name", tracker)
        options = {"lidar": None, "max_cycles": frames, "expose_ground_truth": True, **options}
        self.env = env = coopsim.parallel_env("crossing", uplink=uplink, attacks=attacks, **options)
        form = ObservationFormat.to_unpack(env.agent_specs)
        packed, infos = env.reset(seed=3)
        tracker.reset(env.agent_specs, seed=3)
        self.seen: list[dict[str, Observation]] = [form.unpack_all(packed)]
        self.infos, self.lies = [infos], [env.episode.lies]
        self.reports: list[dict[str, Any]] = []
        while env.agents:
            self.reports.append(tracker.act(packed))
            packed, _, _, _, infos = env.step(self.reports[-1])
            self.seen.append(form.unpack_all(packed))
            self.infos.append(infos)
            self.lies.append(env.episode.lies)

    def messages(self, sender: str, receiver: str = VICTIM) -> list[Message]:
        return [message for seen in self.seen for message in seen[receiver].inbox if message.sender == sender]

    def claimed(self) -> list[tuple[Lie, np.ndarray[Any, Any]]]:
        return [(lie, row) for lies in self.lies for lie in lies for row in lie.claimed.array]


@pytest.fixture(scope="module", params=[{}, SWEEPS], ids=["returns", "sweeps"])
def pair(request: pytest.FixtureRequest) -> tuple[Episode, Episode]:
    return Episode(None, **request.param), Episode({LIAR: "ghost(ahead_m=15, start_s=0.3)"}, **request.param)


def own(seen: Observation) -> str:
    return digest(replace(seen, inbox=()))


def test_the_honest_world_stays_the_same_to_the_bit(pair: tuple[Episode, Episode]) -> None:
    honest, attacked = pair
    for before, after in zip(honest.seen, attacked.seen, strict=True):
        assert {name: own(seen) for name, seen in before.items()} == {name: own(seen) for name, seen in after.items()}
    for name in honest.env.possible_agents:
        sent = [each.identity for each in honest.messages(name, "rsu_0")]
        again = [each.identity for each in attacked.messages(name, "rsu_0")]
        assert (sent == again) == (name != LIAR)
    for told, truly in zip(honest.infos, attacked.infos, strict=True):
        for name in told:
            for key in ("ground_truth", "true_pose"):
                assert digest(told[name][key]) == digest(truly[name][key])


def test_the_liar_itself_reports_honestly(pair: tuple[Episode, Episode]) -> None:
    honest, attacked = pair
    assert [digest(each[LIAR]) for each in honest.reports] == [digest(each[LIAR]) for each in attacked.reports]
    assert [digest(each[VICTIM]) for each in honest.reports] != [digest(each[VICTIM]) for each in attacked.reports]


def test_a_ghost_stands_in_the_message_and_in_the_record(pair: tuple[Episode, Episode]) -> None:
    honest, attacked = pair
    truly, lied = ([decode_detections(each) for each in run.messages(LIAR)] for run in (honest, attacked))
    more = [len(two) - len(one) for one, two in zip(truly, lied, strict=True)]
    assert more == [0] * 3 + [1] * (len(more) - 3)
    for lie, row in attacked.claimed():
        (message,) = [each for each in attacked.messages(LIAR) if each.captured_ns == lie.time_ns]
        found = decode_detections(message).boxes.transform(message.pose.world_SE3_base)
        assert np.abs(found.array - row)[:, :6].max(axis=1).min() < 0.02
        assert (lie.agent, lie.attack, lie.senders, lie.against) == (LIAR, "ghost", (LIAR,), VICTIM)


def test_a_standing_ghost_stands_before_the_victim(pair: tuple[Episode, Episode]) -> None:
    _, attacked = pair
    rows = attacked.claimed()
    place = next(info[VICTIM]["true_pose"] for info, lies in zip(attacked.infos, attacked.lies, strict=True) if lies)
    first = rows[0][1]
    assert np.hypot(*(first[:2] - place[:2])) == pytest.approx(15, abs=0.5)
    assert all(np.allclose(row, first, atol=1e-9) for _, row in rows)
    assert {int(lie.id[0]) for lie, _ in rows} == {0}


def test_infos_name_the_attackers_where_the_truth_is_exposed() -> None:
    attacked = Episode({LIAR: "ghost(end_s=0.5)"}, frames=8)
    told = [info[VICTIM]["attackers"] for info in attacked.infos]
    assert told == [()] + [(LIAR,)] * 5 + [()] * 3
    hidden = Episode({LIAR: "ghost"}, frames=3, expose_ground_truth=False)
    assert all("attackers" not in info[VICTIM] and "lies" not in info[VICTIM] for info in hidden.infos)
    assert hidden.lies[-1]  # whoever makes the environment may score lies


def test_a_ghost_is_put_into_tracks_too_under_one_number() -> None:
    honest, attacked = Episode(None, "track_to_track"), Episode({LIAR: "ghost(motion=along)"}, "track_to_track")
    numbers = [
        set(decode_tracks(two).tracks.id.tolist()) - set(decode_tracks(one).tracks.id.tolist())
        for one, two in zip(honest.messages(LIAR), attacked.messages(LIAR), strict=True)
    ]
    assert len(set.union(*numbers)) == 1 and all(len(each) == 1 for each in numbers[1:])
    assert [digest(each[LIAR]) for each in honest.reports] == [digest(each[LIAR]) for each in attacked.reports]


@pytest.mark.parametrize(
    ("attacks", "error", "match"),
    [
        ({"cav_9": "ghost"}, UnknownNameError, "agent in attacks 'cav_9'"),
        ({LIAR: "gost"}, UnknownNameError, "attack 'gost'.*ghost"),
        ({LIAR: "ghost(ahed_m=3)"}, UnknownNameError, "parameter 'ahed_m'"),
        ({LIAR: "ghost(ahead_m=far)"}, InvalidValueError, "ahead_m must be"),
        ({LIAR: "ghost(against=cav_7)"}, UnknownNameError, "against of cav_1 'cav_7'"),
        ({LIAR: "ghost(start_s=5, end_s=1)"}, InvalidValueError, "end_s must be at least start_s 5, got 1"),
        ({LIAR: []}, InvalidValueError, "attacks must be a mapping"),
        ("ghost", InvalidValueError, "attacks must be a mapping of agents.*got 'ghost'"),
        (7, InvalidValueError, "attacks must be a mapping"),
    ],
)
def test_a_wrong_option_is_refused_when_the_environment_is_made(attacks: Any, error: type, match: str) -> None:
    with pytest.raises(error, match=match):
        coopsim.parallel_env("crossing", lidar=None, attacks=attacks)


def test_an_attack_that_cannot_lie_in_the_content_is_refused() -> None:
    with pytest.raises(InvalidValueError, match="'ghost' lies in detections or tracks, and cav_1 broadcasts 'points'"):
        coopsim.parallel_env("crossing", uplink="points", attacks={LIAR: "ghost"})


def test_agents_that_say_nothing_cannot_lie() -> None:
    attacked = Episode({LIAR: ["ghost", "flood", "pose_offset"]}, "no_fusion", frames=4)
    assert attacked.lies == [()] * 5 and attacked.env.channel_counts.sent == 0


def test_a_flood_is_bounded_and_what_is_dropped_is_counted() -> None:
    attacked = Episode({LIAR: "flood(messages=5000)"}, "no_fusion", frames=3, uplink_name="detections")
    counts = attacked.env.channel_counts
    assert max(len(seen[VICTIM].inbox) for seen in attacked.seen) <= 1000 + 3
    assert counts.dropped == 4 * 3 * 4000
    assert counts.sent == counts.delivered + counts.lost + counts.pending


def test_strangers_speak_for_a_liar() -> None:
    attacked = Episode({LIAR: ["ghost", "sybil(senders=2)"]}, frames=4)
    inbox = {message.sender: message for message in attacked.seen[-1][VICTIM].inbox}
    assert {"stranger_0", "stranger_1", LIAR} <= inbox.keys()
    assert set(attacked.infos[-1][VICTIM]["attackers"]) == {"stranger_0", "stranger_1", LIAR}
    row = attacked.claimed()[-1][1]
    for sender in ("stranger_0", "stranger_1"):
        found = decode_detections(inbox[sender]).boxes.transform(inbox[sender].pose.world_SE3_base)
        assert np.hypot(*(found.center[:, :2] - row[:2]).T).min() < 0.05
    assert np.hypot(*(inbox[LIAR].pose.xyz_yaw - inbox["stranger_0"].pose.xyz_yaw)[:2]) == pytest.approx(6)


def test_a_text_means_the_same_as_a_mapping() -> None:
    text = Episode("cav_1=ghost(ahead_m=12) + rsu_0=ghost(start_s=0.2)", frames=5)
    mapping = Episode({LIAR: ["ghost(ahead_m=12)"], "rsu_0": "ghost(start_s=0.2)"}, frames=5)
    assert [digest(each) for each in text.reports] == [digest(each) for each in mapping.reports]
    assert {lie.agent for lie in text.lies[-1]} == {LIAR, "rsu_0"}


def _meant(attack: str, **options: Any) -> list[tuple[str | None, bytes]]:
    """Play a situation, in which `cav_0` is driven and other cars are nearer to the liar; return whom lies mean."""
    policy = coopsim.make_policy("late_fusion")
    env = coopsim.parallel_env(
        "queue_end", lidar=None, penetration=1.0, uplink=policy, attacks={"cav_2": attack}, max_cycles=8, **options
    )
    observations, _ = env.reset(seed=1000)
    policy.reset(env.agent_specs, seed=1000)
    lies = [*env.episode.lies]
    while env.agents:
        observations, *_ = env.step(policy.act(observations))
        lies += env.episode.lies
    return [(lie.against, lie.claimed.array.tobytes()) for lie in lies]


def test_a_lie_means_the_driven_car_unless_it_is_told_otherwise() -> None:
    aimed = _meant("ghost")
    assert aimed and {name for name, _ in aimed} == {"cav_0"}
    assert aimed == _meant("ghost(against=cav_0)")
    nearest = _meant("ghost", control="traffic", driven_agents=None, ends_on_crash=False)
    assert nearest and "cav_0" not in {name for name, _ in nearest}, "without a driven car: the nearest"
