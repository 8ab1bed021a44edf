"""`coopsim detect` from the command line to the rows."""

from __future__ import annotations

import json
from collections.abc import Iterator
from contextlib import nullcontext
from pathlib import Path
from typing import Any

import pytest
from jobs_here import no_workers

from coopsim.bench.detect.detect_plan import EVERYWHERE, DetectJob
from coopsim.bench.engine.job import Outcome
from coopsim.cli import main

NOISES = ["--pose", "together", "--position-noises-m", "0,0.4", "--heading-noises-deg", "0,0.4"]
QUICK = ["--option", "lidar=null", "--detector", "simulated", "--frames", "2"]
SCENARIO = """
scenario: crossing
population:
  connected_cars: 2
  rsus: 1
options:
  region_x_m: 60
"""


@pytest.fixture
def here(monkeypatch: pytest.MonkeyPatch) -> list[DetectJob]:
    """Episodes run in this process, which saves starting others; those that were run."""
    done: list[DetectJob] = []

    def in_this_process(jobs: Iterator[DetectJob], workers: int) -> Iterator[Outcome]:
        for job in jobs:
            done.append(job)
            yield job.run()

    monkeypatch.setattr("coopsim.bench.engine.engine.run_locally", in_this_process)
    return done


def _detect(out: Path, *more: str) -> list[dict[str, Any]]:
    assert main(["detect", *QUICK, "--json", str(out), *more]) == 0
    rows: list[dict[str, Any]] = json.loads(out.read_text())
    return rows


