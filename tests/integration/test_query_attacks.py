"""White-box attacks on queries: they reach their goal on the network, within their budget and at their target."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
import pytest
from lying_car import begin
from representatives import all_of

import coopsim
from coopsim.comms.envelope import decode_queries
from coopsim.errors import InvalidValueError

torch = pytest.importorskip("torch")

EPS = 2.0
"""Budget: about as large as the numbers of queries."""

ROUNDING = 0.02
"""The codec's rounding of a difference: float16 has steps of 1/256 from 4 to 8."""

WEAK = 1e-6
"""Budget of an attacker that changes nothing: it does what takes no gradient."""


@cache
def play(attack: str | None, name: str = "cooptrack", ahead_m: float = 20.0) -> list[dict[str, Any]]:
    """Return of each frame the liar's `message`, its `content`, what it `shows` the receiver, the `lies`, and the
    receiver's reported `places`.
    """
    if attack is not None:
        attack = attack.replace(")", f", ahead_m={ahead_m})")
    policy, env, form, packed = begin(name, attack, 1, lidar_columns=512, vehicles=12, max_cycles=4)
    frames = []
    while env.agents:
        seen = form.unpack_all(packed)["cav_0"]
        (message,) = (each for each in seen.inbox if each.sender == "cav_1")
        content, pose = decode_queries(message), seen.pose
        apart_m = message.pose.xyz_yaw[:3] - pose.xyz_yaw[:3]
        shows, _ = policy.shown(content, torch.tensor(content.feature), float(message.pose.xyz_yaw[3]), apart_m)
        actions = policy.act(packed)
        places = pose.world_SE3_base.apply(np.asarray(actions["cav_0"]["tracks"]["box"])[:, :3])[:, :2]
        frames.append(
            {"message": message, "content": content, "shows": shows.sigmoid().numpy(), "lies": env.episode.lies}
            | {"places": places}
        )
        packed, *_ = env.step(actions)
    env.close()
    return frames


def spare(frame: dict[str, Any]) -> int:
    """Return the row of the spoofed object."""
    (lie,) = frame["lies"]
    placed = frame["content"].boxes.transform(frame["message"].pose.world_SE3_base)
    apart_m = np.linalg.norm(placed.center - lie.claimed.center, axis=1)
    assert apart_m.min() < 0.01
    return int(apart_m.argmin())


def rises(attack: str, name: str = "cooptrack") -> list[float]:
    """Return how much surer the network is of a car at the target than without a change, by frame."""
    with_it, without = (play(each, name)[1:] for each in (attack, f"fgsm(eps={WEAK})"))
    return [
        float(one["shows"][spare(one), 0] - other["shows"][spare(other), 0])
        for one, other in zip(with_it, without, strict=True)
    ]


FGSM, BIM, PGD, CW = f"fgsm(eps={EPS})", f"bim(eps={EPS})", f"pgd(eps={EPS})", f"cw(eps={EPS}, weight=1000.0)"


@pytest.mark.heavy("an attack on a network that ships")
@pytest.mark.parametrize("attack", all_of([FGSM, BIM, PGD, CW], FGSM))
def test_a_spoofed_query_looks_like_a_car_and_the_others_stay(attack: str) -> None:
    for before, after in zip(play(None)[1:], play(attack)[1:], strict=True):
        honest, lied, row = before["content"], after["content"], spare(after)
        others = np.delete(np.arange(len(lied)), row)
        assert len(lied) == len(honest) + 1 and lied.label[row] == 0
        assert sorted(lied.feature[others].tolist()) == sorted(honest.feature.tolist())
        surest = int(np.argmax(honest.score))
        assert lied.score[row] == honest.score[surest]
        change = np.abs(lied.feature[row] - honest.feature[surest])[:-2]
        assert ROUNDING < change.max() <= EPS + ROUNDING
    assert min(rises(attack)) > 0.05


@pytest.mark.long  # attacks of ten steps a frame
def test_a_larger_budget_makes_the_network_surer_until_the_receiver_reports_the_ghost() -> None:
    assert np.mean(rises(f"pgd(eps={EPS})")) > np.mean(rises("pgd(eps=0.5)")) + 0.1

    def reported(attack: str | None) -> int:
        """Return the number of frames in which the receiver reports a track at the attacker's target."""
        targets = [each["lies"][0].claimed.center[:, :2] for each in play(f"pgd(eps={EPS})")[1:]]
        frames = zip(play(attack)[1:], targets, strict=True)
        return sum(bool((np.linalg.norm(each["places"] - target, axis=1) < 2.0).any()) for each, target in frames)

    assert reported(f"pgd(eps={EPS})") == 3 and reported(None) == 0


def test_removal_makes_the_network_doubt_the_queries_around_the_target_and_changes_no_other() -> None:
    for before, after in zip(play(None)[1:], play(f"pgd(goal=remove, eps={EPS})")[1:], strict=True):
        honest, lied, (lie,) = before["content"], after["content"], after["lies"]
        assert np.array_equal(honest.boxes.array, lied.boxes.array) and np.array_equal(honest.score, lied.score)
        placed = honest.boxes.transform(before["message"].pose.world_SE3_base).center
        denied = (np.linalg.norm(placed[:, None] - lie.denied.center, axis=2) < 0.01).any(axis=1)
        assert denied.sum() == len(lie.denied) > 1
        change = np.abs(lied.feature - honest.feature)
        assert change[~denied].max() == 0.0 and ROUNDING < change[denied].max() <= EPS + ROUNDING
        fall = before["shows"].max(axis=1) - after["shows"].max(axis=1)
        assert fall[denied].min() > 0.0 and fall[denied].mean() > 0.05


@pytest.mark.long
def test_each_frame_goes_on_from_the_last_ones_change() -> None:
    """One step of an optimizer reaches farther where others went before it."""

    def change(attack: str) -> float:
        honest, lied = play(None)[3]["content"], play(attack)[3]
        at_start = honest.feature[int(np.argmax(honest.score))]
        return float(np.abs(lied["content"].feature[spare(lied)] - at_start)[:-2].max())

    assert change("cw(steps=1, weight=1000.0)") > 1.5 * change("cw(steps=1, weight=1000.0, start_s=0.25)")


@pytest.mark.long
def test_queries_that_are_decoded_by_the_receiver_are_attacked_too() -> None:
    assert min(rises(f"pgd(eps={EPS})", "univ2x")) > 0.05


def test_knowledge_of_comparisons_is_refused_before_an_episode_begins() -> None:
    with pytest.raises(InvalidValueError, match="'pgd' lies with these parameters in features, and cav_1 broadcasts"):
        coopsim.parallel_env(
            "crossing", uplink=coopsim.make_policy("cooptrack"), attacks={"cav_1": "pgd(knows=agreement)"}
        )
