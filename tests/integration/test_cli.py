"""The commands, as a user types them, typos included."""

from __future__ import annotations

import contextlib
import json
import os
import pty
import signal
import subprocess
import sys
import termios
import time
import warnings
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from interruptible import interruptible
from PIL import Image

from coopsim.cli import INTERRUPTED, main
from coopsim.world.recording.episode_file import Episode

MINE = """
import numpy as np
import coopsim
from coopsim.geometry.boxes import Boxes3D
from coopsim.types import Tracks

class Mine(coopsim.Policy):
    needs = coopsim.Needs(uplink="none")
    def track(self, agent, observation):
        none = np.zeros(0, dtype=int)
        return Tracks(none, Boxes3D.empty(), np.zeros((0, 2)), np.zeros(0), none)
"""

QUICK = ["--frames", "6", "--vehicles", "6", "--pedestrians", "2"]


@contextlib.contextmanager
def started(*command: str, **options: Any) -> Iterator[subprocess.Popen[str]]:
    """A process that does not outlive the test."""
    with interruptible(*command, **options) as process:
        try:
            yield process
        finally:
            process.kill()


@pytest.fixture
def mine(tmp_path: Path) -> str:
    """A user's policy that tracks nothing."""
    (tmp_path / "mine.py").write_text(MINE)
    return f"{tmp_path / 'mine.py'}:Mine"


