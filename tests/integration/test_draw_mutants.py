"""The script that draws mutants: what it changes, what it leaves, and what its verdicts are."""

from __future__ import annotations

import ast
import importlib.util
import subprocess
import sys
from pathlib import Path
from types import ModuleType

import pytest

SCRIPT = Path(__file__).parents[2] / "scripts" / "draw_mutants.py"

LIBRARY = '''
"""A limit."""
LIMIT: int = 3

def is_near(distance: float | None, *others: int) -> bool:
    if distance is None:
        raise ValueError(f"must be a number, not {1 + 2}")
    return distance < LIMIT
'''

TESTS = """
from coopsim.metrics.near import is_near

def test_is_near():
    assert is_near(1) and not is_near(3.5)
"""


@pytest.fixture(scope="module")
def script() -> ModuleType:
    spec = importlib.util.spec_from_file_location("draw_mutants", SCRIPT)
    assert spec and spec.loader
    module = sys.modules["draw_mutants"] = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_operators_numbers_and_functions_change_and_messages_and_types_do_not(script: ModuleType) -> None:
    mutants = script.find_mutants("coopsim/metrics/near.py", LIBRARY)
    assert [(each.line, each.before, each.after) for each in mutants] == [
        (3, "3", "(4)"),
        (6, "distance is None", "(distance is not None)"),
        (8, "distance < LIMIT", "(distance <= LIMIT)"),
    ]
    sign, _ = script.find_mutants("", "é = -max(a, b)")
    assert sign.applied("é = -max(a, b)".encode()).decode() == "é = (max(a, b))"


def test_each_mutant_of_a_room_is_another_program(script: ModuleType) -> None:
    drawn = script.draw(script.ROOT, "tracking", 60, seed=1)
    assert drawn[:20] == script.draw(script.ROOT, "tracking", 20, seed=1)
    assert drawn[:20] != script.draw(script.ROOT, "tracking", 20, seed=2)
    assert len({each.path for each in drawn}) > 5
    for mutant in drawn:
        source = (script.ROOT / mutant.path).read_bytes()
        assert ast.dump(ast.parse(mutant.applied(source))) != ast.dump(ast.parse(source))


def test_each_room_has_files_and_tests(script: ModuleType) -> None:
    for room in script.ROOMS:
        paths = sorted((script.ROOT / "coopsim" / room).rglob("*.py"))
        mutant = script.Mutant(str(paths[-1].relative_to(script.ROOT)), 1, 0, 1, "", "")
        stages = script.tests_of(script.ROOT, mutant, conformance=False)
        assert mutant.room == room and stages and all(stages), room
        assert all((script.ROOT / name).is_file() for stage in stages for name in stage)
    assert script.CONFORMANCE.keys() | script.BY_COMMANDS.keys() | set(script.BY_FOLDER) <= set(script.ROOMS)


@pytest.mark.long  # a dozen runs of pytest
def test_a_mutant_is_killed_by_tests_that_pass_without_it(
    script: ModuleType, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    near, tests = tmp_path / "coopsim/metrics/near.py", tmp_path / "tests/unit/metrics/test_near.py"
    for path, text in ((near, LIBRARY), (tests, TESTS + "\ndef test_broken():\n    assert False\n")):
        path.parent.mkdir(parents=True)
        path.write_text(text)
    (tests.parent / "test_unreadable.py").write_text("import coopsim.metrics.nowhere\n")
    for command in (["init", "-q"], ["add", "."]):
        subprocess.run(["git", *command], cwd=tmp_path, check=True)
    monkeypatch.setattr(script, "ROOT", tmp_path)
    out = tmp_path / "out.jsonl"
    command = ["--rooms", "metrics", "--out", str(out)]
    assert script.main([*command, "--minutes", "0"]) == 0 and not out.exists()
    capsys.readouterr()
    assert script.main(command) == 0
    said = capsys.readouterr().out
    assert "left out, as it fails without a mutant: tests/unit/metrics/test_near.py::test_broken" in said
    assert "left out, as it fails without a mutant: tests/unit/metrics/test_unreadable.py" in said
    (row,) = (line for line in said.splitlines() if line.startswith("| metrics"))
    assert row.split() == ["|", "metrics", "|", "2", "|", "0", "|", "1", "|", "0", "|", "67", "%", "|"]
    assert said.endswith("coopsim/metrics/near.py:8: distance < LIMIT -> (distance <= LIMIT)\n")
    assert near.read_text() == LIBRARY

    assert script.main(command) == 0  # it goes on where it was: nothing is left to do
    assert "left out" not in capsys.readouterr().out and len(out.read_text().splitlines()) == 3

    tests.write_text(TESTS.replace("3.5", "3"))
    assert script.main([*command, "--survivors"]) == 0
    assert "100 %" in capsys.readouterr().out and len(out.read_text().splitlines()) == 4