def test_rows_of_policies_environments_noises_and_delays(
    here: list[DetectJob], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    own = tmp_path / "mine.yaml"
    own.write_text(SCENARIO)
    more = ["--policies", "no_fusion,late_fusion(hits=1)", "--environments", f"crossing,{own}", "--seeds", "3"]
    rows = _detect(tmp_path / "out.json", *more, *NOISES, "--latencies-ms", "0,500", "--table")
    assert len(rows) == 2 * (2 + 1) * 4 and len(here) == 2 * 2 * 4
    late = [row for row in rows if row["policy"] == "late_fusion(hits=1)" and row["environment"] == "crossing"]
    assert [(row["noise"], row["delay_ms"]) for row in late] == [
        ("0/0", 0), ("0/0", 500), ("0.4/0.4", 0), ("0.4/0.4", 500)
    ]  # fmt: skip
    best, *worse = (row["APBEV@0.7"] for row in late)
    assert all(each < best for each in worse)
    assert late[0]["options"] == {
        "lidar": None, "detector": "simulated", "dt_s": 0.5,
        "position_noise_m": 0.0, "heading_noise_rad": 0.0, "latency_s": 0.0,
    }  # fmt: skip
    assert late[0]["frames"] == 2 and late[0]["receiver_frames"] == 6 and late[0]["bytes_per_message"] > 100
    assert {"ms_environment", "ms_policy", "ms_uplink", "AP3D@0.7", "APBEV@0.5 people"} <= set(late[0])
    (whole,) = (row for row in rows if row["environment"] == EVERYWHERE and row["policy"] == "no_fusion"
                and row["noise"] == "0.4/0.4" and row["delay_ms"] == 500)  # fmt: skip
    assert whole["frames"] == 4 and whole["receiver_frames"] == 6 + 4 and whole["bytes_per_message"] == 0
    assert capsys.readouterr().out.count("| no_fusion") == 2 * 12  # a second table is by OpenCOOD's protocol


def test_a_run_goes_on_and_another_protocol_runs_nothing(here: list[DetectJob], tmp_path: Path) -> None:
    out = tmp_path / "out.json"
    first = _detect(out, "--policies", "no_fusion", "--seeds", "0")
    assert len(here) == 1
    more = _detect(out, "--policies", "no_fusion,late_fusion", "--seeds", "0")
    assert len(here) == 2 and more[0] == first[0]
    opencood = _detect(out, "--policies", "no_fusion,late_fusion", "--seeds", "0", "--protocol", "opencood")
    assert len(here) == 2 and [row["protocol"] for row in opencood] == ["opencood"] * 2
    shared = ["--episodes", str(tmp_path / "out.json.episodes")]
    more = ["--policies", "no_fusion,late_fusion", "--seeds", "0", "--protocol", "dair", *shared]
    assert len(_detect(tmp_path / "dair.json", *more)) == len(here) == 2
    assert opencood[0]["APBEV@0.5"] != first[0]["APBEV@0.5"]
    next((tmp_path / "out.json.episodes" / "cells").glob("*.npz")).unlink()  # what was perceived is gone
    assert len(_detect(out, "--policies", "no_fusion,late_fusion", "--seeds", "0")) == 2 and len(here) == 3


def test_an_interrupt_keeps_the_finished_rows(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    def interrupted(jobs: Iterator[DetectJob], workers: int) -> Iterator[Outcome]:
        yield next(jobs).run()
        raise KeyboardInterrupt

    monkeypatch.setattr("coopsim.bench.engine.engine.run_locally", interrupted)
    out = tmp_path / "out.json"
    assert main(["detect", *QUICK, "--seeds", "0", "--json", str(out)]) == 130
    (row,) = json.loads(out.read_text())
    assert row["policy"] == "no_fusion"
    assert "1 finished rows are in" in capsys.readouterr().err


def test_a_failed_episode_costs_its_row_only(
    here: list[DetectJob], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    own = tmp_path / "own.py"
    own.write_text(
        "import coopsim\n"
        "class Fails(coopsim.Policy):\n"
        "    def track(self, agent, observation):\n"
        "        raise ValueError('no such thing')\n"
    )
    out = tmp_path / "out.json"
    command = ["detect", *QUICK, "--seeds", "0", "--policies", f"{own}:Fails,no_fusion", "--json", str(out)]
    assert main(command) == 1
    assert [row["policy"] for row in json.loads(out.read_text())] == ["no_fusion"]
    assert "ValueError: no such thing" in capsys.readouterr().err


def test_fusions_of_features_have_detections_and_bytes_of_their_own(here: list[DetectJob], tmp_path: Path) -> None:
    pytest.importorskip("torch")
    from tiny_networks import learned, tiny_detector

    settings = ", ".join(f"{name}={value!r}" for name, value in learned("fcooper").items())
    command = ["detect", "--frames", "1", "--seeds", "0", "--option", "lidar_columns=300", "--json"]
    out = tmp_path / "out.json"
    policies = f"no_fusion,fcooper({settings})"
    assert main([*command, str(out), "--detector", tiny_detector(), "--policies", policies]) == 0
    alone, fused = json.loads(out.read_text())
    assert "pillars" in alone["options"]["detector"] and "detector" not in fused["options"]
    assert fused["bytes_per_message"] > 1000 and fused["ms_uplink"] > 0
    assert len(here) == 2


def test_rows_are_the_same_for_any_number_of_processes(tmp_path: Path) -> None:
    """Those of two, and those of this one."""
    found = []
    for around in (no_workers(), nullcontext()):
        with around:
            rows = _detect(tmp_path / f"{len(found)}.json", "--seeds", "0-1", "--workers", "2")
        found.append([{name: value for name, value in row.items() if not name.startswith("ms_")} for row in rows])
    assert found[0] == found[1]


def test_rows_under_attack_have_lower_precision_and_the_same_receivers(
    here: list[DetectJob], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    lies = ["none", "cav_1=ghost", "cav_1=shift(aside_m=3)"]
    asked = [word for lie in lies for word in ("--attack", lie)]
    rows = _detect(tmp_path / "out.json", "--seeds", "0", "--frames", "6", *asked, "--table")
    by = {(row["policy"], row["attacks"]): row for row in rows}
    assert [row["attacks"] for row in rows[::2]] == lies and len(here) == 6
    assert {row["receiver_frames"] for row in rows} == {2 * 6}, "the liar is no receiver, in the honest row neither"
    assert len({row["objects"] for row in rows}) == 1, "the world is the same"
    honest, ghost, shift = (by["late_fusion", lie] for lie in lies)
    assert ghost["APBEV@0.5"] < honest["APBEV@0.5"] and ghost["false_per_frame"] > honest["false_per_frame"]
    assert shift["APBEV@0.5"] < honest["APBEV@0.5"]
    assert len({by["no_fusion", lie]["APBEV@0.5"] for lie in lies}) == 1, "nobody is heard"
    assert "attacks" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("typed", "told"),
    [
        (["--protocol", "opencodd"], "Did you mean 'opencood'"),
        (["--policies", "late_fusio"], "late_fusion"),
        (["--environments", "crosing"], "crossing"),
        (["--noise", "0.4"], "0/0,0.4/0.4"),
        (["--pose", "together", "--position-noises-m", "0,0.4"], "as many position as heading noises"),
        (["--receivers", "car"], "cars"),
        (["--boxes", "track"], "tracks"),
        (["--option", "latency_s=0.1"], "--latencies-ms"),
        (["--attack", "cav_1=gost"], "ghost"),
        (["--attack", "cav_9=ghost"], "cav_9"),
        (["--attack", "cav_1=point_ghost"], "'point_ghost' lies in points or features or queries"),
        (["--attack", "cav_0=ghost + cav_1=ghost + cav_2=ghost"], "an agent that does not lie"),
        (["--option", "attacks=cav_1=ghost"], "--attack"),
        (["--option", "lidr=VLP-16"], "lidar"),
        (["--detector", "pilars"], "detector"),
        (["--frame", "3"], "--frames"),
        (["--json", "/nonexistent/out.json"], "cannot write"),
    ],
)
def test_typos_get_one_line_with_what_is_accepted(
    typed: list[str], told: str, capsys: pytest.CaptureFixture[str]
) -> None:
    try:
        status = main(["detect", *typed])
    except SystemExit as stopped:
        status = int(stopped.code or 0)
    shown = capsys.readouterr().err
    assert status == 2 and told in shown and len(shown.strip().splitlines()) == 1
