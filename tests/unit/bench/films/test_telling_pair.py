"""The pair with which a report opens is filmed in three dimensions on request, and nothing else is."""

from __future__ import annotations

import base64
import zlib
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from html_page import Page
from jobs_here import no_workers
from small_env import SMALL

from coopsim.bench.benchmark import Progress, benchmark
from coopsim.bench.films.choice import film_of
from coopsim.bench.films.telling_pair import has_space, telling_pair
from coopsim.bench.grid.cell import CellResult
from coopsim.bench.grid.grid import Grid
from coopsim.bench.report.publish import publish

OPTIONS = {name: value for name, value in SMALL.items() if name not in ("max_cycles", "threads")}
GRID = Grid(("late_fusion", "no_fusion"), latencies_ms=(0,), seeds=(3, 4), frames=6, options=OPTIONS)


@pytest.fixture(scope="module")
def filmed(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, list[CellResult]]:
    """Folder and results of a benchmark whose most telling pair is filmed in three dimensions."""
    folder = tmp_path_factory.mktemp("telling")
    with no_workers():
        return folder, benchmark(GRID, folder, films=True, space=True)


def test_one_pair_is_filmed_so_and_is_not_run_again(filmed: tuple[Path, list[CellResult]]) -> None:
    folder, results = filmed
    pair = telling_pair(results)
    assert pair is not None and {each.cell.policy for each in pair} == set(GRID.policies)
    assert {each.cell for each in results if has_space(each)} == {each.cell for each in pair}
    seen: list[Progress] = []
    with no_workers():
        again = benchmark(GRID, folder, films=True, space=True, on_progress=seen.append)
    assert [each.done for each in seen] == [0] and [each.film for each in again] == [each.film for each in results]


def test_a_report_has_the_pair_once_and_twice_the_same(filmed: tuple[Path, list[CellResult]], tmp_path: Path) -> None:
    _, results = filmed
    pages = [publish(tmp_path / name, results)[0] for name in ("one", "two")]
    assert pages[0].read_bytes() == pages[1].read_bytes()
    text = pages[0].read_text()
    assert text.count("<div data-space") == 1
    view: dict[str, Any] = Page(text).data["space"]
    assert view["together"] and len(view["worlds"]) == len(view["runs"]) == 2
    assert {run["label"] for run in view["runs"]} == set(GRID.policies)
    pair = telling_pair(results)
    assert pair is not None
    space = film_of(pair[0]).frames[0].space
    assert space is not None
    first = view["worlds"][0][0]
    content = zlib.decompress(base64.b64decode(first["data"]), -zlib.MAX_WBITS)
    bodies = np.frombuffer(content, "<i4", 5 * len(first["agents"])).reshape(-1, 5)
    np.testing.assert_array_equal(bodies, [space.bodies[view["names"][each[0]]] for each in first["agents"]])
    points = [each[2] for each in first["agents"]]
    assert points == [len(cloud) for cloud in space.clouds.values()]
    # Nothing is left over: bodies, truth, who saw it, six bytes a point, and a bit a point.
    masks = sum(-(-count // 8) for count in points)
    assert len(content) == 20 * len(points) + (32 + len(points)) * first["count"] + 6 * sum(points) + masks


def test_a_benchmark_without_it_has_no_such_film(tmp_path: Path) -> None:
    with no_workers():
        results = benchmark(replace(GRID, seeds=(3,)), tmp_path, films=True)
    assert not any(map(has_space, results))
    assert "data-space" not in publish(tmp_path / "report", results)[0].read_text().split("<script", 1)[0]
