"""Ctrl-C at any moment is one line and an exit status, and is never lost."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

import coopsim
from coopsim.cli import entry, main
from coopsim.cli.arguments import INTERRUPTED

COMMAND = "import sys\nfrom coopsim.cli import main\nsys.exit(main())\n"  # as pip writes it


def test_ctrl_c_while_the_command_imports_is_one_line(tmp_path: Path) -> None:
    (tmp_path / "coopsim").write_text(COMMAND)
    (tmp_path / "gymnasium.py").write_text("raise KeyboardInterrupt")  # which `import coopsim` imports
    path = os.pathsep.join([str(tmp_path), str(Path(coopsim.__file__).parents[1])])
    command = [sys.executable, str(tmp_path / "coopsim"), "list"]
    done = subprocess.run(command, capture_output=True, text=True, env=os.environ | {"PYTHONPATH": path})
    assert done.stderr == "coopsim: interrupted\n"
    assert done.returncode in (-signal.SIGINT, INTERRUPTED)


def test_others_keep_their_tracebacks(tmp_path: Path) -> None:
    (tmp_path / "mine.py").write_text("import coopsim\nraise KeyboardInterrupt")
    done = subprocess.run([sys.executable, str(tmp_path / "mine.py")], capture_output=True, text=True)
    assert "Traceback" in done.stderr and "coopsim: interrupted" not in done.stderr


class Interrupted:
    """An object that is interrupted as it is removed, where Python drops exceptions."""

    def __del__(self) -> None:
        signal.raise_signal(signal.SIGINT)
        for _ in range(1000):  # until Python looks
            pass


def test_an_interrupt_that_python_drops_comes_again(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def run(options: object) -> int:
        Interrupted()
        time.sleep(20)
        return 0

    monkeypatch.setitem(entry._COMMANDS, "list", entry.LIST._replace(run=run))
    hook, before = sys.unraisablehook, signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        assert main(["list"]) == INTERRUPTED
    finally:
        signal.signal(signal.SIGINT, before)
    assert capsys.readouterr().err == "coopsim: interrupted\n"
    assert sys.unraisablehook is hook
