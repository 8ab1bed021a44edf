"""White-box attacks on features: they reach their goal on the network, within their budget and around their target."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from lying_car import begin
from representatives import all_of

import coopsim
from coopsim.comms.envelope import decode_features
from coopsim.errors import InvalidValueError

torch = pytest.importorskip("torch")

EPS, ROUNDING = 0.5, 0.06
"""Budget, and the codec's rounding of both maps: 8 bits of each channel's range."""


def play(attack: str | None) -> tuple[Any, list[Any], list[Any]]:
    """Return the policy, the liar's maps, and its lies, by frame."""
    policy, env, form, packed = begin("attfuse", attack, 3, lidar_columns=256, vehicles=6, max_cycles=3)
    maps, lies = [], []
    while True:
        inbox = form.unpack_all(packed)["cav_0"].inbox
        maps += [(each, decode_features(each)) for each in inbox if each.sender == "cav_1"]
        lies.append(env.lies)
        if not env.agents:
            return policy, maps, lies
        packed, *_ = env.step(policy.act(packed))


@pytest.fixture(scope="module")
def honest() -> Any:
    return play(None)


@pytest.mark.parametrize("name", all_of(["fgsm", "bim", "pgd", "cw"], "pgd"))
def test_the_network_sees_what_the_attacker_wants(honest: Any, name: str) -> None:
    policy, maps, _ = honest
    _, lied, lies = play(f"{name}(eps={EPS}, ahead_m=10)")
    rises = []
    for (message, before), (_, after), noted in zip(maps[1:], lied[1:], lies[1:], strict=True):
        change = np.abs(after.values - before.values)
        assert ROUNDING < change.max() <= EPS + ROUNDING
        (lie,) = noted
        place = lie.claimed.center[0, :2] - message.pose.xyz_yaw[:2]
        far = np.abs(before.grid.cell_centers() - place).max(axis=2) > 5.0 + before.grid.cell_m
        assert change[:, far].max() <= ROUNDING
        cell = np.unravel_index(np.argmin(np.hypot(*(before.grid.cell_centers() - place).T).T), far.shape)
        heat = [float(policy.heat(torch.tensor(each.values))[0][cell]) for each in (before, after)]
        rises.append(heat[1] - heat[0])
    assert min(rises) > 0.5


def test_removal_cools_the_objects_that_the_attacker_sees(honest: Any) -> None:
    policy, maps, _ = honest
    _, lied, lies = play(f"pgd(goal=remove, eps={EPS})")
    falls = []
    for (message, before), (_, after), noted in zip(maps[1:], lied[1:], lies[1:], strict=True):
        for center in noted[0].denied.center if noted else ():
            place = center[:2] - message.pose.xyz_yaw[:2]
            near = np.abs(before.grid.cell_centers() - place).max(axis=2) <= before.grid.cell_m
            if near.any():
                one, two = (policy.heat(torch.tensor(each.values)).amax(0)[near] for each in (before, after))
                falls.append(float((one - two).mean()))
    assert falls and np.mean(falls) > 0.2


def test_an_attack_by_gradients_needs_a_policy_with_maps_or_queries() -> None:
    with pytest.raises(InvalidValueError, match="'pgd' needs the weights of a policy on maps of features or"):
        coopsim.parallel_env("crossing", uplink=coopsim.make_policy("late_fusion"), attacks={"cav_1": "pgd"})


def test_an_agent_that_says_nothing_needs_no_weights_to_be_attacked() -> None:
    alone = coopsim.evaluate("no_fusion", "crossing", seed=0, max_cycles=3, lidar=None)
    attacked = coopsim.evaluate("no_fusion", "crossing", seed=0, max_cycles=3, lidar=None, attacks={"cav_1": "pgd"})
    assert attacked.score["sAMOTA"] == alone.score["sAMOTA"]