@pytest.mark.parametrize("command", ["bench --policies no_fusion", "detect", "export opv2v crossing --out nowhere"])
def test_more_seeds_than_anybody_runs_are_refused_in_one_line(command: str, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as left:
        main([*command.split(), "--seeds", "0-4,7-999999999999"])
    told = capsys.readouterr().err
    assert left.value.code == 2 and told.count("\n") == 1
    assert "argument --seeds: seeds must be a list of at most 100,000, got more" in told


def test_demo_prints_one_table_and_writes_report_and_numbers(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    report, numbers = tmp_path / "demo.html", tmp_path / "demo.json"
    assert main(["demo", *QUICK, "--out", str(report), "--json", str(numbers)]) == 0
    table = capsys.readouterr().out
    for column in ["sAMOTA", "AMOTA", "AMOTP", "MOTA", "MOTP", "IDS", "FP", "FN", "bytes/s", "frames/s"]:
        assert column in table
    assert "seen by others only" in table and "cooperative gain" in table
    rows = json.loads(numbers.read_text())
    assert [(row["policy"], row["latency"]) for row in rows] == [
        (policy, latency) for policy in ("no_fusion", "late_fusion") for latency in ("0 ms", "300 ms")
    ]
    alone, together = rows[0], rows[2]
    assert alone["bytes/s"] == 0 < together["bytes/s"]
    # Latency cannot touch who listens to nobody: all but the timing is the same number.
    assert {**rows[0], "frames/s": 0, "latency": ""} == {**rows[1], "frames/s": 0, "latency": ""}
    html = report.read_text()
    assert "late_fusion, 300 ms" in html
    assert "http://" not in html.replace("http://www.w3.org", "") and "https://" not in html


def test_a_recording_is_made_and_demonstrated(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    run, report = tmp_path / "run.coopsim", tmp_path / "demo.html"
    assert main(["record", "crossing", "--seed", "3", *QUICK, "--out", str(run)]) == 0
    assert f"written: {run}, 7 frames, {run.stat().st_size / 7:.0f} bytes a frame" in capsys.readouterr().out
    rows = []
    for source in (["--playback", str(run)], ["--seed", "3", *QUICK]):
        numbers = tmp_path / "demo.json"
        command = ["demo", *source, "--policies", "late_fusion", "--out", str(report), "--json", str(numbers)]
        assert main(command) == 0
        rows.append([{**row, "frames/s": 0} for row in json.loads(numbers.read_text())])
    assert rows[0] == rows[1] and len(rows[0]) == 2


def test_the_demonstration_takes_whatever_the_environment_does(tmp_path: Path, mine: str) -> None:
    """A detector, codec, channel and localization by name or file; policies with parameters, and a user's own."""
    (tmp_path / "channel.yaml").write_text("latency: {model: gamma, mean_s: 0.1, jitter_s: 0.05}")
    (tmp_path / "gnss.yaml").write_text("pose: {position_noise_m: 0.5, correlation_s: 5}")
    numbers = tmp_path / "demo.json"
    given = {
        "detector": "pointpillars_v2v4real",
        "codec": "compact",
        "channel": tmp_path / "channel.yaml",
        "localization": tmp_path / "gnss.yaml",
        "budget_bytes": 300,
        "weather": "{rain_mm_h: 5}",
    }
    command = ["demo", *QUICK, "--out", str(tmp_path / "demo.html"), "--json", str(numbers)]
    command += [word for name, value in given.items() for word in ("--option", f"{name}={value}")]
    policies = f"no_fusion,late_fusion(delayed=replay,align=True),{mine}"
    assert main([*command, "--policies", policies]) == 0
    rows = json.loads(numbers.read_text())
    assert [row["policy"] for row in rows] == ["no_fusion", "late_fusion(align=True, delayed=replay)", mine]
    assert {row["latency"] for row in rows} == {"the channel's"}
    report = (tmp_path / "demo.html").read_text()
    assert "<dt>codec</dt><dd>compact</dd>" in report and "position_noise_m" not in report


def test_a_scenario_file_is_recorded_and_demonstrated(tmp_path: Path) -> None:
    """What the file says goes before what a demonstration has by default; its paths are relative to it."""
    town, run, numbers = tmp_path / "town.yaml", tmp_path / "run.coopsim", tmp_path / "demo.json"
    (tmp_path / "channel.yaml").write_text("latency: {model: gamma, mean_s: 0.1, jitter_s: 0.05}")
    (tmp_path / "gnss.yaml").write_text("pose: {position_noise_m: 0.5}")
    town.write_text(
        "scenario: crossing\ndensity: 0.5\npopulation: {vehicles: 20}\n"
        "options: {dt_s: 0.2, channel: channel.yaml, localization: gnss.yaml}\n"
    )
    assert main(["record", str(town), "--frames", "5", "--out", str(run), "--option", "bicycles=2"]) == 0
    header = Episode(run).header
    assert header.dt_s == 0.2 and (header.population["vehicles"], header.population["bicycles"]) == (10, 1)
    command = ["demo", "--environment", str(town), "--playback", str(run), "--policies", "late_fusion"]
    assert main([*command, "--out", str(tmp_path / "demo.html"), "--json", str(numbers)]) == 0
    assert [row["latency"] for row in json.loads(numbers.read_text())] == ["the channel's"]


def test_a_warning_is_one_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    command = ["record", "merge", "--frames", "1", "--vehicles", "60", "--out", str(tmp_path / "run.coopsim")]
    with warnings.catch_warnings():
        warnings.simplefilter("always")
        warnings.showwarning = to_stderr
        assert main(command) == 0
    assert capsys.readouterr().err.startswith("coopsim: warning: there is room for 47 of 60 (")


def to_stderr(message: Warning | str, category: type[Warning], filename: str, lineno: int, *_: Any) -> None:
    """As Python shows warnings where pytest does not collect them."""
    sys.stderr.write(warnings.formatwarning(message, category, filename, lineno))


def test_places_of_files_are_recorded_by_name(tmp_path: Path) -> None:
    run = tmp_path / "run.coopsim"
    assert main(["record", "village.yaml", "--frames", "2", "--out", str(run)]) == 0
    assert Episode(run).header.scenario.startswith("village-")


def test_a_town_is_drawn_as_a_file_that_is_recorded_and_demonstrated(tmp_path: Path) -> None:
    town, picture = tmp_path / "town.yaml", tmp_path / "town.png"
    drawn = ["--junctions", "1", "--lanes", "1", "--openness", "0.5"]
    assert main(["town", "draw", "2", *drawn, "--out", str(town), "--picture", str(picture)]) == 0
    with Image.open(picture) as image:
        assert image.size == (900, 900)
    assert main(["record", str(town), "--frames", "3", "--out", str(tmp_path / "run")]) == 0
    shown = ["--policies", "no_fusion", "--latencies-ms", "0", "--option", "lidar=null"]
    report = ["--out", str(tmp_path / "demo.html")]
    assert main(["demo", "--environment", "town", "--playback", str(tmp_path / "run"), *shown, *report]) == 0


def test_the_place_of_a_file_is_drawn(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    picture = tmp_path / "place.png"
    assert main(["town", "draw", "village.yaml", "--picture", str(picture)]) == 0
    with Image.open(picture) as image:
        assert image.size == (900, 900) and len(image.convert("RGB").getcolors(900 * 900) or ()) > 20
    for wrong, said in (
        (["village.yaml"], "of a scenario file --picture FILE.png is drawn"),
        (["village.yaml", "--picture", str(picture), "--lanes", "2"], "and no option of a seed"),
        (["7", "--picture", str(picture)], "--out must name the scenario file to write"),
    ):
        capsys.readouterr()
        assert main(["town", "draw", *wrong]) == 2
        assert said in capsys.readouterr().err


def test_the_old_name_of_the_demos_file_is_accepted_with_a_word(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["demo", "--report", "/nonexistent/demo.html"]) == 2
    said = capsys.readouterr().err
    assert "--report is now --out" in said and "cannot write /nonexistent/demo.html" in said


def test_replay_and_leaderboard_take_policies_as_bench_does(
    recordings: Path, tmp_path: Path, mine: str, capsys: pytest.CaptureFixture[str]
) -> None:
    for policy in ("late_fusion(delayed=replay,hits=2)", mine):
        assert main(["replay", str(recordings), "--detections", "ego,1", "--policy", policy]) == 0
    printed = capsys.readouterr().out
    assert "late_fusion(delayed=replay, hits=2)" in printed and mine in printed
    command = ["leaderboard", str(recordings), "--detections", "ego,1", "--out", str(tmp_path / "board")]
    assert main([*command, "--policies", f"late_fusion,late_fusion(delayed=replay,hits=2),{mine}"]) == 0
    assert "late_fusion(delayed=replay, hits=2)" in (tmp_path / "board" / "leaderboard.md").read_text()


def test_an_interrupted_recording_can_be_played(tmp_path: Path) -> None:
    run = tmp_path / "run.coopsim"
    command = ["record", "crossing", "--frames", "100000", "--out", str(run)]
    with started(*command, stderr=subprocess.PIPE) as process:
        while not run.exists() or run.stat().st_size < 10_000:
            assert process.poll() is None
            time.sleep(0.1)
        process.send_signal(signal.SIGINT)
        _, err = process.communicate(timeout=60)
    assert process.returncode == INTERRUPTED and "Traceback" not in err
    assert len(list(Episode(run))) > 2


def test_replay_writes_the_numbers_that_it_prints(
    recordings: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    numbers = tmp_path / "replay.json"
    assert main(["replay", str(recordings), "--detections", "ego", "--json", str(numbers)]) == 0
    printed = capsys.readouterr().out
    written = json.loads(numbers.read_text())
    assert written["frames"] == 10 and written["seconds"] > 0
    assert written["count"]["FP"] == 0 and written["count"]["GT"] == 10
    assert f"{written['count']['sAMOTA']:.1f}" in printed


def test_replay_takes_every_name_as_an_agent(recordings: Path, tmp_path: Path) -> None:
    numbers = tmp_path / "replay.json"
    command = ["replay", str(recordings), "--policy", "late_fusion", "--detections", "ego,1"]
    assert main([*command, "--json", str(numbers)]) == 0
    assert set(json.loads(numbers.read_text())["count"]["agents"]) == {"ego", "1"}


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["demo", "--policies", "late_fusoin"], "unknown policy 'late_fusoin'. Did you mean 'late_fusion'"),
        (["demo", "--environment", "crosing"], "Did you mean 'crossing-v3'"),
        (["demo", "--latencies-ms=-5"], "latency_s must be"),
        (["demo", "--loss", "2"], "loss must be in [0, 1]"),
        (["demo", "--out", "/nonexistent/demo.html"], "cannot write /nonexistent/demo.html"),
        (
            ["demo", "--playback", "/nonexistent"],
            "cannot read /nonexistent: No such file or directory; accepted: a file",
        ),
        (["demo", "--option", "chanel=wifi.yaml"], "Did you mean 'channel'"),
        (["demo", "--option", "channel=/nonexistent.yaml"], "channel: cannot read /nonexistent.yaml"),
        (["demo", "--option", "channel={{}}", "--latencies-ms", "0"], "--latencies-ms must be left out"),
        (["demo", "--option", "codec=compat"], "Did you mean 'compact'"),
        (["demo", "--option", "detector=a", "--option", "detector=b"], "detector must be given once"),
        (["demo", "--option", "vehicles=8", "--vehicles", "9"], "vehicles must be given once"),
        (["demo", "--option", "loss=0.5"], "loss is not an option here: use --loss"),
        (["record", "vilage.yaml", "--out", "{recordings}/run"], "or one of delivery_street.yaml"),
        (["record", "crossing", "--out", "{recordings}/run", "--option", "bycicles=2"], "Did you mean 'bicycles'"),
        (
            ["leaderboard", "{recordings}", "--detections", "ego", "--out", "{recordings}/labels/0000.txt"],
            "cannot make",
        ),
        (["record", "crossing", "--out", "{recordings}/run.csv"], "must end in .coopsim, .rec or nothing, got"),
        (["record", "crosing", "--out", "{recordings}/run"], "Did you mean 'crossing'"),
        (["record", "crossing", "--out", "/nonexistent/run"], "cannot write /nonexistent/run"),
        (["record", "twon", "--out", "{recordings}/run"], "Did you mean 'town'"),
        (["record", "town", "--out", "{recordings}/run", "--option", "plce_seed=2"], "Did you mean 'place_seed'"),
        (["town", "draw", "1", "--out", "{recordings}/town.yaml", "--lanes", "4"], "lanes must be an integer in 1..3"),
        (["town", "draw", "1", "--out", "{recordings}/town.yaml", "--openness", "2"], "openness must be in [0, 1]"),
        (["town", "draw", "1", "--out", "{recordings}/t.yaml", "--picture", "t.gif"], "picture must end in .png"),
        (["town", "draw", "1", "--junctions", "1", "--out", "{recordings}/town.yml2"], "must end in .yaml"),
        (["replay", "/nonexistent", "--detections", "ego"], "/nonexistent"),
        (["replay", "{recordings}", "--detections", "egoo"], "Did you mean 'ego'"),
        (["replay", "{recordings}", "--detections", "ego", "--policy", "ab3dmt"], "Did you mean 'ab3dmot'"),
        (["replay", "{recordings}", "--detections", "ego", "--match-iou", "0"], "match_iou must be"),
    ],
)
def test_what_the_user_can_mend_is_said_in_one_line(
    arguments: list[str], message: str, recordings: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main([argument.format(recordings=recordings) for argument in arguments]) == 2
    error = capsys.readouterr().err
    assert message in error and "Traceback" not in error


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["demo", "--frame", "5"], "Did you mean --frames"),
        (["demo", "--frames", "0"], "must be an integer >= 1"),
        (["demo", "--frames", "many"], "must be an integer >= 1"),
        (["demo", "--latencies-ms", "a,b"], "must be numbers with commas"),
        (["demo", "--policies", "a,,b"], "policy must be name, name(parameter=value, ...)"),
        (["demo", "--policies", "a(b=1),a( b=1 )"], "must be distinct policies"),
        (["leaderboard", "x", "--detections", "ego", "--policies", "mine.py"], "as mine.py:MyTracker"),
        (["replay", "x", "--detections", "ego", "--policy", "/nonexistent/mine.py:A"], "cannot read /nonexistent"),
        (["demo", "--option", "codec"], "must be name=value"),
        (["replay", "x", "--detection", "ego"], "Did you mean --detections"),
        (["town", "draw", "1", "--out", "x.yaml", "--junction", "2"], "Did you mean --junctions"),
        (["town", "draw", "one", "--out", "x.yaml"], "must be an integer >= 0, got 'one'"),
        (["town", "drwa", "1"], "invalid choice: 'drwa'"),
        (["town"], "required: COMMAND"),
        (["repaly"], "invalid choice"),
        ([], "required: COMMAND"),
    ],
)
def test_typos_in_the_command_line(arguments: list[str], message: str, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as caught:
        main(arguments)
    assert caught.value.code == 2
    assert message in capsys.readouterr().err


def test_lists_say_what_defences_need_and_have_fusions(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["list", "defenses"]) == 0
    lines = {line.split()[0]: line for line in capsys.readouterr().out.splitlines()}
    assert lines["consistency"].endswith("(needs a LiDAR)") and lines["trust"].endswith("(needs a LiDAR)")
    assert lines["oracle"].endswith("(needs the truth)") and "(needs" not in lines["plausibility"]
    pytest.importorskip("torch")
    assert main(["list", "fusions"]) == 0
    assert {line.split()[0] for line in capsys.readouterr().out.splitlines()} >= {"attfuse", "v2x_vit", "where2comm"}


def test_list_names_everything(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["list"]) == 0
    out = capsys.readouterr().out
    for name in (
        "late_fusion",
        "no_fusion (or ab3dmot)",
        "crossing-v3",
        "town-v3",
        "village.yaml",
        "pointpillars_v2v4real",
        "attfuse_together",
        "mota, safe_progress",
    ):
        assert name in out
    for name in ("town-v3", "sparse_features (features)", "compact (detections)", "queries, tracks", "quick"):
        assert name in out


def test_ctrl_c_before_anything_is_finished_leaves_older_files(tmp_path: Path) -> None:
    report, numbers = tmp_path / "demo.html", tmp_path / "demo.json"
    numbers.write_text("older")
    command = ["demo", "--frames", "2000", "--out", str(report), "--json", str(numbers)]
    screen, terminal = pty.openpty()  # progress is for terminals only, and says when the first run has begun
    termios.tcsetwinsize(terminal, (24, 80))
    with started(*command, stdout=subprocess.PIPE, stderr=terminal, cwd=tmp_path) as process:
        os.close(terminal)
        shown = ""
        while "frame/s" not in shown:
            shown += os.read(screen, 1024).decode()
        process.send_signal(signal.SIGINT)
        out, _ = process.communicate(timeout=60)
    shown += os.read(screen, 1 << 16).decode()
    os.close(screen)
    assert process.returncode == INTERRUPTED, shown
    assert "interrupted" in shown and "Traceback" not in shown
    assert list(tmp_path.iterdir()) == [numbers] and numbers.read_text() == "older"
    assert out == ""


def test_ctrl_c_later_keeps_what_is_finished(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    report, numbers = tmp_path / "demo.html", tmp_path / "demo.json"
    ticks = iter(range(100))

    def update(bar: object, n: int = 1) -> None:
        if next(ticks) == 8:  # in the second run of six frames
            raise KeyboardInterrupt

    monkeypatch.setattr("tqdm.tqdm.update", update)
    assert main(["demo", *QUICK, "--out", str(report), "--json", str(numbers)]) == INTERRUPTED
    shown = capsys.readouterr()
    assert "1 finished run was kept" in shown.err and shown.out.count("no_fusion") == 2  # a row in each table
    assert len(json.loads(numbers.read_text())) == 1 and report.stat().st_size > 10_000


def test_output_may_be_cut_off(recordings: Path) -> None:
    command = f"{sys.executable} -m coopsim replay {recordings} --detections ego | true"
    done = subprocess.run(
        command,
        shell=True,
        capture_output=True,
        text=True,
        check=False,
        env={**os.environ, "PYTHONUNBUFFERED": "1"},
    )
    assert "Traceback" not in done.stderr
