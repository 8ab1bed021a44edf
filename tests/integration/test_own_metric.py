"""A metric that a user registers: its value is in the score, every table, the store and the report."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path

import pytest
from fork_server import run_python

import coopsim
from coopsim.bench.benchmark import benchmark
from coopsim.bench.engine.engine import Engine
from coopsim.bench.grid.grid import Grid
from coopsim.bench.leaderboard import to_csv, to_markdown
from coopsim.bench.paper.provenance import Provenance
from coopsim.bench.report.publish import publish
from coopsim.bench.store.store import Store
from coopsim.cli import main
from coopsim.episode import RECORDERS
from coopsim.metrics import METRICS, LogPool, Metric

SMALL = {"vehicles": 6, "pedestrians": 2, "lidar": None}

MODULE = """
from coopsim.metrics import METRICS, Metric

@METRICS.register("reported boxes")
class Reported(Metric):
    meaning, unit, form, less_is_better = "all reported boxes", "", ".0f", True
    def value(self, pool):
        return pool.reported
"""

POLICY = """
import coopsim

class Mine(coopsim.POLICIES.get("no_fusion")):
    pass
"""


@pytest.fixture(autouse=True)
def registry() -> Iterator[None]:
    """Forget what a test registers."""
    before = dict(METRICS._entries), dict(RECORDERS._entries)
    yield
    for registry, entries in zip((METRICS, RECORDERS), before, strict=True):
        registry._entries.clear()
        registry._entries.update(entries)


@pytest.fixture
def registered() -> None:
    @METRICS.register("reported boxes")
    class Reported(Metric):
        meaning, unit, form, less_is_better = "all reported boxes", "", ".0f", True

        def value(self, pool: LogPool) -> float | None:
            return pool.reported


@pytest.mark.usefixtures("registered")
def test_it_is_in_the_score_and_its_table() -> None:
    score = coopsim.evaluate("late_fusion", seed=1, max_cycles=5, **SMALL).score
    reported = [score.agents[name]["reported boxes"] for name in score.agents]
    assert score["reported boxes"] == pytest.approx(sum(reported) / len(reported)) and min(reported) > 0
    for part in (score.classes, score.superclasses, score.bands):
        assert all("reported boxes" in each.values for each in part.values())
    assert "reported boxes" in score.table().splitlines()[0]
    assert score.to_dict()["reported boxes"] == score["reported boxes"]
    assert score.ignoring_false_positives()["reported boxes"] == score["reported boxes"]


def test_a_metric_may_have_no_value_and_none_for_parts() -> None:
    @METRICS.register("never")
    class Never(Metric):
        meaning = "nothing"

        def value(self, pool: LogPool) -> float | None:
            return None

    @METRICS.register("frames")
    class Frames(Metric):
        meaning, whole_only = "frames", True

        def value(self, pool: LogPool) -> float | None:
            return float(sum(len(log.truth_start) - 1 for log in pool.logs))

    score = coopsim.evaluate("no_fusion", seed=1, max_cycles=5, **SMALL).score
    assert "never" not in score.values and score["frames"] == 5
    assert not any("frames" in each.values for each in score.classes.values())
    assert score.table().splitlines()[2].split()[-1] == "5.0"


@pytest.mark.usefixtures("registered")
def test_it_is_in_the_tables_of_the_commands(
    recordings: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["replay", str(recordings), "--detections", "ego"]) == 0
    assert "reported boxes" in capsys.readouterr().out
    out = tmp_path / "board"
    command = ["leaderboard", str(recordings), "--detections", "ego", "--policies", "no_fusion", "--out", str(out)]
    assert main(command) == 0
    assert "reported boxes" in capsys.readouterr().out
    assert all("reported boxes" in (out / f"leaderboard.{kind}").read_text() for kind in ("md", "csv"))
    results = {"no_fusion": coopsim.evaluate_recordings("no_fusion", recordings, ("ego",))}
    assert "reported boxes" in to_markdown(results, "t") and "reported boxes" in to_csv(results)


RECORDED = """
import coopsim

