"""The reference figures on six real recordings, which were computed independently (3D IoU 0.25, all pooled)."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

import coopsim
from coopsim.cli import main


def test_ab3dmot_on_cobevt(v2v4real: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    numbers = tmp_path / "replay.json"
    command = ["replay", str(v2v4real), "--policy", "ab3dmot", "--detections", "cobevt", "--json", str(numbers)]
    # The reference tracks in the moving frame of the car, so this does, too.
    command += ["--odometry", "none"]
    assert main(command) == 0
    result = json.loads(numbers.read_text())
    assert result["frames"] == 1134
    count, ignore = result["count"], result["ignore"]
    expected = {"sAMOTA": 74.6, "AMOTA": 29.8, "AMOTP": 54.1, "MOTA": 61.4, "MT": 48.3}
    assert {name: count[name] for name in expected} == pytest.approx(expected, abs=0.1)
    assert count["IDS"] == pytest.approx(14, abs=1)
    expected = {"sAMOTA": 79.9, "AMOTA": 33.2, "MOTA": 78.2}
    assert {name: ignore[name] for name in expected} == pytest.approx(expected, abs=0.1)


@pytest.mark.long
def test_every_name_is_an_agent_and_messages_make_a_difference(v2v4real: Path) -> None:
    alone = coopsim.evaluate_recordings("no_fusion", v2v4real, ("ego", "1"))
    together = coopsim.evaluate_recordings("late_fusion", v2v4real, ("ego", "1"))
    assert set(together.count.agents) == {"ego", "1"}
    # Both cars' boxes are given in the ego car's frame, so both fuse the same boxes, whoever asks.
    both = [together.count.agents[agent]["sAMOTA"] for agent in ("ego", "1")]
    assert both[0] == pytest.approx(both[1], abs=0.5)
    assert together.count["sAMOTA"] > alone.count["sAMOTA"] + 10
    assert together.count["bytes_per_s"] > 0 == alone.count["bytes_per_s"]


@pytest.mark.long
def test_learned_covariances_with_two_cars(v2v4real: Path) -> None:
    found = coopsim.evaluate_recordings("dmstrack", v2v4real, ("ego", "1"), odometry="none")
    expected = {"sAMOTA": 73.3, "AMOTA": 31.5, "AMOTP": 58.0, "MOTA": 63.3, "MT": 60.2}
    assert {name: found.count[name] for name in expected} == pytest.approx(expected, abs=0.2)
    expected = {"sAMOTA": 87.5, "AMOTA": 40.0, "MOTA": 86.7}
    assert {name: found.ignore[name] for name in expected} == pytest.approx(expected, abs=0.2)
