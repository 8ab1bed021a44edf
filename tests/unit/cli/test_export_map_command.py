"""`coopsim export` writes a town as a map; what it refuses is one line, and no file is lost."""

from __future__ import annotations

from pathlib import Path

import pytest

from coopsim.cli import main
from coopsim.data.maps import netconvert
from coopsim.data.maps.reading import read_map


def test_a_town_is_written_once(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "town.xodr"
    command = ["export", "opendrive", "town", "--out", str(path), "--option", "junctions=1"]
    assert main([*command, "--seed", "7"]) == 0
    assert capsys.readouterr().out.startswith(f"written: {path}, ")
    assert len(read_map(path).ways) >= 6
    before = path.read_bytes()
    assert main([*command, "--option", "place_seed=7"]) == 0, "the same town again"
    assert main([*command, "--seed", "8"]) == 2
    assert capsys.readouterr().err == (
        f"coopsim: error: {path} exists, and has another content: remove it, or name another file\n"
    )
    assert path.read_bytes() == before and list(tmp_path.iterdir()) == [path]


@pytest.mark.parametrize(
    ("command", "said"),
    [
        (["opendriv", "town", "--out", "a.xodr"], "unknown export format 'opendriv'. Did you mean 'opendrive'?"),
        (["opendrive", "crossing", "--out", "a.xodr"], "place must be 'town': of other places opendrive cannot"),
        (["opendrive", "town", "--out", "a.txt"], "the file must end in .xodr, got 'a.txt'"),
        (["opendrive", "town", "--out", "no/a.xodr"], "cannot write no/a.xodr: it must be a file in an existing"),
        (["opendrive", "town", "--out", "a.xodr", "--seeds", "3"], "--seeds is not of exports of maps"),
        (["opendrive", "town", "--out", "a.xodr", "--option", "lane=2"], "unknown option of towns 'lane'"),
        (["opv2v", "crossing", "--out", "a", "--seed", "3"], "--seed is of exports of maps: opv2v takes --seeds"),
    ],
)
def test_what_is_refused_is_one_line(
    command: list[str], said: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    assert main(["export", *command]) == 2
    error = capsys.readouterr().err
    assert said in error and error.startswith("coopsim: error: ") and error.count("\n") == 1
    assert list(tmp_path.iterdir()) == []


def test_without_netconvert_its_package_is_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(netconvert, "find_spec", lambda name: None)
    monkeypatch.setenv("PATH", str(tmp_path))
    assert main(["export", "sumo", "town", "--out", str(tmp_path / "town.net.xml"), "--option", "junctions=1"]) == 2
    assert "is made by netconvert: pip install 'coopsim[sumo]'" in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []
