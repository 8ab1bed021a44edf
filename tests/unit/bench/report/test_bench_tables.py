"""Tables of the report: large numbers can be read, and the best of a column is marked whatever their form."""

from __future__ import annotations

import pytest

from coopsim.bench.grid.cell import Cell, CellResult, Condition
from coopsim.bench.report.bench_tables import condition_table
from coopsim.bench.results.result_table import ResultTable

SENT = {"early_fusion": 1_234_567.0, "attfuse": 980_000.0, "late_fusion": 4100.0}


@pytest.fixture
def table() -> ResultTable:
    """One run of each policy."""
    cells = {name: Cell(name, Condition(), 0, 20) for name in SENT}
    return ResultTable.of([CellResult(cells[name], {"sAMOTA": 50.0, "bytes_per_s": SENT[name]}) for name in SENT])


def test_bytes_have_commas_and_the_fewest_are_marked(table: ResultTable) -> None:
    html = condition_table(table, 0)
    assert all(f"{sent:,.0f}" in html for sent in SENT.values()) and "1234567" not in html
    (best,) = [part for part in html.split("<td") if "best" in part]
    assert "4,100" in best