@coopsim.RECORDERS.register("heard")
class Heard(coopsim.Recorder):
    def begin(self, episode):
        self.messages = dict.fromkeys(episode.received, 0)

    def on_report(self, episode):
        for agent, seen in episode.received.items():
            self.messages[agent] += len(seen.inbox)

    def records(self):
        return {agent: count for agent, count in self.messages.items() if count}

@METRICS.register("messages heard")
class MessagesHeard(Metric):
    meaning, unit, whole_only, recorders = "messages that arrived", "", True, ("heard",)
    def value(self, pool):
        return float(sum(pool.records["heard"])) if pool.records["heard"] else None
"""


def test_a_benchmark_stores_and_reports_it(tmp_path: Path) -> None:
    """In processes that load it from the file of a policy, also for the cells of another policy.

    So is one that a recorder of its own measures.
    """
    (tmp_path / "mine.py").write_text(MODULE + RECORDED + POLICY.replace("no_fusion", "late_fusion"))
    grid = Grid(("no_fusion", f"{tmp_path / 'mine.py'}:Mine"), frames=3, options={**SMALL, "connected_cars": 2})
    results = benchmark(grid, tmp_path / "out", engine=Engine(workers=1))
    assert not any(result.failed for result in results), results
    assert all(result.values["reported boxes"] > 0 for result in results)
    silent, heard = results
    assert "messages heard" not in silent.values
    assert heard.values["messages heard"] == 6  # of two others in three frames
    assert [result.values for result in Store(tmp_path / "out").results()] == [result.values for result in results]
    publish(tmp_path / "out", results, Provenance.of(grid), clips=0)
    page, markdown, table = (
        (tmp_path / "out" / name).read_text() for name in ("report.html", "report.md", "results.csv")
    )
    assert '<div data-metric="reported boxes"' in page and "all reported boxes" in page
    data = json.loads(page.split('id="data">')[1].split("</script>")[0])
    assert {"name": "reported boxes", "less": True} in data["metrics"]
    assert "reported boxes" in markdown.split("##")[1] and "reported boxes" in table.splitlines()[0]


def test_its_code_is_part_of_a_cell_s_key(tmp_path: Path) -> None:
    texts = (MODULE + POLICY, MODULE.replace("pool.reported", "pool.objects") + POLICY, POLICY)
    program = (
        "import os, pathlib\n"
        "from coopsim.bench.benchmark import check\n"
        "from coopsim.bench.engine.job import Job\n"
        "from coopsim.bench.grid.grid import Grid\n"
        "from coopsim.bench.engine.job import MetricSpec\n"
        f"for text in {texts!r}:\n"
        "    pathlib.Path('mine.py').write_text(text)\n"
        "    if child := os.fork():\n"  # each has the library imported, and nothing of the others
        "        assert os.waitpid(child, 0)[1] == 0\n"
        "        continue\n"
        "    grid = Grid(('no_fusion', 'mine.py:Mine'), frames=5)\n"
        "    policies = check(grid)\n"
        "    print(Job.of(grid.cells()[0], {}, policies['no_fusion'], MetricSpec.all()).key, flush=True)\n"
        "    os._exit(0)\n"
    )
    done = run_python(program, folder=tmp_path)
    assert done.returncode == 0, done.stderr
    keys = done.stdout.split()
    assert len(keys) == len(set(keys)) == 3


def test_a_script_s_own_metric_is_refused_before_the_first_cell(tmp_path: Path) -> None:
    program = MODULE + (
        "import coopsim\n"
        "from coopsim.bench.grid.grid import Grid\n"
        "coopsim.benchmark(Grid(('no_fusion',), frames=2), 'out')\n"
    )
    done = run_python(program, folder=tmp_path)
    assert done.returncode == 1 and "metric 'reported boxes' must be registered in a module" in done.stderr
