"""The script that compares methods in maps with the same methods in drawn towns."""

from __future__ import annotations

import re
import sys
from collections.abc import Mapping
from pathlib import Path

import measure_maps
import pytest
import rank_policies
from synthetic_results import EFFECTS, results

from coopsim.bench.grid.cell import Condition
from coopsim.errors import InvalidValueError

SEEDS = tuple(range(12))
Worlds = Mapping[str, Mapping[str, float]]


def printed(
    worlds: Worlds, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> list[list[list[str]]]:
    """Return the cells of the tables of one metric, by table, row and column."""
    files = {name: Condition(scenario=f"maps/{name}.xodr.gz") for name in worlds}
    runs = {name: results(effects, [files[name]], SEEDS) for name, effects in worlds.items()}
    monkeypatch.setattr(measure_maps, "stored_results", lambda folder: runs[folder.name])
    monkeypatch.setattr(rank_policies, "DRAWS", 100)
    monkeypatch.setattr(sys, "argv", ["measure_maps.py", *worlds, "--metrics", "sAMOTA", "--against", "middling"])
    measure_maps.main()
    blocks = [block.splitlines() for block in capsys.readouterr().out.split("\n\n") if block.startswith("|")]
    return [[[cell.strip() for cell in line.strip("|").split("|")] for line in block] for block in blocks]


def test_the_same_world_has_the_same_order_and_leads(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    scores, leads, orders = printed({"town": EFFECTS, "map": EFFECTS}, monkeypatch, capsys)
    assert [row[0] for row in scores[2:]] == ["good", "middling", "bad"]
    assert [row[0] for row in leads[2:]] == ["good", "bad"]
    assert leads[2][1].startswith("10.") or leads[2][1].startswith("9.")
    assert orders[2] == ["map", "1.00 (1.00 to 1.00)", "1.00 (1.00 to 1.00)"]


def test_a_world_in_which_two_methods_change_places(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    swapped = {**EFFECTS, "good": EFFECTS["middling"], "middling": EFFECTS["good"]}
    _, leads, orders = printed({"town": EFFECTS, "map": swapped}, monkeypatch, capsys)
    change, low, high = map(float, re.findall(r"-?[\d.]+", leads[2][3]))
    assert low < -20.0 < high and low < change < high  # from 10 points ahead to 10 behind
    assert orders[2] == ["map", "0.50 (0.50 to 0.50)", "0.33 (0.33 to 0.33)"]


def test_worlds_that_cannot_be_compared_are_named(monkeypatch: pytest.MonkeyPatch) -> None:
    runs = {
        "town": results(EFFECTS, [Condition()], SEEDS),
        "few": results(EFFECTS, [Condition()], SEEDS[:5]),
        "late": results(EFFECTS, [Condition(), Condition(latency_s=0.1)], SEEDS),
        "others": results({"other": 1.0}, [Condition()], SEEDS),
    }
    monkeypatch.setattr(measure_maps, "stored_results", lambda folder: runs[folder.name])
    for name, said in (("few", "same seeds"), ("late", "one condition, got several"), ("others", "policies in common")):
        with pytest.raises(InvalidValueError, match=said):
            measure_maps.scores_of([Path("town"), Path(name)], "sAMOTA")
