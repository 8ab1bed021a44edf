"""What of coopsim a run can import: all that it needs and loads, and no report."""

from __future__ import annotations

import ast
import importlib
import re
import shutil
import sys
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import pytest

import coopsim
from coopsim.bench.engine.job import Job, Outcome
from coopsim.bench.grid.cell import Cell, CellResult, Condition
from coopsim.bench.store import closure
from coopsim.bench.store.closure import RUN, Package, current_package, scan
from coopsim.bench.store.fingerprint import Sources
from coopsim.catalog import PolicySpec

ROOT = Path(coopsim.__file__).parent


@pytest.fixture(scope="module")
def package() -> Package:
    return current_package()


def counted(policy: str, **options: object) -> set[str]:
    sources = Sources()
    Job.of(Cell(policy, Condition()), options, PolicySpec.parse(policy), sources=sources)
    return sources.counted


def test_a_run_counts_what_it_imports_and_no_report(package: Package) -> None:
    boxes, maps = counted("late_fusion"), counted("attfuse")
    for name in ("envs.parallel", "comms.channel.channel", "metrics.score", "agents.boxes", "world.towns.town"):
        assert f"coopsim.{name}" in boxes & maps
    rooms = ("bench.report", "bench.paper", "bench.results", "bench.entries", "bench.detect", "cli", "testing")
    others = tuple(f"coopsim.{each}" for each in (*rooms, "learn.train"))
    assert RUN in boxes and not [name for name in boxes | maps if name.startswith(others)]
    assert "coopsim.nn.fusion.attfuse" in maps and not [name for name in boxes if name.startswith("coopsim.nn")]
    for options in ({"detector": "pillars"}, {"selection": "learned"}, {"embedder": "dinov2"}):
        assert "coopsim.learn.weights" in counted("late_fusion", **options)
    assert "coopsim.learn.weights" in counted("late_fusion(covariance=pillars)")
    assert counted("late_fusion") < package.names


@pytest.fixture
def copy(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A copy of the package's texts, which keys are then made of."""
    folder = tmp_path / "coopsim"
    shutil.copytree(ROOT, folder, ignore=shutil.ignore_patterns("*.safetensors", "__pycache__", "template"))
    monkeypatch.setattr(closure, "FOLDER", folder)
    return folder


def key(policy: str = "late_fusion") -> str:
    return Job.of(Cell(policy, Condition()), {}, PolicySpec.parse(policy)).key


def test_sources_are_read_again_only_after_a_change(copy: Path) -> None:
    before = current_package()
    assert current_package() is before and before.imports([RUN]) is before.imports([RUN])
    (copy / "world" / "world.py").write_bytes((copy / "world" / "world.py").read_bytes() + b"# a comment\n")
    after = current_package()
    assert after is not before and current_package() is after
    assert after.digest(["coopsim.world.world"]) != before.digest(["coopsim.world.world"])


def test_a_report_leaves_a_key_valid_and_what_a_run_imports_changes_it(copy: Path) -> None:
    boxes, maps = key(), key("attfuse")

    def changed(name: str) -> tuple[bool, bool]:
        path = copy / name
        before = path.read_bytes()
        path.write_bytes(before + b"# a comment\n")
        found = key() != boxes, key("attfuse") != maps
        path.write_bytes(before)
        return found

    for name in (
        "bench/text/bench_text.py",
        "bench/films/film.py",
        "bench/grid/presets/quick.yaml",
        "cli/entry.py",
        "learn/train.py",
    ):
        assert changed(name) == (False, False), name
    data = ("detection/fitted/pointpillars_v2v4real.yaml", "world/models/actors.npz")
    for name in ("comms/channel/channel.py", "envs/parallel.py", *data):
        assert changed(name) == (True, True), name
    assert changed("nn/fusion/attfuse.py") == (False, True)


def test_a_run_that_loads_what_its_key_does_not_count_is_lost(monkeypatch: pytest.MonkeyPatch) -> None:
    cell = Cell("no_fusion", Condition(), 0, 1)
    job = Job.of(cell, {}, PolicySpec.parse("no_fusion"))

    def loading(name: str) -> Outcome:
        def run(job: Job) -> Outcome:
            monkeypatch.delitem(sys.modules, name, raising=False)
            importlib.import_module(name)
            return Outcome(job, CellResult(cell))

        monkeypatch.setattr("coopsim.bench.engine.job.run_job", run)
        monkeypatch.delitem(sys.modules, name, raising=False)
        return job.run()

    assert not loading("coopsim.metrics.finding").lost
    lost = loading("coopsim.bench.report.keys")
    assert lost.lost and "coopsim.bench.report.keys, which its key does not count" in str(lost.reason)


@pytest.mark.long
def test_no_import_of_any_module_is_overlooked(package: Package) -> None:
    """The text is read by patterns, as a parser takes seconds; here is the parser."""
    for name in sorted(package.names):
        path = ROOT.joinpath(*name.split(".")[1:])
        text = (path / "__init__.py" if path.is_dir() else path.with_suffix(".py")).read_text(encoding="utf-8")
        found = package.imported_by([scan(text)])
        missing = {each for each in _imports(ast.parse(text)) if each in package.names} - found
        assert not missing, (name, missing)


def _imports(tree: ast.AST) -> Iterator[str]:
    """Yield what a module imports but for types, and names that may be modules."""
    for node in ast.iter_child_nodes(tree):
        if isinstance(node, ast.If) and "TYPE_CHECKING" in ast.unparse(node.test):
            continue
        if isinstance(node, ast.Import):
            yield from (each.name for each in node.names)
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0
            yield from (str(node.module), *(f"{node.module}.{each.name}" for each in node.names))
        yield from _imports(node)


def test_homes_of_registries_are_written_out(package: Package) -> None:
    """Patterns find no home that is computed: its modules would be in no key, and runs that load them would be lost."""
    for name in sorted(package.names - {"coopsim.support.registry"}):
        path = ROOT.joinpath(*name.split(".")[1:])
        text = (path / "__init__.py" if path.is_dir() else path.with_suffix(".py")).read_text(encoding="utf-8")
        if "Registry(" in text:
            assert len(re.findall(r"\bhome=", text)) <= len(scan(text).homes), name


def test_keys_are_quick(package: Package) -> None:
    job = Job.of(Cell("late_fusion", Condition()), {}, PolicySpec.parse("late_fusion"))
    sources, started_s = Sources(), time.process_time()
    Job.of(replace(job.cell, seed=1), {}, job.policy, sources=sources)
    assert time.process_time() - started_s < 0.5  # 0.06 s, of which the most is to look whether files are the same
