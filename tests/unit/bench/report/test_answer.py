"""The answer on top of a report: what was asked, yes or no with an interval, and where it ends."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import pytest
from html_page import Page

from coopsim.bench.grid.cell import Cell, CellResult, Condition
from coopsim.bench.report.answer import Answer, _crashes, answer_of
from coopsim.bench.report.bench_report import About, render_bench_report
from coopsim.bench.results.result_table import ResultTable
from tests.helpers.crashes import RATES, crash_results

LATE = [Condition("crossing", latency_s=each) for each in (0.0, 0.3)]
Values = Callable[[Cell], dict[str, float]]
SAMOTA = {"no_fusion": 50.0, "late_fusion": 70.0, "coop_fuse": 72.0}


def made(policies: Sequence[str], conditions: Sequence[Condition], seeds: int, values: Values) -> ResultTable:
    """Make a result for each policy, condition and seed."""
    cells = [Cell(each, where, seed, 40) for each in policies for where in conditions for seed in range(seeds)]
    return ResultTable.of([CellResult(each, values(each)) for each in cells])


def tracked(seeds: int = 8, conditions: tuple[Condition, ...] = (LATE[0],), **scores: float) -> ResultTable:
    """Make results in sAMOTA, with a seed's own offset for all; those of the latency fall to that of nobody."""

    def values(cell: Cell) -> dict[str, float]:
        policy, seed = cell.policy, cell.seed
        score = (
            (SAMOTA | scores)[policy]
            if cell.condition.latency_s == 0
            else 50.0 - 0.5 * (seed % 2) * (policy != "no_fusion")
        )
        sent = 0.0 if policy == "no_fusion" else 4100.0
        return {"sAMOTA": score + seed + 0.2 * (seed % 3) * (policy != "no_fusion"), "bytes_per_s": sent}

    return made(list(SAMOTA), conditions, seeds, values)


def found(table: ResultTable) -> Answer:
    """Return the answer, which has to be there."""
    answer = answer_of(table)
    assert answer is not None
    return answer


def test_trackers_are_asked_whether_messages_help() -> None:
    answer = found(tracked())
    assert answer.question == "Do messages help to track?"
    assert answer.verdict.startswith(
        "Yes: with coop_fuse, the best of 2 policies, sAMOTA is 75.7, without messages (no"
    )
    assert answer.verdict.endswith(" over 8 seeds.") and "+22.2 (+2" in answer.verdict
    points = dict(answer.points)
    assert points["What it costs"] == "An agent sends 4.1 kB/s."
    assert points["Other policies"] == "A gain is shown of late_fusion, too."


def test_no_and_not_shown_are_said() -> None:
    assert found(tracked(late_fusion=40.0, coop_fuse=41.0)).verdict.startswith("No: with coop_fuse")
    assert found(tracked(seeds=2)).verdict.startswith("Not shown: ")
    assert found(tracked(seeds=1)).verdict.startswith("In one seed, which shows little: ")


def test_the_end_of_the_gain_is_told() -> None:
    points = dict(found(tracked(conditions=tuple(LATE))).points)
    assert points["Under latency"].startswith("A gain is shown at 0 ms alone: +22.2 (")
    steady = dict(found(ResultTable.of(crash_results(conditions=LATE))).points)
    assert steady["Under latency"].startswith(("The gain holds: ", "No gain is shown: "))


def test_crashes_are_counted_and_bounds_do_not_compete() -> None:
    answer = found(ResultTable.of(crash_results(conditions=LATE)))
    assert answer.question == "Do messages prevent crashes?" and "crashes avoided, 0 caused" in answer.verdict
    assert "truth" not in answer.verdict and (_crashes(1), _crashes(0)) == ("1 crash", "0 crashes")


@pytest.mark.parametrize(("metric", "deed"), [("APBEV@0.5", "detect"), ("mine", "have a better mine")])
def test_the_question_names_what_the_metric_measures(metric: str, deed: str) -> None:
    def values(cell: Cell) -> dict[str, float]:
        return {metric: float(len(cell.policy) + cell.seed), "bytes_per_s": float(cell.policy != "no_fusion")}

    table = made(["no_fusion", "late_fusion"], LATE[:1], 4, values)
    assert found(table).question == f"Do messages help to {deed}?"


def test_without_a_silent_policy_the_best_is_named() -> None:
    loud = ResultTable.of([each for each in tracked().results if each.cell.policy != "no_fusion"])
    answer = found(loud)
    assert answer.question == "Which policy has the best sAMOTA?" and answer.verdict.startswith(
        "coop_fuse has a sAMOTA"
    )
    one = ResultTable.of([each for each in loud.results if each.cell.policy == "coop_fuse"])
    assert found(one).question == "How good is coop_fuse?"


def test_lies_are_told() -> None:
    lied = ResultTable.of(crash_results(conditions=[Condition("merge", attacks=each) for each in ("", "cav_1=ghost")]))
    assert dict(found(lied).points)["What a liar does"].startswith("With cav_1=ghost crash changes by ")


