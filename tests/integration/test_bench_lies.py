"""Attacks as an axis of a benchmark: in cells, keys, options, labels and the store."""

from __future__ import annotations

from pathlib import Path

import pytest

from coopsim.bench.grid.cell import Cell, CellResult, Condition, environment_options
from coopsim.bench.grid.grid import Grid
from coopsim.bench.grid.grid_file import find_grid
from coopsim.bench.grid.labels import label, mildest
from coopsim.bench.store.cell_file import decode, encode
from coopsim.bench.store.fingerprint import fingerprint
from coopsim.catalog import PolicySpec
from coopsim.errors import CoopsimError

GHOST = "cav_1=ghost(ahead_m=15)"


def key(condition: Condition) -> str:
    return fingerprint(Cell("no_fusion", condition), {}, PolicySpec.parse("no_fusion"))


def test_an_honest_condition_is_what_it_was_before_there_were_attacks() -> None:
    assert "attacks" not in dict(Condition().settings)
    assert "attacks" not in environment_options(Cell("no_fusion", Condition()), {})
    assert "attacks" not in key(Condition())


def test_an_attack_is_in_the_key_the_options_and_the_stored_cell(tmp_path: Path) -> None:
    lied = Condition(attacks=GHOST)
    assert key(lied) != key(Condition())
    assert environment_options(Cell("no_fusion", lied), {})["attacks"] == GHOST
    back, _ = decode(encode(CellResult(Cell("no_fusion", lied)), "{}"))
    assert back.cell.condition == lied
    mine = tmp_path / "mine.py"
    mine.write_text("import coopsim\nclass Mine(coopsim.Attack):\n    def send(self, view, message): return None\n")
    before = key(Condition(attacks=f"cav_1={mine}:Mine"))
    mine.write_text(mine.read_text() + "# changed\n")
    assert key(Condition(attacks=f"cav_1={mine}:Mine")) != before


def test_a_grid_has_conditions_by_attack_of_which_honesty_is_the_mildest() -> None:
    grid = Grid(["no_fusion"], attacks=["none", GHOST, "rsu_0=remove"])
    conditions = list(grid.conditions())
    assert [each.attacks for each in conditions] == ["", GHOST, "rsu_0=remove"]
    assert mildest(conditions) == (Condition(),)
    assert [label(each, conditions) for each in conditions] == [
        "nobody lies",
        f"attacks {GHOST}",
        "attacks rsu_0=remove",
    ]
    with pytest.raises(CoopsimError, match="gost"):
        Grid(["no_fusion"], attacks=["cav_1=gost"])


def test_the_preset_lies_is_a_grid() -> None:
    attacks = {condition.attacks for condition in find_grid("lies").grid().conditions()}
    assert "" in attacks and len(attacks) > 8
