"""Data sets of one car in measurements, trainings and replays, by the command line."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
import tiny_recordings as tiny
import tiny_single_car as single
from PIL import Image

from coopsim.cli import main

pytestmark = pytest.mark.usefixtures("jobs_here")
WRITERS = {
    "kitti_object": single.write_kitti_object,
    "argoverse2": single.write_argoverse2,
    "nuscenes": single.write_nuscenes,
    "arrays": single.write_arrays,
}


def detect(folder: Path, *more: str) -> int:
    command = ["detect", "--environments", str(folder), "--policies", "no_fusion", "--seeds", "0"]
    return main([*command, "--detector", "simulated", "--option", "ground_truth=visible", *more])


@pytest.mark.parametrize("name", WRITERS)
def test_every_frame_of_a_lone_car_is_measured(name: str, tmp_path: Path) -> None:
    every_s = {"kitti_object": "0.5", "nuscenes": "0.5", "arrays": "0.5"}.get(name, "0.1")
    folder, rows = WRITERS[name](tmp_path / "set"), tmp_path / "rows.json"
    assert detect(folder, "--every-s", every_s, "--option", "points=all", "--json", str(rows)) == 0
    (row,) = json.loads(rows.read_text())
    assert row["frames"] == tiny.FRAMES and row["objects"] == 2 * tiny.FRAMES
    assert row["objects_of"][" 0-30m"] == 2 * tiny.FRAMES and row["objects_of"][" people"] == 0
    assert row["APBEV@0.5"] is not None and row["receiver_frames"] == tiny.FRAMES


def test_a_table_by_range_and_class_is_printed(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = single.write_argoverse2(tmp_path / "set", {"walker": "PEDESTRIAN"})
    assert detect(folder, "--every-s", "0.1", "--by-range") == 0
    lines = [[cell.strip() for cell in line.split("|")[1:-1]] for line in capsys.readouterr().out.splitlines()]
    table = {line[0]: line[1:] for line in lines if len(line) == 3}
    assert table["AP (BEV) at IoU"] == ["0-30m", "all"], "bands with objects"
    assert table["vehicles"][0].endswith("(6)")
    assert table["people"][0].endswith("(3)") and table["truck"][1].endswith("(3)")
    assert "riders" not in table and "bus" not in table


def test_bands_are_those_of_one_protocol(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert detect(single.write_arrays(tmp_path), "--by-range", "--protocol", "opencood") == 2
    assert "--by-range needs the protocol coopsim" in capsys.readouterr().err


def test_pictures_are_drawn_of_measured_sweeps(tmp_path: Path) -> None:
    folder, out = single.write_kitti_object(tmp_path / "set"), tmp_path / "pictures"
    assert detect(folder, "--pictures", str(out), "--frames", "2") == 0
    pictures = sorted(out.glob("*.png"))
    assert [path.name[:14] for path in pictures] == ["training-0000-", "training-0001-"]
    with Image.open(pictures[0]) as picture:
        colors = {color for _, color in picture.convert("RGB").getcolors(10**6) or []}
    assert (44, 160, 44) in colors, "a labelled box is green"


def test_pictures_are_of_recordings(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["detect", "--environments", "crossing", "--pictures", str(tmp_path)]) == 2
    assert "--pictures shows folders of recordings with sweeps, got 'crossing'" in capsys.readouterr().err


@pytest.mark.parametrize("name", WRITERS)
def test_a_policy_is_scored_on_a_data_set(name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = WRITERS[name](tmp_path / "set")
    assert main(["replay", str(folder), "--detector", "simulated"]) == 0
    assert f"{tiny.FRAMES} frames" in capsys.readouterr().out


def test_a_training_on_few_real_frames_begins_with_shipped_weights(tmp_path: Path) -> None:
    folders = [str(WRITERS[name](tmp_path / name)) for name in WRITERS]
    small = ["--option", "samples.crop_cells=32", "--option", "batch=1", "--option", "block=1", "--workers", "0"]
    out = tmp_path / "tuned"
    assert main(["train", "pillars", *folders, "--start", "pillars", "--steps", "4", *small, "--out", str(out)]) == 0
    recipe = json.loads((out / "card.json").read_text())["recipe"]
    assert recipe["start"] == "pillars" and recipe["world"]["environments"] == folders
    assert (out / "pillars.safetensors").is_file()


def test_a_training_names_an_environment_that_is_not_there(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["train", "pillars", str(tmp_path / "missing"), "--out", str(tmp_path / "out")]) == 2
    assert "unknown world environment" in capsys.readouterr().err
