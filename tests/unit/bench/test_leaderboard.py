"""Policies side by side on recordings: every one stands in every table, both ways."""

from __future__ import annotations

import csv
import io
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pytest

import coopsim
from coopsim.bench.evaluate import RecordingsEvaluation, evaluate_recordings
from coopsim.bench.leaderboard import evaluate_each, mota_over_recall, plot, to_csv, to_markdown, write_leaderboard
from coopsim.cli import main
from coopsim.cli.arguments import FAILED, INTERRUPTED, USER_ERROR
from coopsim.errors import InvalidValueError, PolicyMismatchError, UnknownNameError

POLICIES = ("no_fusion", "late_fusion")

MINE = """
import coopsim

class Fails(coopsim.Policy):
    needs = coopsim.Needs(uplink="none")
    def track(self, agent, observation):
        raise KeyError("my own slip")

class Looks(Fails):
    needs = coopsim.Needs(uplink="none", cameras="front")
"""


@pytest.fixture
def mine(tmp_path: Path) -> str:
    path = tmp_path / "mine.py"
    path.write_text(MINE)
    return f"{path}:"


def _finished(path: Path, detections: Sequence[str], policies: Sequence[str]) -> dict[str, RecordingsEvaluation]:
    results = {}
    for name, result in evaluate_each(path, detections, policies):
        assert isinstance(result, RecordingsEvaluation), result
        results[name] = result
    return results


def test_every_policy_stands_in_every_table(recordings: Path) -> None:
    results = _finished(recordings, ("ego", "1"), POLICIES)
    assert tuple(results) == POLICIES
    markdown = to_markdown(results, "a set")
    assert markdown.index("False positives counted") < markdown.index("False positives ignored")
    assert all(markdown.count(f"| {name} ") == 2 for name in POLICIES)
    rows = list(csv.DictReader(io.StringIO(to_csv(results))))
    assert [(row["policy"], row["false positives"]) for row in rows] == [
        (policy, protocol) for protocol in ("count", "ignore") for policy in POLICIES
    ]
    assert float(rows[0]["MOTA"]) == results["no_fusion"].count["MOTA"]
    picture = plot(results, "a <set>")
    assert picture.startswith("<?xml") and "a &lt;set&gt;" in picture
    assert all(picture.count(f">{name}<") == 1 for name in POLICIES)
    assert picture == plot(results, "a <set>")


def test_the_curve_is_that_of_the_levels_that_were_reached(recordings: Path) -> None:
    score = _finished(recordings, ("ego",), ("no_fusion",))["no_fusion"].count
    recall, mota = mota_over_recall(score)
    (agent,) = score.agents.values()
    assert agent.sweep is not None
    assert recall.tolist() == pytest.approx([point.recall for point in agent.sweep.points])
    assert mota.tolist() == pytest.approx([100 * point.clear.mota for point in agent.sweep.points])


def test_a_typo_in_the_last_policy_costs_no_run(recordings: Path) -> None:
    with pytest.raises(UnknownNameError, match="Did you mean 'late_fusion'"):
        evaluate_each(recordings, ("ego",), ("no_fusion", "late_fusoin"))  # and no step of it


def test_a_policy_that_cannot_be_fed_costs_no_run(recordings: Path, mine: str) -> None:
    with pytest.raises(PolicyMismatchError, match="needs cameras 'front', and 'replay' has none"):
        evaluate_each(recordings, ("ego",), ("no_fusion", f"{mine}Looks"))  # and no step of it


def test_a_policy_that_raises_costs_the_others_nothing(
    recordings: Path, tmp_path: Path, mine: str, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "out"
    command = ["leaderboard", str(recordings), "--detections", "ego", "--out", str(out), "--policies"]
    assert main([*command, f"no_fusion,{mine}Fails,late_fusion"]) == FAILED
    shown = capsys.readouterr()
    assert f"coopsim: failed: {mine}Fails\nTraceback" in shown.err and "KeyError: 'my own slip'" in shown.err
    assert "1 of 3 policies failed and are not ranked" in shown.err
    written = {path.suffix: path.read_text() for path in out.iterdir()}
    assert set(written) == {".md", ".csv", ".svg"}
    assert all(name in text and "Fails" not in text for text in written.values() for name in POLICIES)
    assert main([*command, f"{mine}Fails"]) == FAILED
    assert {path.suffix: path.read_text() for path in out.iterdir()} == written


def test_a_broken_file_is_no_fault_of_a_policy(
    recordings: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (recordings / "detections" / "ego" / "0001.txt").write_text("0,2,nonsense\n")
    command = ["leaderboard", str(recordings), "--detections", "ego", "--policies", "no_fusion"]
    assert main([*command, "--out", str(tmp_path / "out")]) == USER_ERROR
    error = capsys.readouterr().err
    assert "ego/0001.txt" in error and "Traceback" not in error and "failed" not in error


def test_nothing_to_rank(tmp_path: Path) -> None:
    with pytest.raises(InvalidValueError, match="at least one policy"):
        write_leaderboard(tmp_path, {}, "")


def test_the_command_writes_all_three_files(
    recordings: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "new" / "folder"
    command = ["leaderboard", str(recordings), "--detections", "ego,1", "--policies", ",".join(POLICIES)]
    assert main([*command, "--out", str(out)]) == 0
    assert {path.name for path in out.iterdir()} == {"leaderboard.md", "leaderboard.csv", "leaderboard.svg"}
    shown = capsys.readouterr().out
    assert all(shown.count(name) == 2 for name in POLICIES)
    behind = (out / "leaderboard.md").read_text().split("## Methods of the policies")[1]
    assert all(f"- {name}: " in behind for name in POLICIES)
    (tmp_path / "file").write_text("")
    assert main([*command, "--out", str(tmp_path / "file")]) == 2
    assert "cannot make the folder" in capsys.readouterr().err


def test_ctrl_c_keeps_the_policies_that_are_finished(
    recordings: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def evaluated(policy: coopsim.Policy, *arguments: Any, **options: Any) -> RecordingsEvaluation:
        if type(policy) is coopsim.POLICIES.get(finished_before):
            raise KeyboardInterrupt
        return evaluate_recordings(policy, *arguments, **options)

    monkeypatch.setattr("coopsim.bench.leaderboard.evaluate_recordings", evaluated)
    out = tmp_path / "out"
    command = ["leaderboard", str(recordings), "--detections", "ego", "--policies", ",".join(POLICIES)]
    finished_before = POLICIES[0]
    assert main([*command, "--out", str(out)]) == INTERRUPTED
    assert list(out.iterdir()) == [] and "0 of 2 policies were ranked" in capsys.readouterr().err
    finished_before = POLICIES[1]
    assert main([*command, "--out", str(out)]) == INTERRUPTED
    shown = capsys.readouterr()
    assert "interrupted; 1 of 2 policies were ranked" in shown.err and shown.out.count("no_fusion") == 2
    assert "no_fusion" in (out / "leaderboard.csv").read_text()
