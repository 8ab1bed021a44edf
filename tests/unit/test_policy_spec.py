"""Policies as users write them: what is read, and what a slip is told."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

import coopsim
from coopsim.agents.boxes import LateFusion
from coopsim.catalog import PolicySpec
from coopsim.config.spec import split_specs
from coopsim.errors import CoopsimError, InvalidValueError, UnknownNameError

MINE = """
import numpy as np
import coopsim
from coopsim.geometry.boxes import Boxes3D
from coopsim.types import Tracks

class Blind(coopsim.Policy):
    needs = coopsim.Needs(uplink="none")

    def __init__(self, patience: int = 1) -> None:
        if patience < 0:
            raise RuntimeError("no patience")
        self.patience = patience

    def track(self, agent, observation):
        none = np.zeros(0, dtype=int)
        return Tracks(none, Boxes3D.empty(), np.zeros((0, 2)), np.zeros(0), none)

class Half(coopsim.Policy):
    pass
"""


@pytest.mark.parametrize(
    ("written", "spelled", "parameters"),
    [
        ("late_fusion", "late_fusion", {}),
        (" late_fusion() ", "late_fusion", {}),
        (
            "late_fusion( delayed = replay,hits=2, gate=-.5)",
            "late_fusion(delayed=replay, gate=-0.5, hits=2)",
            {"delayed": "replay", "hits": 2, "gate": -0.5},
        ),
        ("a(b='c d', e=[1, f], g=None)", "a(b='c d', e=[1, f], g=None)", {"b": "c d", "e": [1, "f"], "g": None}),
        ("a(b='True', c=True)", "a(b='True', c=True)", {"b": "True", "c": True}),
        ("mypackage.module:Mine(x=1)", "mypackage.module:Mine(x=1)", {"x": 1}),
    ],
)
def test_one_spelling_for_each_policy(written: str, spelled: str, parameters: dict[str, object]) -> None:
    spec = PolicySpec.parse(written)
    assert spec.text == spelled and dict(spec.parameters) == parameters
    assert PolicySpec.parse(spelled) == spec


def test_commas_in_brackets_divide_no_policies() -> None:
    assert split_specs("a(b=1,c=[2,3]), d ,e") == ("a(b=1,c=[2,3])", "d", "e")


def test_a_name_a_module_and_a_file_are_made(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    assert isinstance(PolicySpec.parse("late_fusion(delayed=replay)").make(), LateFusion)
    assert isinstance(PolicySpec.parse("coopsim.agents.boxes:LateFusion").make(), LateFusion)
    (tmp_path / "mine.py").write_text(MINE)
    made = PolicySpec.parse(f"{tmp_path}/mine.py:Blind(patience=3)").make()
    assert type(made).__name__ == "Blind" and made.patience == 3  # type: ignore[attr-defined]
    monkeypatch.syspath_prepend(tmp_path)
    assert type(PolicySpec.parse("mine:Blind").make()) is sys.modules["mine"].Blind


def test_a_file_is_what_it_was_when_it_was_read(tmp_path: Path) -> None:
    path = tmp_path / "mine.py"
    path.write_text(MINE)
    spec = PolicySpec.parse(f"{path}:Blind")
    path.write_text("")
    assert spec.policy_class().__name__ == "Blind"
    with pytest.raises(UnknownNameError, match="'Blind'"):
        PolicySpec.parse(f"{path}:Blind").make()


@pytest.mark.parametrize(
    ("written", "error", "message"),
    [
        ("late_fusoin", UnknownNameError, "Did you mean 'late_fusion'"),
        ("late_fusion(delay=replay)", UnknownNameError, "unknown parameter 'delay' of policy 'late_fusion'.*'delayed'"),
        ("late_fusion(delayed=reply)", CoopsimError, "Did you mean 'replay'"),
        ("late_fusion(replay)", InvalidValueError, "parameters must be name=value"),
        ("late_fusion(delayed=a+b)", InvalidValueError, "parameters must be name=value"),
        ("late_fusion(delayed=open('x'))", InvalidValueError, "parameters must be name=value"),
        ("late_fusion(delayed={{'b', 'a'}})", InvalidValueError, "parameters must be name=value"),
        ("late_fusion(", InvalidValueError, r"must be name, name\(parameter=value"),
        ("", InvalidValueError, r"must be name, name\(parameter=value"),
        ("nunpy:X", InvalidValueError, "there is no module 'nunpy'. Did you mean.*'numpy'"),
        ("coopsim.agents.boxse:X", InvalidValueError, "Did you mean 'coopsim.agents.boxes'"),
        ("coopsim.agents.boxes:LateFusio", UnknownNameError, "Did you mean 'LateFusion'"),
        ("mine.py", InvalidValueError, "must name the class in that file, as mine.py:MyTracker"),
        ("antigravity:1", InvalidValueError, "must name a class, as module:Class"),
        ("numpy:zeros", InvalidValueError, "must be a class derived from coopsim.Policy"),
        ("nowhere/mine.py:Blind", InvalidValueError, "cannot read nowhere/mine.py: No such file"),
        ("{folder}/mine.py:Blnd", UnknownNameError, "Did you mean 'Blind'"),
        ("{folder}/mine.py:Half", InvalidValueError, "its class has no track"),
        ("{folder}/mine.py:Blind(patience=-1)", InvalidValueError, "cannot be made: RuntimeError: no patience"),
        ("{folder}/broken.py:X", InvalidValueError, "broken.py cannot be loaded: SyntaxError"),
    ],
)
def test_a_slip_is_told(written: str, error: type[CoopsimError], message: str, tmp_path: Path) -> None:
    (tmp_path / "mine.py").write_text(MINE)
    (tmp_path / "broken.py").write_text("def")
    with pytest.raises(error, match=message):
        PolicySpec.parse(written.format(folder=tmp_path)).make()


def test_make_policy_takes_a_spec() -> None:
    """As `evaluate` and the commands do."""
    assert repr(coopsim.make_policy("late_fusion(hits=2)", age=3)) == repr(LateFusion(hits=2, age=3))
    with pytest.raises(InvalidValueError, match=r"hits must be given once, got 'late_fusion\(hits=2\)' and hits=3"):
        coopsim.make_policy("late_fusion(hits=2)", hits=3)
    with pytest.raises(UnknownNameError, match=r"unknown policy 'late_fusoin'. Did you mean 'late_fusion'"):
        coopsim.make_policy("late_fusoin(hits=2)")
