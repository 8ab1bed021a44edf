"""Options as plain data, which every process and file can hold, and all that decides a result."""

import json
import os
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from helpers.script_parts import parts_of_a_script
from jobs_here import no_workers
from representatives import all_of

import coopsim
from coopsim.bench.benchmark import benchmark
from coopsim.bench.engine.engine import Engine
from coopsim.bench.engine.job import Job
from coopsim.bench.grid.cell import Cell, Condition
from coopsim.bench.grid.grid import Grid
from coopsim.bench.store import fingerprint as fingerprints
from coopsim.bench.store.fingerprint import changed_parts, fingerprint, plain_options
from coopsim.bench.store.store import Store
from coopsim.catalog import PolicySpec
from coopsim.errors import InvalidValueError

CELL = Cell("no_fusion", Condition(), 0, 2)
OPTIONS: dict[str, Any] = {"lidar": None, "vehicles": 4}


def test_a_range_of_places_is_short_and_the_same_as_its_text() -> None:
    assert plain_options({"place_seed": range(10**9)}) == {"place_seed": "0-999999999"}
    assert plain_options({"place_seed": range(5, 6)}) == {"place_seed": "5-5"}
    assert plain_options({"place_seed": range(0, 9, 4)}) == {"place_seed": [0, 4, 8]}
    assert plain_options({"reward": {"weights": (1, 2)}, "own": range(2)}) == {
        "reward": {"weights": [1, 2]},
        "own": [0, 1],
    }


def test_a_penetration_is_in_a_key_only_where_it_is_set() -> None:
    assert "penetration" not in decided()["cell"]["condition"]
    share = replace(CELL, condition=Condition(penetration=0.5))
    found = json.loads(fingerprint(share, OPTIONS, PolicySpec.parse("no_fusion")))
    assert found["cell"]["condition"]["penetration"] == 0.5


def test_lists_without_end_are_refused() -> None:
    with pytest.raises(InvalidValueError, match="place_seed must have at most 1000000 items, got 500000000: for a"):
        plain_options({"place_seed": range(0, 10**9, 2)})


def decided(policy: str = "no_fusion", **options: Any) -> dict[str, Any]:
    found: dict[str, Any] = json.loads(fingerprint(CELL, options, PolicySpec.parse(policy)))
    return found


