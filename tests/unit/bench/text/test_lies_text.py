"""What lies cost and what defences win back, from results whose answers are known."""

from __future__ import annotations

from coopsim.bench.grid.cell import Cell, CellResult, Condition
from coopsim.bench.results.result_table import ResultTable
from coopsim.bench.text.lies_text import to_lies_markdown

GHOST = "cav_1=ghost"
BASE = {"late_fusion": 60.0, "late_fusion(defense=made)": 58.0}
"""Honest scores; seeds add 1 each, the ghost takes 10 and 4 points."""


def table() -> ResultTable:
    results = []
    for policy, score in BASE.items():
        for seed in range(5):
            for attacks, lost in (("", 0.0), (GHOST, 10.0 if policy == "late_fusion" else 4.0)):
                found = (
                    {} if policy == "late_fusion" else {"attacker_FPR": 2.0} | ({"attacker_TPR": 70.0} if lost else {})
                )
                values = {"sAMOTA": score + seed - lost, "ghosts_believed": 100.0 if lost else float("nan"), **found}
                results.append(CellResult(Cell(policy, Condition(attacks=attacks), seed), values))
    return ResultTable.of(results)


def row(text: str, heading: str, start: str) -> list[str]:
    """Return the cells of the row that begins so, in the table below a heading."""
    part = text.split(f"## {heading}\n")[1].split("\n## ")[0]
    found = next(line for line in part.splitlines() if line.startswith(f"| {start}"))
    return [cell.strip() for cell in found.strip("|").split("|")]


def test_changes_are_paired_by_seed() -> None:
    text = to_lies_markdown(table())
    assert row(text, "sAMOTA under attack", "nobody lies")[1:] == ["62.0", "60.0"]
    # Every seed changes alike, so intervals have no length, though seeds differ from each other.
    assert row(text, "What lies cost", GHOST)[1:] == ["-10.0 (-10.0 to -10.0)", "-4.0 (-4.0 to -4.0)"]
    assert row(text, "What defences win back", "nobody lies")[1:] == ["-2.0 (-2.0 to -2.0)"]
    assert row(text, "What defences win back", GHOST)[1:] == ["+4.0 (+4.0 to +4.0)"]


def test_what_defences_find_is_apart_from_what_they_doubt_wrongly() -> None:
    text = to_lies_markdown(table())
    assert row(text, "Liars found", "late_fusion(defense=made)")[1:] == ["70.0", "2.0"]
    assert row(text, "Honest senders doubted", "late_fusion(defense=made)")[1:] == ["2.0"]
    assert row(text, "Lies believed", GHOST)[1:] == ["late_fusion", "100.0"]
    assert "nobody lies" not in text.split("## Lies believed")[1]
    assert text.endswith("Intervals are of 95 %, over 5 seeds.\n")
