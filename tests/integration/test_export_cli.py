"""`coopsim export` and `coopsim check-export` as a user types them."""

from __future__ import annotations

import signal
import subprocess
import time
from pathlib import Path

import pytest
from interruptible import interruptible

from coopsim.cli import INTERRUPTED, main
from coopsim.data.export.folder_checks import files_below

LIGHT = ["--vehicles", "5", "--rsus", "0", "--option", "lidar=VLP-16", "--option", "lidar_columns=64"]


def _export(folder: Path, *more: str) -> list[str]:
    return ["export", "opv2v", "crossing", "--out", str(folder), *LIGHT, *more]


def test_an_export_tells_where_it_is_and_passes_its_check(tmp_path, capsys):
    assert main(_export(tmp_path / "out", "--seeds", "0-1", "--frames", "2")) == 0
    said = capsys.readouterr().out
    assert f"written: {tmp_path / 'out'}, 4 frames" in said
    assert (tmp_path / "out" / "picture.png").read_bytes().startswith(b"\x89PNG")
    assert main(["check-export", str(tmp_path / "out")]) == 0
    assert "is as it should be" in capsys.readouterr().out


def test_a_check_names_file_and_field_and_fails(tmp_path, capsys):
    main(_export(tmp_path, "--frames", "1"))
    (broken, *_) = sorted(tmp_path.glob("*/*/*.yaml"))
    broken.write_text(broken.read_text().replace("lidar_pose: [", "lidar_pose: [x, "))
    capsys.readouterr()
    assert main(["check-export", str(tmp_path)]) == 1
    said = capsys.readouterr().out.splitlines()
    assert f"{broken.relative_to(tmp_path)}: lidar_pose must be 6 numbers" in said[1]
    assert said[-1] == "2 problems"  # the other: its checksum
    assert main(["check-export", str(tmp_path), "--format", "opv2v"]) == 1
    assert capsys.readouterr().out.splitlines()[-1] == "1 problem"


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        (["export", "opv2v", "crossing"], "required: --out"),
        (["export", "opv2", "crossing", "--out", "x"], "Did you mean 'opv2v'"),
        (["export", "opv2v(lidr=a)", "crossing", "--out", "x"], "Did you mean 'lidar'"),
        (["export", "opv2v", "crosing", "--out", "x"], "Did you mean 'crossing"),
        (["export", "opv2v", "none.yaml", "--out", "x"], "none.yaml"),
        (["export", "opv2v", "replay", "--out", "x"], "a replay has no sensors"),
        (["export", "opv2v", "crossing", "--out", "x", "--seed", "1"], "opv2v takes --seeds"),
        (["export", "opv2v", "crossing", "--out", "x", "--seeds", "4-1"], "must be integers >= 0"),
        (["export", "opv2v", "crossing", "--out", "x", "--frames", "0"], "must be an integer >= 1"),
        (["export", "opv2v", "crossing", "--out", "x", "--option", "camera=front"], "Did you mean 'cameras'"),
        (["export", "opv2v", "crossing", "--out", "x", "--option", "seed=3"], "use --seeds"),
        (["export", "opv2v", "crossing", "--out", "x", "--option", "uplink=points"], "uplink must be left out"),
        (["export", "opv2v", "crossing", "--out", "x", "--option", "lidar=null"], "every agent needs a LiDAR"),
        (["export", "opv2v", "crossing", "--out", "/proc/none/x"], "cannot make the folder /proc/none/x"),
        (["export", "opv2v", "", "--out", "x"], "unknown environment ''"),
        (["check-export", "none"], "there is no folder none"),
        (["check-export", "."], "has no export.json"),
        (["check-export", ".", "--format", "kiti"], "Did you mean 'kitti'"),
    ],
)
def test_typos_are_told_in_one_line_and_write_nothing(arguments, told, tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    try:
        status = main(arguments)
    except SystemExit as exit_of_argparse:
        status = exit_of_argparse.code
    said = capsys.readouterr().err
    assert status == 2
    assert told in said
    assert "Traceback" not in said
    assert list(tmp_path.iterdir()) == []


def test_after_ctrl_c_the_same_command_goes_on_and_ends_in_the_same_bytes(tmp_path):
    command = ["--seeds", "0-1", "--frames", "20"]
    with interruptible(*_export(tmp_path / "a", *command), stderr=subprocess.PIPE) as process:
        try:
            while not list((tmp_path / "a").glob("crossing_0001/*/000004.yaml")):
                assert process.poll() is None, process.communicate()
                time.sleep(0.01)
            process.send_signal(signal.SIGINT)
            assert "the same command again goes on" in process.communicate(timeout=60)[1]
            assert process.returncode == INTERRUPTED
        finally:
            process.kill()
    assert not list((tmp_path / "a").rglob("*.tmp"))
    assert main(_export(tmp_path / "a", *command)) == 0
    assert main(_export(tmp_path / "b", *command)) == 0
    contents = [
        {path.relative_to(tmp_path / name): path.read_bytes() for path in files_below(tmp_path / name)}
        for name in ("a", "b")
    ]
    assert contents[0] == contents[1]