def lied(harm: Callable[[str], float], progress: float = 0.0, lies: Sequence[str] = ("", "cav_1=ghost")) -> ResultTable:
    """Make drives of which a share ends in a crash: all alone, with messages `harm` of 10, by the attack."""

    def values(cell: Cell) -> dict[str, float]:
        alone, attack = cell.policy == "no_fusion", cell.condition.attacks
        crash = 100.0 if alone or cell.seed < harm(attack) else 0.0
        way = 90.0 - cell.seed % 3 - (progress if attack and not alone else 0.0)
        return {"crash": crash, "progress": way, "bytes_per_s": 0.0 if alone else 4000.0}

    return made(["no_fusion", "late_fusion"], [Condition("merge", attacks=each) for each in lies], 10, values)


def test_a_benchmark_of_lies_asks_what_a_liar_can_do() -> None:
    answer = found(lied(lambda attack: 9.0 if attack else 0.0))
    assert answer.question == "What can a liar do?"
    assert answer.verdict.startswith("It does harm: under cav_1=ghost, the car crashes in 90 % instead of 0 % of 10")
    assert "9 crashes caused, 0 avoided" in answer.verdict
    assert dict(answer.points)["While nobody lies"].startswith("Yes: with late_fusion the car crashes in 0 %")
    assert found(lied(lambda attack: 0.0)).verdict.startswith("No harm is shown: under cav_1=ghost")


@pytest.mark.parametrize(("pairs", "verdict"), [(6, "Not shown: "), (20, "Yes: ")])
def test_a_few_pairs_show_nothing_though_their_interval_has_no_zero(pairs: int, verdict: str) -> None:
    """Half of the runs alone crash, none with messages: of six pairs McNemar's p is .25, of twenty .002."""

    def values(cell: Cell) -> dict[str, float]:
        alone = cell.policy == "no_fusion"
        return {"crash": 100.0 * (alone and cell.seed % 2 == 0), "bytes_per_s": 0.0 if alone else 1.0}

    table = made(["no_fusion", "late_fusion"], [Condition("merge")], pairs, values)
    assert found(table).verdict.startswith(verdict)


def test_a_lie_that_stops_the_car_is_told_though_nothing_crashes() -> None:
    answer = found(lied(lambda attack: 0.0, progress=40.0))
    assert answer.verdict.startswith(
        "No more crashes are shown, but under cav_1=ghost the car pays: progress (%) -40.0"
    )
    assert "progress (%) -40.0" in dict(answer.points)["What a liar does"]


def test_of_many_steps_along_an_axis_those_are_told_at_which_the_gain_ends() -> None:
    steps = [Condition("crossing", latency_s=each) for each in (0.0, 0.1, 0.2, 0.3, 0.5, 0.8)]

    def values(cell: Cell) -> dict[str, float]:
        late = cell.condition.latency_s > 0.25 or cell.policy == "no_fusion"
        return {"sAMOTA": 50.0 + cell.seed + 20.0 * (not late), "bytes_per_s": float(cell.policy != "no_fusion")}

    text = dict(found(made(["no_fusion", "late_fusion"], steps, 6, values)).points)["Under latency"]
    assert text.startswith("A gain is shown at 0 ms, 100 ms and 200 ms alone: +20.0")
    assert [
        each
        for each in ("at 0 ms", "at 100 ms", "at 200 ms", "at 300 ms", "at 500 ms", "at 800 ms")
        if f") {each}" in text or f"+0.0 {each}" in text
    ] == ["at 0 ms", "at 200 ms", "at 300 ms", "at 800 ms"]


def test_a_report_begins_with_it_unless_a_title_was_asked_for() -> None:
    table = ResultTable.of(crash_results(lambda policy, condition, seed: seed < RATES[policy], conditions=LATE))
    page = Page(render_bench_report(table, About()))
    assert page.texts("h1") == ["Do messages prevent crashes?"]
    assert found(table).verdict in page.texts("p")
    assert Page(render_bench_report(table, About("Ours"))).texts("h1") == ["Ours"]


def test_drives_of_both_kinds_are_told_apart_and_as_traffic_has_them_comes_first() -> None:
    both = [Condition("interaction(kind=cut_in)"), Condition("merge_barrier")]
    results = crash_results(
        lambda policy, condition, seed: seed < RATES[policy] * (condition.scenario == "merge_barrier"), conditions=both
    )
    answer = answer_of(ResultTable.of(results))
    assert answer is not None and answer.question == "Do messages prevent crashes?"
    heads = [head for head, _ in answer.points]
    assert heads[:2] == ["Drives as traffic has them", "Drives made to need messages"]
    assert "crashes in 0.0 % of 10 drives" in answer.points[0][1]
    assert "crashes in 50.0 % of 10 drives, with messages in 20.0 %" in answer.points[1][1]
