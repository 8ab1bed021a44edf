"""Every registered defence passes the check, the check finds what is wrong with others, and policies obey."""

from __future__ import annotations

from copy import copy
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from representatives import all_of

import coopsim
from coopsim import Defense, Reception, Trust
from coopsim.cli import main
from coopsim.errors import DefenseError, InvalidValueError, UnknownNameError
from coopsim.interfaces.defense import DEFENSES, make_defense
from coopsim.testing import check_defense, defense_checks

SENSORS: dict[str, Any] = {"lidar": "VLP-16", "lidar_columns": 256}
QUICK: dict[str, Any] = {"seed": 1, "max_cycles": 5, "vehicles": 8, "lidar": None}


heard = cache(defense_checks._receptions)
"""What every check lets a defence judge. The one that writes into it writes into one frame's own observation."""


@pytest.fixture(autouse=True)
def recorded_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let all checks share one episode: it has no attack and no defence in it."""
    monkeypatch.setattr(defense_checks, "_receptions", lambda: [fresh(each) for each in heard()])


def fresh(reception: Reception) -> Reception:
    """Return a reception whose fields a defence may overwrite; it shares its arrays, which checks hold unchanged."""
    return replace(reception, observation=copy(reception.observation), claims=list(map(copy, reception.claims)))


@pytest.mark.parametrize("name", DEFENSES.names())
def test_every_registered_defense_keeps_the_rules(name: str) -> None:
    check_defense(name)


class Believes(Defense):
    def judge(self, reception: Reception) -> Trust:
        return Trust({})


class Doubts(Defense):
    def judge(self, reception: Reception) -> Trust:
        return Trust(dict.fromkeys(reception.senders, 0.0))


class DoubtsObjects(Defense):
    def judge(self, reception: Reception) -> Trust:
        return Trust({}, [np.zeros(len(claim.detections)) for claim in reception.claims])


class Random(Defense):
    def judge(self, reception: Reception) -> Trust:
        return Trust({name: np.random.default_rng().random() for name in reception.senders})


class Shares(Defense):
    frames = 0

    def judge(self, reception: Reception) -> Trust:
        Shares.frames += 1
        return Trust(dict.fromkeys(reception.senders, 0.5 + 1 / (2 + Shares.frames)))


class TooSure(Defense):
    def judge(self, reception: Reception) -> Trust:
        return Trust(dict.fromkeys(reception.senders, 1.5))


class Undefined(Defense):
    def judge(self, reception: Reception) -> Trust:
        return Trust({}, [np.full(len(claim.detections), np.nan) for claim in reception.claims])


class Short(Defense):
    def judge(self, reception: Reception) -> Trust:
        return Trust({}, [])


class Writes(Defense):
    def judge(self, reception: Reception) -> Trust:
        object.__setattr__(reception.observation, "time_ns", 0)
        return Trust({})


class Raises(Defense):
    def judge(self, reception: Reception) -> Trust:
        raise ValueError("no idea")


class Text(Defense):
    def judge(self, reception: Reception) -> Any:
        return "all"


ONE = Believes()


@pytest.mark.parametrize(
    ("defense", "match"),
    [
        (Doubts, "must believe senders that agree"),
        (Random, "must return the same for the same episode"),
        (Shares, "must share no state|must return the same"),
        (TooSure, r"trust in senders must be in \[0, 1\]"),
        (Undefined, r"trust in objects must be in \[0, 1\]"),
        (Short, "must be an array for each claim"),
        (Writes, "must leave its input as it is"),
        (Raises, "must return Trust, and raised ValueError: no idea"),
        (Text, "must answer Trust, got str"),
        (ONE, "must be a class or a name"),
        (lambda: ONE, "must make a new defense for each receiver"),
    ],
)
def test_the_check_finds_what_is_wrong(defense: Any, match: str) -> None:
    with pytest.raises(AssertionError, match=match):
        check_defense(defense)


def test_a_defense_that_believes_nobody_passes_if_it_may() -> None:
    check_defense(Doubts, believes_honest=False)


POLICIES = [
    name
    for name in coopsim.POLICIES.names()
    if coopsim.POLICIES.get(name).needs.uplink != "none" and not coopsim.POLICIES.get(name).needs.lidar
]


@pytest.mark.parametrize("name", all_of(POLICIES, "coop_fuse", "dino_codt_tracking", "late_fusion", "track_to_track"))
def test_policies_of_boxes_believe_whom_their_defense_believes(name: str) -> None:
    """A defence that believes all changes no bit; with one that believes nobody, senders might as well be silent."""
    plain = coopsim.evaluate(name, "crossing", **QUICK).score
    believing = coopsim.evaluate(coopsim.make_policy(name, defense=Believes), "crossing", **QUICK).score
    assert believing["sAMOTA"] == plain["sAMOTA"] and believing["MOTP"] == plain["MOTP"]
    alone = coopsim.evaluate(name, "crossing", **QUICK, loss=1.0).score
    assert alone["sAMOTA"] != pytest.approx(plain["sAMOTA"]), "messages make a difference"
    for defense in (Doubts, DoubtsObjects):
        doubting = coopsim.evaluate(coopsim.make_policy(name, defense=defense), "crossing", **QUICK).score
        assert doubting["sAMOTA"] == pytest.approx(alone["sAMOTA"]), defense


def test_trust_is_there_for_every_sender_that_was_heard() -> None:
    policy = coopsim.make_policy("late_fusion", defense="plausibility")
    env = coopsim.parallel_env("crossing", lidar=None, max_cycles=5, uplink=policy)
    observations, _ = env.reset(seed=0)
    policy.reset(env.agent_specs)
    while env.agents:
        observations, *_ = env.step(policy.act(observations))
    for agent in env.possible_agents:
        trust = policy.trust(agent)
        assert set(trust) == set(env.possible_agents) - {agent}
        assert all(value > 0.5 for value in trust.values())
    assert coopsim.make_policy("late_fusion").trust("cav_0") == {}


def test_oracle_is_told_who_lies_and_nobody_else_is() -> None:
    told: list[frozenset[str] | None] = []

    class Spy(Believes):
        def judge(self, reception: Reception) -> Trust:
            told.append(reception.attackers)
            return Trust({})

    class Told(Spy):
        needs_truth = True

    for defense, expected in ((Spy, None), (Told, frozenset())):
        told.clear()
        policy = coopsim.make_policy("late_fusion", defense=defense)
        assert policy.needs.truth is (expected is not None)
        coopsim.evaluate(policy, "crossing", **QUICK)
        assert set(told) == {expected}
    assert coopsim.evaluate("late_fusion(defense=oracle)", "crossing", **QUICK).bound


def test_no_defense_but_the_oracle_learns_who_lies() -> None:
    """Trust is the same whoever is said to lie in the truth that infos hold."""
    env = coopsim.parallel_env(
        "crossing", max_cycles=6, vehicles=8, expose_ground_truth=True, attacks={"cav_1": "ghost"}, **SENSORS
    )
    policies = {name: [coopsim.make_policy("late_fusion", defense=name) for _ in range(2)] for name in DEFENSES.names()}
    observations, infos = env.reset(seed=1)
    for both in policies.values():
        for policy in both:
            policy.reset(env.agent_specs)
    differing, lying = set(), []
    while env.agents:
        lying.append({infos[agent]["attackers"] for agent in env.agents})
        shuffled = {agent: {**info, "attackers": ("cav_2",)} for agent, info in infos.items()}
        for name, (told, misled) in policies.items():
            actions = told.act(observations, infos)
            misled.act(observations, shuffled)
            if any(told.trust(agent) != misled.trust(agent) for agent in env.agents):
                differing.add(name)
        observations, _, _, _, infos = env.step(actions)
    assert lying[0] == {()}, "before it has heard of a victim it is honest"
    assert all(each == {("cav_1",)} for each in lying[1:])
    assert differing == {"oracle"}
    assert policies["oracle"][0].trust("cav_0")["cav_1"] == 0


def test_a_ghost_in_plain_sight_is_left_out_and_its_sender_found() -> None:
    policies = ("late_fusion", "late_fusion(defense=consistency)", "late_fusion(defense=oracle)")
    options: dict[str, Any] = {"seed": 502, "max_cycles": 22, "attacks": {"cav_1": "ghost"}, **SENSORS}
    plain, consistency, oracle = (coopsim.evaluate(each, "crossing", **options).score for each in policies)
    assert consistency["sAMOTA"] > plain["sAMOTA"]
    assert consistency["attacker_FPR"] < 5 < consistency["attacker_TPR"]
    assert oracle["attacker_TPR"] == oracle["attacker_AUC"] == 100
    assert oracle["frames_until_found"] == 0


def test_errors_name_what_was_wrong(tmp_path: Path) -> None:
    with pytest.raises(UnknownNameError, match=r"defense 'plausible'.*plausibility"):
        coopsim.make_policy("late_fusion", defense="plausible")
    with pytest.raises(InvalidValueError, match="range_m"):
        coopsim.make_policy("late_fusion", defense="plausibility(range_m=-1)")
    with pytest.raises(InvalidValueError, match="defense must be None for a policy that reads no message"):
        coopsim.make_policy("no_fusion", defense="plausibility")
    with pytest.raises(InvalidValueError, match="defense must be a name"):
        coopsim.make_policy("late_fusion", defense=3)
    with pytest.raises(DefenseError, match="Raises of cav_0 raised ValueError: no idea"):
        coopsim.evaluate(coopsim.make_policy("late_fusion", defense=Raises), "crossing", **QUICK)
    path = tmp_path / "mine.py"
    path.write_text("import coopsim\nclass Mine(coopsim.Defense):\n    def judge(self, r): return coopsim.Trust({})\n")
    assert isinstance(make_defense(f"{path}:Mine"), Defense)
    spec = f'late_fusion(defense="{path}:Mine")'
    assert coopsim.evaluate(spec, "crossing", **QUICK).counts["receptions judged"] == 5 * 4


def test_defenses_are_listed(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["list"]) == 0
    assert "plausibility" in next(line for line in capsys.readouterr().out.splitlines() if line.startswith("defenses:"))
