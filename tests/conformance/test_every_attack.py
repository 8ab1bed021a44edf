"""Every registered attack passes the check, and the check finds what is wrong with others."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache, partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from representatives import except_for

from coopsim import Attack, AttackerView
from coopsim.attacks import ATTACKS, make_attack
from coopsim.testing import attack_checks, check_attack
from coopsim.types import Detections, Message

MINE = """
from dataclasses import dataclass
import coopsim

@dataclass(kw_only=True)
class Mine(coopsim.Attack):
    keep: int = 0
    def detect(self, view, detections):
        view.deny(detections.boxes[self.keep:])
        return detections[:self.keep]
"""


BY_GRADIENTS = {"bim", "cw", "fgsm", "pgd"}


honest = cache(partial(attack_checks._play, None))
"""Episodes in which nobody lies, which checks of all attacks compare with theirs."""


@pytest.mark.parametrize("name", except_for(ATTACKS.names(), BY_GRADIENTS))
def test_every_registered_attack_keeps_the_rules(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    play = attack_checks._play
    monkeypatch.setattr(attack_checks, "_play", lambda lying, of: play(lying, of) if lying else honest(of))
    if ATTACKS.get(name).knowledge == "weights":
        pytest.importorskip("torch")
    spec = {"flood": "flood(messages=5)", "overload": "overload(objects=20)", "replay": "replay(delay_s=0.1)"}
    check_attack(spec.get(name, name))


def test_an_attack_by_gradients_keeps_the_rules_on_maps_of_features(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of a tiny network; on those that ship, and on queries, `make check-long` tries it among all others."""
    pytest.importorskip("torch")
    from tiny_networks import learned

    settings = ", ".join(f"{name}={value!r}" for name, value in learned("attfuse").items())
    monkeypatch.setattr(attack_checks, "_POLICIES", {"features": f"attfuse({settings})"})
    monkeypatch.setattr(attack_checks, "_FRAMES", 4)
    check_attack("fgsm")


@dataclass(kw_only=True)
class Silent(Attack):
    def detect(self, view: AttackerView, detections: Detections) -> Detections:
        return detections[:0]  # and notes nothing


@dataclass(kw_only=True)
class Random(Attack):
    def send(self, view: AttackerView, message: Message) -> Message:
        return replace(message, captured_ns=int(np.random.default_rng().integers(10**9)))


@dataclass(kw_only=True)
class Impostor(Attack):
    def further(self, view: AttackerView, message: Message | None) -> Sequence[Message]:
        return () if message is None else [replace(message, sender="rsu_0")]


@dataclass(kw_only=True)
class Idle(Attack):
    pass


@pytest.mark.parametrize(
    ("attack", "match"),
    [
        (Silent, "must note that the message of cav_1 lies"),
        (Random, "must do the same again"),
        (Impostor, "must change its agent's messages only"),
        (Idle, "must override a hook"),
        (Silent(), "must be a class or a name"),
    ],
)
def test_the_check_finds_what_is_wrong(attack: Any, match: str) -> None:
    with pytest.raises(AssertionError, match=match):
        check_attack(attack)


def test_an_attack_in_a_file_is_found_by_its_place(tmp_path: Path) -> None:
    path = tmp_path / "mine.py"
    path.write_text(MINE)
    assert make_attack(f"{path}:Mine(keep=2)").keep == 2  # type: ignore[attr-defined]
    check_attack(f"{path}:Mine(keep=2)")
