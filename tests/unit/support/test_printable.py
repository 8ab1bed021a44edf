"""Names that would steer a terminal."""

from __future__ import annotations

import pytest

import coopsim
from coopsim.bench.grid.cell import Cell, Condition
from coopsim.catalog import PolicySpec
from coopsim.cli.entry import main
from coopsim.errors import InvalidValueError
from coopsim.support.printable import printable
from coopsim.support.registry import Registry

ESCAPE, TURNED, ERASED = "late\x1b[2Jfusion", "late\u202efusion", "late\rfusion"


def test_what_does_not_print_is_escaped() -> None:
    assert printable("Zürich, 東京, 3 m²") == "Zürich, 東京, 3 m²"
    assert printable(f"{ESCAPE}\n{TURNED}", "\n") == r"late\x1b[2Jfusion" + "\n" + r"late\u202efusion"


@pytest.mark.parametrize("name", [ESCAPE, TURNED, ERASED])
def test_names_that_do_not_print_are_refused(name: str, capsys: pytest.CaptureFixture[str]) -> None:
    registry: Registry[int] = Registry("fruit")
    for refused in (
        lambda: coopsim.make_policy(name),
        lambda: PolicySpec.parse(f"{name}.py:X"),
        lambda: coopsim.parallel_env(f"{name}.yaml"),
        lambda: registry.register(name)(1),
        lambda: Cell(name, Condition()),
        lambda: Condition(scenario=name),
    ):
        with pytest.raises(InvalidValueError, match="must have characters that print, got"):
            refused()
    assert main(["demo", "--environment", name, "--frames", "1"]) == 2
    said = capsys.readouterr().err
    assert said.strip().isprintable() and said.count("\n") == 1


def test_a_path_in_an_error_is_escaped(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["report", f"nowhere/{ESCAPE}"]) == 2
    assert capsys.readouterr().err.strip().isprintable()
