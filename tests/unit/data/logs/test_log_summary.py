"""A log is described, and leaves as a table that is the same log."""

from __future__ import annotations

from pathlib import Path

import log_files
import numpy as np
import pytest

from coopsim.cli.entry import main
from coopsim.data.logs.reading import read_log


@pytest.mark.parametrize("end", [".csv", ".parquet"])
def test_a_log_comes_back_from_its_table(tmp_path: Path, capsys: pytest.CaptureFixture[str], end: str) -> None:
    source = log_files.write_gzip(tmp_path / "a.fcd.xml.gz", log_files.FLOATING)
    assert main(["log", str(source), "--out", str(tmp_path / f"table{end}")]) == 0
    said = capsys.readouterr().out
    assert "road users: 3 (1 car, 1 bus, 1 pedestrian); 1 to 3 at once" in said
    one, other = read_log(source), read_log(tmp_path / f"table{end}")
    assert one.ids == other.ids
    for name in ("time_s", "place", "heading", "velocity", "size", "label"):
        np.testing.assert_array_equal(getattr(one, name), getattr(other, name))


def test_a_table_of_another_kind_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    source = log_files.write_gzip(tmp_path / "a.fcd.xml.gz", log_files.FLOATING)
    assert main(["log", str(source), "--out", str(tmp_path / "table.xlsx")]) != 0
    assert "must end in .csv or .parquet" in capsys.readouterr().err
