"""Costs of lies on the road: crashes against the honest twin, and brakes and time that they take."""

from __future__ import annotations

from dataclasses import replace

from coopsim.bench.grid.cell import CellResult, Condition
from coopsim.bench.results.result_table import ResultTable
from coopsim.bench.safety.lie_costs import lie_costs
from coopsim.bench.safety.safety_text import to_safety_markdown
from tests.helpers.crashes import crash_results

GHOST = "cav_1=ghost"
CONDITIONS = [
    Condition(name, latency_s=late, attacks=lie) for name in ("a", "b") for late in (0.0, 0.3) for lie in ("", GHOST)
]


def _crashes(policy: str, condition: Condition, seed: int) -> bool:
    if policy in ("no_fusion", "truth"):
        return policy == "no_fusion"
    return seed < 3 if condition.attacks else seed == 9


def _braking(result: CellResult) -> CellResult:
    lied = bool(result.cell.condition.attacks) and result.cell.policy not in ("no_fusion", "truth")
    later = 100.0 * result.cell.condition.latency_s
    return replace(result, values={**result.values, "phantom_brakes": 1.0 + lied + later, "time_lost": 2.0 * lied})


TABLE = ResultTable.of([_braking(each) for each in crash_results(_crashes, CONDITIONS)])


def test_each_attack_is_compared_with_its_honest_twin_while_nothing_else_disturbs() -> None:
    found = {each.policy: each for each in lie_costs(TABLE)}
    assert set(found) == {"late_fusion", "coop_fuse", "sequential_kf"}, "who is told nothing cannot be lied to"
    late = found["late_fusion"]
    assert (late.attack, late.crash.pairs, late.crash.less, late.crash.more) == (GHOST, 20, 2, 6)
    assert (late.crash.alone, late.crash.sharing) == (10.0, 30.0) and late.crash.change.mean == 20.0
    assert {name: each.change.mean for name, each in late.costs.items()} == {"phantom_brakes": 1.0, "time_lost": 2.0}


def test_the_answers_on_safety_have_a_section_of_it() -> None:
    rows = [" ".join(line.split()) for line in to_safety_markdown(TABLE).splitlines()]
    assert "## What lies cost" in rows
    assert any(row.startswith(f"| {GHOST} | late_fusion | 20 | 10 % | 30 % | 2 | 6 | +20.0 (") for row in rows)
    assert f"| {GHOST} | late_fusion | +1.00 (+1.00 to +1.00) | +2.00 (+2.00 to +2.00) |" in rows
    honest = ResultTable.of([each for each in TABLE.results if not each.cell.condition.attacks])
    assert "What lies cost" not in to_safety_markdown(honest) and not list(lie_costs(honest))
