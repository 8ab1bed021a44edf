"""The arithmetic of networks as a setting."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from coopsim.errors import UnknownNameError
from coopsim.support import precision
from coopsim.support.precision import PRECISION, arithmetic, multiplies_bfloat16, set_precision
from coopsim.support.processes import ray_environment, start_python


@pytest.fixture(autouse=True)
def unset(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(PRECISION, "")  # so that it is put back, too


@pytest.mark.parametrize("has", [True, False])
def test_what_is_set_is_the_arithmetic_and_auto_asks_the_processor(has: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(precision, "multiplies_bfloat16", lambda: has)
    assert arithmetic() == ("bfloat16" if has else "float32")
    for name in ("float32", "bfloat16"):
        set_precision(name)
        assert arithmetic() == name
    set_precision("auto")
    assert arithmetic() == ("bfloat16" if has else "float32")


def test_a_wrong_setting_is_one_clear_error(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(PRECISION, "bf16")
    with pytest.raises(UnknownNameError, match=r"unknown COOPSIM_PRECISION 'bf16'.*Accepted: auto, bfloat16, float32"):
        arithmetic()
    with pytest.raises(UnknownNameError, match="unknown precision 'half'"):
        set_precision("half")


def test_worker_processes_compute_as_their_parent() -> None:
    for name in ("float32", "bfloat16"):
        set_precision(name)
        worker = start_python("from coopsim.support.precision import arithmetic; print(arithmetic())")
        assert worker.communicate()[0].decode().strip() == name
        assert ray_environment()["env_vars"][PRECISION] == name
    set_precision("auto")  # another machine may have another processor
    assert ray_environment()["env_vars"][PRECISION] == arithmetic()


def test_the_processor_is_asked_without_torch_and_answers_as_torch_does(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    program = "import sys; from coopsim.support.precision import arithmetic as f; f(); print('torch' in sys.modules)"
    if precision._LINUX.is_file():
        done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
        assert done.stdout.strip() == "False"
    pytest.importorskip("torch")
    read = multiplies_bfloat16.__wrapped__()
    monkeypatch.setattr(precision, "_LINUX", tmp_path / "nothing")
    assert multiplies_bfloat16.__wrapped__() == read


@pytest.mark.parametrize(("flags", "has"), [("fpu avx512_bf16", True), ("amx_tile", True), ("avx512f bf16x", False)])
def test_flags_of_a_processor_on_linux(flags: str, has: bool, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    told = tmp_path / "cpuinfo"
    told.write_text(f"processor\t: 0\nflags\t\t: {flags}\n\nmodel name\t: amx_tile of nobody\n")
    monkeypatch.setattr(precision, "_LINUX", told)
    assert multiplies_bfloat16.__wrapped__() is has
