"""Pairs with a lie in a report: chosen by their cost, played side by side, with the lie marked."""

from __future__ import annotations

import base64
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from jobs_here import no_workers

from coopsim.bench.benchmark import benchmark
from coopsim.bench.films.choice import Films
from coopsim.bench.films.lie_pairs import FilmedLie, filmed_lies, lie_pairs
from coopsim.bench.grid.cell import Cell, CellResult, Condition
from coopsim.bench.grid.grid import Grid
from coopsim.bench.report.film_data import UNIT_M
from coopsim.bench.report.lie_figures import lie_figure
from coopsim.bench.report.publish import publish
from coopsim.bench.results.result_table import ResultTable
from tests.helpers.html_page import Page

GHOST = "cav_1=ghost(ahead_m=15, start_s=1)"
GRID = Grid(("late_fusion",), attacks=("none", GHOST), seeds=(3,), frames=25)


@pytest.fixture(scope="module")
def results(tmp_path_factory: pytest.TempPathFactory) -> list[CellResult]:
    with no_workers():
        return benchmark(GRID, tmp_path_factory.mktemp("lies"), films=True)


@pytest.fixture(scope="module")
def filmed(results: list[CellResult]) -> FilmedLie:
    (pair,) = lie_pairs(ResultTable.of(results), 5)
    films = Films()
    (made,) = filmed_lies([pair], films)
    assert not films.notes
    return made


@pytest.fixture(scope="module")
def data(results: list[CellResult], filmed: FilmedLie) -> dict[str, Any]:
    return lie_figure(filmed, ResultTable.of(results)).data


def boxes(text: str) -> np.ndarray[Any, Any]:
    return np.frombuffer(base64.b64decode(text), "<i4").reshape(-1, 6)


def result(policy: str, attacks: str, seed: int, score: float, bound: bool = False) -> CellResult:
    values = {"sAMOTA": score, "bytes_per_s": 9.0}
    agents = {"cav_0": {"sAMOTA": score - 1}, "cav_1": {"sAMOTA": 0.0}, "cav_2": {"sAMOTA": 70.0}}
    return CellResult(Cell(policy, Condition(attacks=attacks), seed, 25), values, agents, np.ones(25), bound=bound)


def test_pairs_are_those_in_which_a_lie_costs_most_and_varied() -> None:
    costs = {"cav_1=ghost": 20.0, "cav_1=remove": 12.0, "cav_1=stamp": -1.0}
    made = [
        result(policy, attacks, seed, 70.0 - costs.get(attacks, 0.0) - seed, bound=policy == "truth")
        for policy in ("late_fusion", "truth")
        for attacks in ("", *costs)
        for seed in (0, 1)
    ]
    pairs = lie_pairs(ResultTable.of(made), 3)
    assert [each.attacked.cell.condition.attacks for each in pairs] == ["cav_1=ghost", "cav_1=remove", "cav_1=ghost"]
    assert {each.attacked.cell.seed for each in pairs[:2]} == {0, 1}, "what was chosen before counts less"
    assert {each.attacked.cell.policy for each in pairs} == {"late_fusion"}, "bounds are in no pair"
    for pair in pairs:
        assert pair.honest.cell.condition == Condition() and pair.honest.cell.seed == pair.attacked.cell.seed
        assert pair.receiver == "cav_0", "it lost most, and the liar does not count"
    assert all("stamp" not in each.attacked.cell.condition.attacks for each in lie_pairs(ResultTable.of(made), 99))


def test_where_cars_are_driven_crashes_come_first_and_an_event_once() -> None:
    lost = {"cav_1=ghost": (0.0, 2.0), "cav_1=remove": (100.0, 5.0)}

    def driven(attacks: str, late_s: float) -> CellResult:
        crash, brakes = lost.get(attacks, (0.0, 1.0))
        values = {"crash": crash, "phantom_brakes": brakes, "bytes_per_s": 9.0, "sAMOTA": 50.0}
        cell = Cell("late_fusion", Condition("merge", latency_s=late_s, attacks=attacks), 4, None)
        return CellResult(cell, values, {"cav_0": values, "cav_1": {"sAMOTA": 3.0}}, np.ones(9))

    table = ResultTable.of([driven(attacks, late_s) for attacks in ("", *lost) for late_s in (0.0, 0.2)])
    found = [(each.attacked.cell.condition.attacks, each.metric, each.receiver) for each in lie_pairs(table, 9)]
    assert found == [("cav_1=remove", "crash", "cav_0"), ("cav_1=ghost", "phantom_brakes", "cav_0")]


def test_the_film_begins_a_second_before_the_lie_tells(filmed: FilmedLie) -> None:
    assert filmed.believed_s is not None
    assert filmed.attacked.frames[filmed.first].time_ns / 1e9 == pytest.approx(filmed.believed_s - 1.0)


def test_without_lies_there_is_no_section() -> None:
    table = ResultTable.of([result("late_fusion", "", 0, 50.0)])
    assert lie_pairs(table, 5) == ()


def test_both_sides_are_the_same_world_and_only_one_has_the_lie(filmed: FilmedLie, data: dict[str, Any]) -> None:
    honest, attacked = data["sides"]
    count = len(honest["frames"])
    assert count == len(attacked["frames"]) == 25 - filmed.first
    for one, two in zip(honest["frames"], attacked["frames"], strict=True):
        assert one == two, "truth, agents and the receiver's points"
    assert not any(len(boxes(each["claimed"])) or each["stated"] for each in honest["lies"])
    lying = [len(boxes(each["claimed"])) for each in attacked["lies"]]
    begin = round((filmed.begins_s - data["start_s"]) / data["dt_s"])
    assert filmed.begins_s == pytest.approx(1.0) and lying == [0] * begin + [1] * (count - begin)
    assert set(attacked["lies"][-1]["stated"]) == {"cav_1"}


def test_the_receiver_tracks_the_ghost_where_it_is_drawn(filmed: FilmedLie, data: dict[str, Any]) -> None:
    assert filmed.believed_s is not None and filmed.believed_s >= filmed.begins_s
    shown = round((filmed.believed_s - data["start_s"]) / data["dt_s"])
    honest, attacked = data["sides"]
    (ghost,) = boxes(attacked["lies"][shown]["claimed"])

    def apart_m(side: dict[str, Any]) -> float:
        tracks = boxes(side["runs"][0]["tracks"][shown][data["agent"]])
        return float(np.hypot(*((tracks[:, 1:3] - ghost[1:3]) * UNIT_M).T).min(initial=np.inf))

    assert apart_m(attacked) <= 2.0 < apart_m(honest)


def test_a_report_has_the_pair_with_its_legend_and_moments(results: list[CellResult], tmp_path: Path) -> None:
    publish(tmp_path, results)
    text = (tmp_path / "report.html").read_text(encoding="utf-8")
    page = Page(text)
    assert "Lies" in page.texts("h2") and any("claimed by the liar" in each for each in page.texts("span", "key"))
    (begins, *others) = page.texts("button", "moment")
    assert begins == "1.0 s the lie begins" and any("tracks what is not there" in each for each in others)
    publish(tmp_path, [each for each in results if not each.cell.condition.attacks])
    assert "<h2>Lies</h2>" not in (tmp_path / "report.html").read_text(encoding="utf-8")
