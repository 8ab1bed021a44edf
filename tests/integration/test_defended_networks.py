"""Defences of policies with networks: bits without an effect, silence of senders that are not believed, and passes."""

from __future__ import annotations

from typing import Any

import pytest
from representatives import all_of

import coopsim
from coopsim import Defense, Reception, Trust

pytest.importorskip("torch")

SHORT: dict[str, Any] = {"seed": 1, "max_cycles": 2, "vehicles": 6, "lidar": "VLP-16", "lidar_columns": 256}


class Believes(Defense):
    def judge(self, reception: Reception) -> Trust:
        return Trust({})


class Doubts(Defense):
    def judge(self, reception: Reception) -> Trust:
        return Trust(dict.fromkeys(reception.senders, 0.0))


class Asks(Defense):
    """A defence that asks what the policy finds alone and with all, and believes all."""

    def judge(self, reception: Reception) -> Trust:
        reception.find(reception.senders)
        assert reception.find(()) is reception.own
        return Trust({})


@pytest.mark.heavy("five episodes with a network that ships")
@pytest.mark.parametrize("name", all_of(["attfuse", "cooptrack", "early", "vic_integrated"], "attfuse"))
def test_networks_believe_whom_their_defense_believes(name: str) -> None:
    def score(defense: Any = None, **options: Any) -> dict[str, float]:
        policy = coopsim.make_policy(name, defense=defense)
        return dict(coopsim.evaluate(policy, "crossing", **SHORT, **options).score.values)

    plain = score()
    for defense in (Believes, Asks):
        assert {key: value for key, value in score(defense).items() if key in plain} == pytest.approx(
            plain, nan_ok=True
        )
    doubting, alone = score(Doubts), score(loss=1.0)
    assert doubting["sAMOTA"] == alone["sAMOTA"] and doubting["AP3D@0.5"] == alone["AP3D@0.5"]
