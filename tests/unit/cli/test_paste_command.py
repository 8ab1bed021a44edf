"""`coopsim paste`: what it writes and prints, and what it says of mistakes."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from bare_sweeps import write_bare

from coopsim.cli import main
from coopsim.cli.arguments import USER_ERROR


def test_it_writes_frames_and_a_picture(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    bare, out = write_bare(tmp_path / "bare"), tmp_path / "out"
    assert main(["paste", str(bare), "--out", str(out), "--actors", "5", "--reach-m", "22", "--doubt", "0.3"]) == 0
    (path,) = out.glob("*.npz")
    with np.load(path) as frame:
        assert 0 < len(frame["boxes"]) <= 5 and frame["doubtful"].shape[1:] == (7,) and len(frame["names"])
    assert (out / "paste.png").stat().st_size > 10_000
    assert f"{len(np.load(path)['boxes'])} actors in 1 frames" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("changed", "said"),
    [
        (["--actors", "many"], "must be a count or two, as 4-12, got 'many'"),
        (["--actors", "7-4"], "actors must be"),
        (["--detector", "none"], "unknown weights 'none'"),
        (["--doubt", "2"], "least_score must be"),
        (["--reach-m", "500"], "reach_m must be"),
    ],
)
def test_mistakes_end_in_one_line(
    tmp_path: Path, changed: list[str], said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    command = ["paste", str(tmp_path), "--out", str(tmp_path / "out"), *changed]
    try:
        status = main(command)
    except SystemExit as ended:
        status = int(ended.code or 0)
    error = capsys.readouterr().err
    assert status == USER_ERROR and said in error and error.count("\n") == 1
