"""The suite itself: what lets pytest collect it, and what keeps it quick."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from collections import Counter
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import held_times
import order
import pytest

TESTS = Path(__file__).parents[1]


def test_no_two_files_of_tests_have_one_name() -> None:
    """Without packages, pytest imports a file by its name alone, and refuses a second of that name."""
    counts = Counter(path.name for path in TESTS.rglob("test_*.py"))
    assert [name for name, count in counts.items() if count > 1] == []


SUITE = """
import time
import pytest

def compute(seconds):
    began = time.process_time()
    while time.process_time() < began + seconds:
        pass

def test_short():
    pass

def test_long():
    compute(0.4)

def test_waits():
    time.sleep(0.4)

@pytest.mark.heavy("it is about computing")
def test_let_off():
    compute(0.4)

def test_compiles():
    from numba import njit
    assert njit(lambda x: x + 1)(1) == 2
"""


def test_a_test_that_computes_for_long_fails(tmp_path: Path) -> None:
    (tmp_path / "test_some.py").write_text(SUITE)
    (tmp_path / "conftest.py").write_text(
        "import held_times\n"
        "def pytest_configure(config):\n"
        "    config.addinivalue_line('markers', 'heavy(reason): let off')\n"
        "    config.pluginmanager.register(held_times.HeldTimes(0.1))\n"
    )
    command = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", "-p", "no:xdist", str(tmp_path)]
    env = {"PYTHONPATH": str(TESTS / "helpers")}
    told = subprocess.run(command, env=env, cwd=tmp_path, capture_output=True, text=True, check=False).stdout
    assert "1 failed, 4 passed" in told, told
    assert "test_long - Failed: took 0." in told and "may take 0." in told


@pytest.mark.skipif(shutil.which("make") is None, reason="needs make")
def test_processes_of_make_keep_what_python_compiles(tmp_path: Path) -> None:
    (tmp_path / "told.mk").write_text('told:\n\t@echo "[$$PYTHONDONTWRITEBYTECODE]"\n')
    files = [flag for file in (TESTS.parent / "Makefile", tmp_path / "told.mk") for flag in ("-f", str(file))]
    env = {**os.environ, "PYTHONDONTWRITEBYTECODE": "1"}
    done = subprocess.run(["make", "-s", *files, "told"], env=env, capture_output=True, text=True, check=True)
    assert done.stdout == "[]\n"


def test_the_limit_is_higher_on_a_slower_machine(monkeypatch: pytest.MonkeyPatch) -> None:
    for work_s, limit_s in ((held_times.REFERENCE_S * 4, 12.0), (held_times.REFERENCE_S / 4, 3.0)):
        monkeypatch.setattr(held_times, "some_work", lambda work_s=work_s: work_s)
        assert held_times.HeldTimes(3.0)._limit_s == pytest.approx(limit_s)


def items(**files: int) -> list[Any]:
    return [SimpleNamespace(path=Path(f"/tests/{name}.py"), k=k) for name, count in files.items() for k in range(count)]


def test_slow_files_begin_both_halves(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(order, "SLOW", ("tests/c.py", "tests/d.py"))
    monkeypatch.setattr(order, "TRAINING", ("tests/a",))
    given = items(a=2, b=3, c=2, d=1, e=4)
    ordered = order.slow_first(given)
    assert "".join(each.path.stem for each in ordered) == "ccdbbb" + "aaeeee"
    assert sorted(map(id, ordered)) == sorted(map(id, given))
    assert [each.k for each in ordered if each.path.stem == "e"] == [0, 1, 2, 3]
    for few in ([], items(a=1), items(c=5), items(b=1)):
        assert sorted(map(id, order.slow_first(few))) == sorted(map(id, few))


def test_the_slow_files_exist() -> None:
    assert [name for name in (*order.SLOW, *order.TRAINING) if not (TESTS / name).exists()] == []
