"""`coopsim map` says what is in a map, and draws it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from tiny_maps import SUMO, THREE_ROADS, written

from coopsim.cli import main


def test_a_map_is_described_and_drawn(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path, picture = written(tmp_path, THREE_ROADS), tmp_path / "map.png"
    assert main(["map", str(path), "--picture", str(picture)]) == 0
    told = capsys.readouterr().out
    for line in (
        f"{path}: OpenDRIVE 1.6, right-hand traffic",
        "lanes: 6 driven, 0.50 km; others: none",
        "junctions: 1, ways over them: 3, 0.05 km; 1 right, 2 straight",
        "solids: 1 building, 5 pole, 1 tree, 1 wall",
        "left out: 1 objects of type patch",
        "repaired: nothing",
        "lanes that no lane leads to: 3 (1.0.-1, 2.0.1, 3.0.1)",
    ):
        assert line in told.splitlines()
    pixels = np.asarray(Image.open(picture))
    assert pixels.shape[1] == 1600 and len(np.unique(pixels.reshape(-1, 3), axis=0)) > 5


def test_repairs_are_lines_of_the_description(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["map", str(written(tmp_path, SUMO.replace('"B" fromLane', '"X" fromLane'), "a.net.xml"))]) == 0
    assert "repaired: connections of lanes that do not exist are passed over: 1 (line " in capsys.readouterr().out


def test_a_wrong_file_or_picture_is_one_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = written(tmp_path, "<html/>")
    assert main(["map", str(path)]) == 2
    assert capsys.readouterr().err.startswith(f"coopsim: error: {path}:1: <html> is no road map; accepted")
    assert main(["map", str(path), "--picture", "map.txt"]) == 2
    assert "picture must end in .png" in capsys.readouterr().err
