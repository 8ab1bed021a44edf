"""Entries with scores, of tiny runs in this process; their policies have processes of their own as always."""

from __future__ import annotations

import shutil
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from coopsim.bench.engine.engine import Engine
from coopsim.bench.entries import fixed_run
from coopsim.cli import main
from tests.helpers.entries import make_entry, tiny_grid
from tests.helpers.made_once import made_once


@pytest.fixture(scope="module")  # not of the package, which outlives its tests where several processes take turns
def tiny_runs() -> Iterator[None]:
    def here(engine: Engine, jobs: Iterator[Any]) -> Iterator[Any]:
        return (each.run() for each in jobs)

    with pytest.MonkeyPatch.context() as patch, tempfile.TemporaryDirectory(prefix="coopsim-tests-") as temporary:
        Path(temporary).chmod(0o711)  # guests of other users read below it
        patch.setattr(tempfile, "tempdir", temporary)  # two processes of tests run equal entries at once
        patch.setattr(fixed_run, "find_grid", tiny_grid)
        patch.setattr(Engine, "run", here)
        yield


@pytest.fixture(scope="module")
def measured(tiny_runs: None, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """An entry with scores, made by the commands."""

    def make(folder: Path) -> None:
        entry = make_entry(folder / "mine")
        assert main(["entry", "warm-up", str(entry)]) == 0
        assert main(["entry", "score", str(entry)]) == 0

    return made_once(tmp_path_factory, "entry_with_scores", make) / "mine"


@pytest.fixture
def entry(measured: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(measured, tmp_path / "mine"))
