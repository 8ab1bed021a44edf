"""One name for one quantity on the command line: old names still work, examples parse, shells complete."""

from __future__ import annotations

import argparse
import json
import shlex
import subprocess
from pathlib import Path

import pytest

import coopsim
from coopsim.bench.grid.cell import Cell, CellResult, Condition
from coopsim.bench.results.result_table import ResultTable
from coopsim.bench.text.bench_text import to_rows
from coopsim.cli import main
from coopsim.cli.detect_command import _noises
from coopsim.cli.entry import _COMMANDS, make_parser

EXAMPLES = [line for command in _COMMANDS.values() for line in command.examples]


def parsed(*words: str) -> argparse.Namespace:
    return make_parser().parse_args(words)


def test_every_command_shows_examples_that_parse() -> None:
    assert all(command.examples for command in _COMMANDS.values())
    for line in EXAMPLES:
        words = shlex.split(line.partition(" > ")[0].partition(" >> ")[0])
        assert words[0] == "coopsim" and callable(parsed(*words[1:]).command)


def test_help_shows_the_examples(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        parsed("bench", "--help")
    shown = capsys.readouterr().out
    assert all(line in shown for line in _COMMANDS["bench"].examples) and "--scenarios" not in shown


@pytest.mark.parametrize(
    ("command", "old", "new", "value"),
    [
        ("bench", "--scenarios", "--environments", "crossing,highway"),
        ("detect", "--delays-ms", "--latencies-ms", "0,200"),
        ("detect", "--jobs", "--workers", "2"),
    ],
)
def test_an_old_name_is_the_new_one_with_a_notice(
    command: str, old: str, new: str, value: str, capsys: pytest.CaptureFixture[str]
) -> None:
    before, after = parsed(command, old, value), parsed(command, new, value)
    assert vars(before) | {"parser": None} == vars(after) | {"parser": None}
    told = capsys.readouterr().err
    assert old in told and new in told and len(told.splitlines()) == 1


def test_pairs_of_noises_are_what_the_old_option_gave(capsys: pytest.CaptureFixture[str]) -> None:
    axes = ("detect", "--position-noises-m", "0,0.4", "--heading-noises-deg", "0,0.2")
    assert _noises(parsed("detect", "--noise", "0/0,0.4/0.2")) == ((0, 0), (0.4, 0.2))
    assert "--position-noises-m" in capsys.readouterr().err
    assert _noises(parsed(*axes, "--pose", "together")) == ((0, 0), (0.4, 0.2))
    assert _noises(parsed(*axes)) == ((0, 0), (0, 0.2), (0.4, 0), (0.4, 0.2))
    assert _noises(parsed("detect", "--heading-noises-deg", "1")) == ((0, 1),)
    assert _noises(parsed("detect")) == ()


def test_noise_is_given_once(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["detect", "--noise", "0/0", "--position-noises-m", "0.4"]) == 2
    assert "noise must be given once" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("typo", "told", "left_out"),
    [("--polices", "Did you mean --policies", "Accepted"), ("--qqq", "Accepted: --help", "--scenarios")],
)
def test_options_are_listed_only_where_none_is_close(
    typo: str, told: str, left_out: str, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit):
        parsed("bench", typo, "a")
    shown = capsys.readouterr().err
    assert told in shown and left_out not in shown


def test_a_detector_is_given_once(capsys: pytest.CaptureFixture[str]) -> None:
    flags = ["--policies", "no_fusion", "--detector", "simulated", "--option", "detector=pillars"]
    assert main(["bench", *flags, "--dry-run"]) == 2
    assert "detector must be given once" in capsys.readouterr().err


def test_a_grid_file_may_name_environments(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    grid = tmp_path / "grid.yaml"
    grid.write_text("policies: [no_fusion]\nenvironments: [crosing]\n")
    assert main(["bench", "--grid", str(grid), "--out", str(tmp_path / "out"), "--dry-run"]) == 2
    assert f"{grid}:2: unknown environment 'crosing'. Did you mean 'crossing-v3'" in capsys.readouterr().err
    grid.write_text("policies: [no_fusion]\nenvironments: [crossing]\nscenarios: [crossing]\n")
    assert main(["bench", "--grid", str(grid), "--dry-run"]) == 2
    assert "one list too many" in capsys.readouterr().err


def test_every_kind_has_names_and_descriptions(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["list", "--json"]) == 0
    kinds = json.loads(capsys.readouterr().out)
    for kind, entries in kinds.items():
        assert entries, kind
        for entry in entries:
            assert entry["description"] and "\n" not in entry["description"], entry
    assert main(["list", "policies", "--json"]) == 0
    policies = {entry["name"]: entry for entry in json.loads(capsys.readouterr().out)}
    assert set(policies) == set(coopsim.POLICIES) and policies["attfuse"]["uplink"] == "features"


def test_a_kind_is_listed_line_by_line(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["list", "scenario-files"]) == 0
    shown = capsys.readouterr().out
    assert "rainy_highway.yaml" in shown and "Rain, spray on the road and late messages" in shown
    assert main(["list", "polices"]) == 2
    assert "Did you mean 'policies'" in capsys.readouterr().err


def test_info_describes_the_machine(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("COOPSIM_DATA", str(tmp_path / "missing"))
    assert main(["info", "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert told["coopsim"] == coopsim.__version__ and "numpy" in told["packages"] and "pillars" in told["weights"]
    assert "no such folder" in told["data"] and {"OpenGL", "torch", "python"} <= set(told)


@pytest.mark.parametrize(
    ("typed", "completed"),
    [
        ("coopsim de", "demo detect"),
        ("coopsim list pol", "policies"),
        ("coopsim bench --policies no_fusion,attf", "no_fusion,attfuse"),
        ("coopsim bench --pose to", "together"),
        ("coopsim detect --latenc", "--latencies-ms"),
        ("coopsim detect --delay", ""),
        ("coopsim town --junc", "--junctions"),
    ],
)
def test_bash_completes(script: Path, typed: str, completed: str) -> None:
    words = shlex.join(typed.split())
    code = f"source {script}; COMP_WORDS=({words}); COMP_CWORD=$((${{#COMP_WORDS[@]}} - 1)); _coopsim"
    done = subprocess.run(["bash", "-c", f'{code}; echo "${{COMPREPLY[@]}}"'], capture_output=True, text=True)
    assert (done.stdout.strip(), done.stderr) == (completed, "")


@pytest.fixture(scope="module")
def script(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("completion") / "coopsim.bash"
    with path.open("w") as file, pytest.MonkeyPatch.context() as patch:
        patch.setattr("sys.stdout", file)
        assert main(["completion", "bash"]) == 0
    return path


def test_rows_of_a_benchmark_are_json_for_every_policy_and_condition() -> None:
    cells = [
        Cell("no_fusion", Condition("crossing", latency_s=latency_s), seed, 5)
        for latency_s in (0.0, 0.3)
        for seed in (0, 1)
    ]
    results = [CellResult(cell, values={"AMOTA": 10.0 * cell.seed, "MOTP": float("nan")}) for cell in cells]
    rows = to_rows(ResultTable.of(results))
    assert [(row["policy"], row["latency_s"], row["bandwidth_bit_s"]) for row in rows] == [
        ("no_fusion", 0.0, None), ("no_fusion", 0.3, None)
    ]  # fmt: skip
    assert rows[0]["metrics"]["AMOTA"]["mean"] == 5.0
    assert rows[0]["metrics"]["AMOTA"]["low"] < 5.0 < rows[0]["metrics"]["AMOTA"]["high"]
    json.dumps(rows, allow_nan=False)