@pytest.fixture
def on_path(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    folder = tmp_path / "site"
    folder.mkdir()
    monkeypatch.syspath_prepend(folder)
    return folder


@pytest.fixture
def counting(on_path: Path) -> Path:
    """A module with a policy that says its version."""
    path = on_path / "counting_policy_of_a_test.py"
    path.write_text(
        "from coopsim.agents.boxes import NoFusion\n"
        "class P(NoFusion):\n"
        "    def track(self, agent, observation):\n"
        "        self.counts['version'] = 1\n"
        "        return super().track(agent, observation)\n"
    )
    return path


def edit(path: Path) -> None:
    """Edit a policy, later than in the second in which Python compiled it: it looks at whole seconds and the size."""
    path.write_text(path.read_text().replace("'version'] = 1", "'version'] = 2"))
    later_s = path.stat().st_mtime + 2
    os.utime(path, (later_s, later_s))


def test_a_policy_that_is_edited_between_two_calls_is_another(counting: Path, tmp_path: Path) -> None:
    """As in a notebook, whose process has the first version imported, while workers import the second."""
    name, one = f"{counting.stem}:P", Engine(workers=1)
    with no_workers():
        first = benchmark(Grid((name,), frames=2, options=OPTIONS), tmp_path / "out")
    edit(counting)
    second = benchmark(Grid((name,), frames=2, seeds=(0, 1), options=OPTIONS), tmp_path / "out", engine=one)
    assert [each.counts["version"] for each in (*first, *second)] == [1, 2, 2]
    sys.modules.pop(counting.stem)


def test_a_module_beside_the_file_of_a_policy_decides(tmp_path: Path) -> None:
    (tmp_path / "beside_the_policy.py").write_text("from another_beside_it import MORE")
    (tmp_path / "another_beside_it.py").write_text("MORE = 1")
    (tmp_path / "not_imported.py").write_text("")
    (tmp_path / "mine.py").write_text(
        "from coopsim.agents.boxes import NoFusion\nimport beside_the_policy\nclass P(NoFusion): pass"
    )
    spec = PolicySpec.parse(f"{tmp_path}/mine.py:P")
    before = fingerprint(CELL, OPTIONS, spec)
    (tmp_path / "not_imported.py").write_text("MORE = 2")
    assert fingerprint(CELL, OPTIONS, spec) == before
    (tmp_path / "another_beside_it.py").write_text("MORE = 22")
    assert changed_parts(before, fingerprint(CELL, OPTIONS, spec)) == "another_beside_it beside the policy"


def test_what_a_script_registered_and_a_cell_names_decides(monkeypatch: pytest.MonkeyPatch) -> None:
    # Workers of pytest have no script.
    monkeypatch.setattr(sys.modules["__main__"], "__file__", __file__, raising=False)
    with parts_of_a_script():
        script = {**OPTIONS, "tracker": "late_fusion(defense=of_the_script)"}
        assert "__main__" in decided(**script)["code"]
        assert "__main__" not in decided(**OPTIONS)["code"]


def test_a_cell_whose_sources_changed_meanwhile_is_lost_and_not_stored(counting: Path, tmp_path: Path) -> None:
    job = Job.of(CELL, OPTIONS, PolicySpec.parse(f"{counting.stem}:P"))
    assert not job.run().lost
    edit(counting)
    outcome = job.run()
    assert outcome.lost and f"{counting.stem} changed since" in str(outcome.reason)
    sys.modules.pop(counting.stem)


@pytest.mark.usefixtures("jobs_here")
def test_lost_cells_are_run_again_by_the_same_call(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """As where a node of a Ray cluster dies: no fault of the cell."""
    grid = Grid(("no_fusion",), frames=2, seeds=(0, 1), options=OPTIONS)
    with monkeypatch.context() as patch:
        patch.setattr(Engine, "run", lambda self, jobs: (job.lost("LocalRayletDiedError") for job in jobs))
        results = benchmark(grid, tmp_path)
    assert [each.reason for each in results] == ["the cell was not run"] * 2 and Store(tmp_path).results() == []
    assert not any(each.failed for each in benchmark(grid, tmp_path))


GROUPS = ("detectors", "embedders", "codecs", "uplinks", "fusions", "backbones", "policies")


@pytest.mark.parametrize("group", all_of(GROUPS, "embedders", "policies"))
def test_plug_ins_of_every_kind_that_are_named_decide(
    group: str, on_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    package = on_path / "their_parts_of_a_test"
    package.mkdir()
    (package / "__init__.py").write_text("version = 1\n")
    info = on_path / "their_parts_of_a_test-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: their-parts-of-a-test\nVersion: 1.0\n")
    (info / "entry_points.txt").write_text(f"[coopsim.{group}]\ntheir_part = {package.name}:Part\n")
    fingerprints.installed_parts.cache_clear()
    before, without = decided(part="their_part(x=1)"), decided()
    (package / "__init__.py").write_text("version = 2, edited\n")
    assert package.name in before["code"] and package.name not in without["code"]
    assert decided(part="their_part(x=1)")["code"][package.name] != before["code"][package.name]
    assert decided() == without and package.name not in sys.modules
    assert package.name in decided("late_fusion(delayed='their_part')")["code"]
    fingerprints.installed_parts.cache_clear()


def test_arithmetic_python_and_the_renderer_that_draws_decide(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("COOPSIM_PRECISION", "float32")
    before = decided()
    assert before["code"]["arithmetic"] == "float32" and before["code"]["python"] == sys.version.split()[0]
    monkeypatch.setenv("COOPSIM_PRECISION", "bfloat16")
    assert decided()["code"]["arithmetic"] == "bfloat16"
    assert "renderer" not in before["code"], "nothing is drawn"
    drawn = decided(cameras="front", renderer="raycast")["code"]["renderer"]
    assert drawn["name"] == "raycast" and set(drawn["packages"]) <= {"moderngl", "pillow"}
    fingerprints._renderer.cache_clear()
    monkeypatch.setattr("coopsim.sensors.camera.renderers.OpenGLRenderer", _missing)
    assert decided(cameras="front")["code"]["renderer"]["name"] == "raycast", "what auto means here"
    fingerprints._renderer.cache_clear()


def _missing() -> None:
    raise coopsim.errors.MissingDependencyError("there is no OpenGL")
