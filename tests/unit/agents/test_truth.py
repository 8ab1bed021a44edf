"""The upper bound: it reports the true objects, is marked in every table, and nobody else gets at the truth."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from jobs_here import no_workers

import coopsim
from coopsim.bench.benchmark import benchmark
from coopsim.bench.demo import Demo, DemoConfig
from coopsim.bench.detect.detect import Measured, markdown_table, row_of
from coopsim.bench.detect.detect_plan import DetectPlan
from coopsim.bench.detect.perceived import Perceived
from coopsim.bench.films.moments import worst_windows
from coopsim.bench.grid.grid import Grid
from coopsim.bench.isolated.isolation import Isolation
from coopsim.bench.leaderboard import evaluate_each
from coopsim.bench.paper.provenance import Provenance
from coopsim.bench.report.bench_tables import condition_table, leaderboard
from coopsim.bench.report.publish import paper_files
from coopsim.bench.results.comparison import as_one_policy, compare_results
from coopsim.bench.results.result_table import ResultTable
from coopsim.bench.results.standings import standings
from coopsim.bench.store.store import Store
from coopsim.bench.text.bench_text import to_csv, to_markdown
from coopsim.bench.text.comparison_text import to_text
from coopsim.errors import InvalidValueError, PolicyMismatchError
from coopsim.types import Observation, Tracks

SMALL: dict[str, Any] = {"max_cycles": 8, "lidar": None, "connected_cars": 2}
MARK = "truth (upper bound)"


class Nosy(coopsim.Policy):
    """A policy that does not ask for the truth, and looks for it."""

    needs = coopsim.Needs(uplink="none")

    def __init__(self) -> None:
        self.found: list[object] = []

    def act(self, observations: Mapping[str, Any], *infos: Any) -> dict[str, dict[str, Any]]:
        self.found += infos
        return super().act(observations)

    def track(self, agent: str, observation: Observation) -> Tracks:
        self.found += [] if observation.truth is None else [observation.truth]
        return Tracks.empty()


def test_it_reports_every_true_object_where_it_is_with_its_velocity() -> None:
    env = coopsim.parallel_env("crossing", expose_ground_truth=True, **SMALL)
    policy = coopsim.make_policy("truth")
    observations, infos = env.reset(seed=3)
    policy.reset(env.agent_specs)
    while env.agents:
        actions = policy.act(observations, infos)
        for agent, action in actions.items():
            truth = infos[agent]["ground_truth"]
            np.testing.assert_array_equal(action["tracks"]["id"], truth["id"])
            np.testing.assert_array_equal(action["tracks"]["box"], truth["box"])
            np.testing.assert_array_equal(action["tracks"]["velocity"], truth["velocity"])
        observations, _, _, _, infos = env.step(actions)
    assert env.score()["sAMOTA"] > 99.9


def test_its_parameters_leave_out_what_is_far_and_what_is_hidden() -> None:
    env = coopsim.parallel_env("occluded_crossing", expose_ground_truth=True, **SMALL)
    observations, infos = env.reset(seed=1)
    truth = infos["cav_0"]["ground_truth"]
    far, hidden = np.hypot(*truth["box"][:, :2].T) > 30, truth["visible_to"] > 0
    assert 0 < far.sum() < len(far) and hidden.any() and not hidden.all()
    for parameters, left_out in (({"range_m": 30}, far), ({"occluded": False}, hidden)):
        policy = coopsim.make_policy("truth", **parameters)
        policy.reset(env.agent_specs)
        reported = policy.act(observations, infos)["cav_0"]["tracks"]["id"]
        assert set(reported) == set(truth["id"][~left_out])
    for wrong in ("truth(range_m=0)", "truth(range_m=near)", "truth(occluded=3)"):
        with pytest.raises(InvalidValueError):
            coopsim.make_policy(wrong)


def test_nobody_who_does_not_need_the_truth_is_given_it() -> None:
    nosy = Nosy()
    coopsim.evaluate(nosy, "crossing", expose_ground_truth=True, **SMALL)
    assert nosy.found == []
    env = coopsim.single_env("crossing", others=nosy, tracker=None, expose_ground_truth=True, **SMALL)
    env.reset(seed=0)
    env.step(env.action_space.sample())
    assert all(policy.found == [] for policy in env.policies.values())  # type: ignore[attr-defined]


def test_a_single_agent_env_takes_it_and_tells_its_learner_no_truth() -> None:
    plain = coopsim.single_env("crossing", control="policy", tracker="no_fusion", **SMALL)
    env = coopsim.single_env("crossing", control="policy", tracker="truth", others="truth", **SMALL)
    told, without = env.reset(seed=2)[1], plain.reset(seed=2)[1]
    assert told.keys() == without.keys()
    told, without = env.step(1)[4], plain.step(1)[4]
    assert told.keys() == without.keys() and told["counts"]["tp"] > 0 and told["counts"]["fp"] == 0
    asked = coopsim.single_env("crossing", control="policy", tracker="truth", expose_ground_truth=True, **SMALL)
    assert "ground_truth" in asked.reset(seed=2)[1]
    with pytest.raises(PolicyMismatchError, match="needs the truth"):
        coopsim.single_env("crossing", others="truth", expose_ground_truth=False, **SMALL)


def test_without_the_truth_it_says_how_to_get_it() -> None:
    policy, env = coopsim.make_policy("truth"), coopsim.parallel_env("crossing", **SMALL)
    observations, infos = env.reset(seed=0)
    policy.reset(env.agent_specs)
    for given in ((), (infos,)):
        with pytest.raises(PolicyMismatchError, match="expose_ground_truth=True"):
            policy.act(observations, *given)
    with pytest.raises(PolicyMismatchError, match="needs the truth"):
        coopsim.evaluate("truth", "crossing", expose_ground_truth=False, **SMALL)


@pytest.fixture(scope="module")
def results(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("bench")
    grid = Grid(("truth", "no_fusion"), ("crossing",), (0, 1), frames=12, options={"connected_cars": 2, "lidar": None})
    with no_workers():
        benchmark(grid, folder)
    return folder


def test_every_table_of_a_benchmark_marks_it_and_ranks_the_others(results: Path) -> None:
    stored = Store(results).results()
    table = ResultTable.of(stored)
    assert {entry.policy: entry.rank for entry in standings(table, "sAMOTA")} == {"no_fusion": 1, "truth": None}
    assert to_markdown(table, "title").count(MARK) == 3
    assert leaderboard(table, "sAMOTA").count(MARK) == condition_table(table, 0).count(MARK) == 1
    assert "bound" in to_csv(table).splitlines()[0]
    files = paper_files(table, Provenance(), ("sAMOTA",))
    for name, text in files.items():
        assert MARK in text or name.endswith(".csv"), name
    assert r"\textbf" in next(line for line in files["tables/undisturbed.tex"].splitlines() if "no\\_fusion" in line)
    assert all(moment.best.cell.policy != "truth" for moment in worst_windows(table, 5))
    pair = [as_one_policy(stored, name, "pair") for name in ("no_fusion", "truth")]
    assert "pair (upper bound)" in to_text(compare_results(*pair))


def test_results_without_it_stand_as_they_did(results: Path) -> None:
    table = ResultTable.of([each for each in Store(results).results() if not each.bound])
    assert "bound" not in to_csv(table) + to_markdown(table, "title")


def test_a_demonstration_marks_it() -> None:
    options = {"connected_cars": 2, "lidar": None}
    demo = Demo(DemoConfig(policies=("truth",), latencies_s=(0.0,), frames=3, options=options))
    demo.run(lambda: None)
    assert demo.runs[0].about["policy"] == MARK


def test_competitions_and_processes_of_their_own_refuse_it(recordings: Path, tmp_path: Path) -> None:
    with pytest.raises(InvalidValueError, match="upper bound"):
        evaluate_each(recordings, ("ego",), ("no_fusion", "truth"))
    own = tmp_path / "own.py"
    own.write_text(
        "import coopsim\nclass Mine(coopsim.Policy):\n    needs = coopsim.Needs(uplink='none', truth=True)\n"
        "    def track(self, agent, observation): ...\n"
    )
    for policy in ("truth", f"{own}:Mine"):
        with pytest.raises(InvalidValueError, match="must not need the truth"):
            benchmark(Grid((policy,), ("crossing",), (0,), frames=3), tmp_path / "b", isolation=Isolation(30.0))


def test_detection_is_measured_as_an_upper_bound() -> None:
    plan = DetectPlan(("truth", "late_fusion(defense=oracle)", "no_fusion"), ("crossing",), (0,), frames=2)
    plan.check()
    assert plan.bounds == {"truth", "late_fusion(defense=oracle)"}
    place = next(plan.rows())
    (job,) = plan.jobs_of(*place)
    perceived = Perceived.from_arrays(job.run().result.arrays)
    row = row_of(plan, place, {}, [Measured.of(perceived, "coopsim")])
    assert row["APBEV@0.7"] == 1.0 and row["bound"]
    assert "truth (upper bound)" in markdown_table([row])
