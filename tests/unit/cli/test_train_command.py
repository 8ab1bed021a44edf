"""`coopsim train`: what it prints and writes, what it says of mistakes, and that it goes on after Ctrl-C."""

from __future__ import annotations

import json
import os
import signal
from pathlib import Path
from typing import Any

import pytest
from synthetic_clips import SyntheticClips

from coopsim.cli import main
from coopsim.cli.arguments import INTERRUPTED, USER_ERROR
from coopsim.learn import train as train_module

RECIPE = {
    "network": {"channels": [8, 8, 8], "layers": [0, 0, 0], "features": 8},
    "samples": {"reach_m": 19.2, "crop_cells": 32},
    "batch": 2,
    "block": 1,
}


@pytest.fixture
def recipe(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> str:
    monkeypatch.setattr(train_module, "clips_of_recipe", lambda *_: SyntheticClips())
    path = tmp_path / "mine.yaml"
    path.write_text(json.dumps(RECIPE))
    return str(path)


def test_it_writes_all_files_and_goes_on_after_ctrl_c(
    recipe: str, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    out = tmp_path / "out"
    command = ["train", recipe, "--out", str(out), "--steps", "6", "--workers", "0", "--option", "lr=0.01"]
    find, calls = train_module.TrainLoop._take_step, list[int]()

    def interrupted(*arguments: Any) -> Any:
        calls.append(1)
        if len(calls) == 3:
            os.kill(os.getpid(), signal.SIGINT)
        return find(*arguments)

    monkeypatch.setattr(train_module.TrainLoop, "_take_step", interrupted)
    assert main(command) == INTERRUPTED
    assert "the same command goes on from there" in capsys.readouterr().err
    assert main(command) == 0 and len(calls) == 6
    printed = capsys.readouterr().out
    for name in ("mine.safetensors", "card.json", "curves.svg"):
        assert f"written: {out / name}" in printed and (out / name).exists()
    card = json.loads((out / "card.json").read_text())
    assert (card["steps"], card["recipe"]["lr"]) == (6, 0.01)
    assert card["command"] == "coopsim train mine.yaml --out mine --seed 0"


def test_ctrl_c_before_the_first_step_promises_nothing(
    recipe: str, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def interrupted(*_: Any) -> Any:
        raise KeyboardInterrupt

    monkeypatch.setattr(train_module, "clips_of_recipe", interrupted)
    assert main(["train", recipe, "--out", str(tmp_path / "out")]) == INTERRUPTED
    assert "interrupted; there is no state yet" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--option", "learning=2"], "unknown recipe option 'learning'"),
        (["--option", "steps=2"], "steps is not an option here: use --steps"),
        (["--option", "lr=-1"], "lr must be a finite number > 0, got -1"),
        (["--device", "abacus"], "device must be auto or one that is here (cpu"),
        (["--option", "samples.reach=2"], "unknown samples option 'reach'"),
        (["--option", "network.feature=2"], "unknown network option 'feature'"),
    ],
)
def test_mistakes_are_one_line(
    arguments: list[str], message: str, recipe: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["train", recipe, "--out", str(tmp_path / "out"), *arguments]) == USER_ERROR
    assert message in capsys.readouterr().err
