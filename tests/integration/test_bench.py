"""`coopsim bench`, as a user runs it: what it leaves, what it survives, and that nothing changes the results."""

from __future__ import annotations

import itertools
import json
import os
import re
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Generator, Iterator
from dataclasses import replace
from pathlib import Path

import psutil
import pytest
from interruptible import interruptible
from jobs_here import RUN_LOCALLY, no_workers, run_here

import coopsim
from coopsim.bench.benchmark import benchmark
from coopsim.bench.engine.engine import Engine
from coopsim.bench.engine.job import Job, Outcome, run_job
from coopsim.bench.grid.grid import Grid
from coopsim.bench.run_jobs import Progress
from coopsim.bench.store.store import Store
from coopsim.catalog import PolicySpec
from coopsim.cli import INTERRUPTED, main
from coopsim.errors import MissingDependencyError, StoreError

FAST = {"vehicles": 6, "pedestrians": 2, "lidar": None}
GRID = Grid(("no_fusion", "late_fusion"), latencies_ms=(0, 300), seeds=(0, 1), frames=5, options=FAST)
LATE = replace(GRID, policies=("late_fusion",))
SHORT = ["--frames", "5", "--clips", "0"]
SHORT += [word for name, value in FAST.items() for word in ("--option", f"{name}={json.dumps(value)}")]
FLAGS = ["--policies", "no_fusion,late_fusion", "--latencies-ms", "0,300", "--seeds", "0-1", *SHORT]

TROUBLE = """
import os
import time
import numpy as np
import coopsim
from coopsim.geometry.boxes import Boxes3D
from coopsim.types import Tracks

class Quiet(coopsim.Policy):
    needs = coopsim.Needs(uplink="none")
    def track(self, agent, observation):
        print("said on stdout")
        none = np.zeros(0, dtype=int)
        return Tracks(none, Boxes3D.empty(), np.zeros((0, 2)), np.zeros(0), none)

class Waits(Quiet):
    def track(self, agent, observation):
        while os.path.exists(__file__ + ".hold"):
            time.sleep(0.02)
        return super().track(agent, observation)

class Raises(Quiet):
    def track(self, agent, observation):
        raise ZeroDivisionError(f"of {object()}")

class Dies(Quiet):
    def track(self, agent, observation):
        os._exit(3)

class Killed(Quiet):
    def track(self, agent, observation):
        if os.path.exists(__file__ + ".kill"):
            os.remove(__file__ + ".kill")
            os.kill(os.getpid(), 9)
        return super().track(agent, observation)"""


@pytest.fixture
def trouble(tmp_path: Path) -> Path:
    path = tmp_path / "trouble.py"
    path.write_text(TROUBLE)
    return path


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of an uninterrupted run in this process."""
    folder = tmp_path_factory.mktemp("reference")
    with no_workers():
        results = benchmark(GRID, folder)
    assert [result.cell for result in results] == list(GRID.cells()) and not any(result.failed for result in results)
    return folder


@pytest.fixture(scope="module")
def reference(whole: Path) -> dict[str, bytes]:
    """Bytes of its cells."""
    return stored(whole)


def stored(folder: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in (folder / "cells").glob("*.parquet")}


def written(folder: Path) -> dict[str, bytes]:
    """The files that people read."""
    found = (path for path in folder.rglob("*") if path.is_file() and "cells" not in path.parts)
    return {path.relative_to(folder).as_posix(): path.read_bytes() for path in found if path.name != "grid.json"}


def start(folder: Path, *flags: str) -> subprocess.Popen[str]:
    return interruptible("bench", *flags, "--out", str(folder), stdout=subprocess.PIPE, stderr=subprocess.PIPE)


def wait_for_cells(folder: Path, count: int, process: subprocess.Popen[str]) -> None:
    while len(list((folder / "cells").glob("*.parquet"))) < count:
        assert process.poll() is None, process.communicate()
        time.sleep(0.02)


def wait_until_gone(processes: list[psutil.Process]) -> None:
    _, alive = psutil.wait_procs(processes, timeout=30)
    assert alive == []


def test_an_interrupt_tells_what_is_stored_where_no_bar_is_shown(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def interrupted(jobs: Iterator[Job], workers: int) -> Generator[Outcome]:
        yield from map(run_job, itertools.islice(jobs, 2))
        raise KeyboardInterrupt

    monkeypatch.setattr(RUN_LOCALLY, interrupted)
    assert main(["bench", *FLAGS, "--out", str(tmp_path)]) == INTERRUPTED
    assert "interrupted; 2 of 8 runs are stored" in capsys.readouterr().err and len(stored(tmp_path)) == 2


def test_two_workers_give_the_bytes_of_one(reference: dict[str, bytes], tmp_path: Path) -> None:
    seen: list[Progress] = []
    results = benchmark(GRID, tmp_path, engine=Engine(workers=2), on_progress=seen.append)
    assert stored(tmp_path) == reference and len(reference) == len(GRID) == len(results)
    assert [progress.done for progress in seen] == list(range(len(GRID) + 1))
    assert seen[-1].left_s == 0 and seen[0].left_s is None
    again: list[Progress] = []
    assert repr(benchmark(GRID, tmp_path, on_progress=again.append)) == repr(results)
    assert [(progress.stored, progress.done) for progress in again] == [(len(GRID), 0)]
    # It is what `evaluate` gives.
    (cell,) = (each for each in results if each.cell == GRID.cells()[-1])
    here = coopsim.evaluate("late_fusion", seed=1, latency_s=0.3, max_cycles=5, **FAST)
    assert cell.values == dict(here.score.values) and cell.rewards.tolist() == here.rewards.tolist()


@pytest.mark.usefixtures("jobs_here")
def test_a_larger_grid_takes_what_is_there(reference: dict[str, bytes], tmp_path: Path) -> None:
    small = replace(LATE, latencies_ms=(300,), seeds=(1,))
    benchmark(small, tmp_path)
    seen: list[Progress] = []
    benchmark(LATE, tmp_path, on_progress=seen.append)
    larger = stored(tmp_path)
    assert seen[0].stored == 1 and len(larger) == len(LATE) and larger.items() <= reference.items()
    benchmark(small, tmp_path)
    assert [result.cell for result in Store(tmp_path).results()] == list(small.cells())


def test_a_killed_command_goes_on_to_the_same_bytes(trouble: Path, tmp_path: Path, reference: dict[str, bytes]) -> None:
    """Its workers end with it, and what is stored is kept."""
    policies = f"late_fusion,{trouble}:Waits"
    flags = ["--policies", policies, "--latencies-ms", "0,300", "--seeds", "0-1", *SHORT, "--workers", "1"]
    Path(f"{trouble}.hold").touch()
    process = start(tmp_path / "out", *flags)
    wait_for_cells(tmp_path / "out", 1, process)
    workers = psutil.Process(process.pid).children(recursive=True)
    process.kill()
    process.communicate(timeout=60)
    wait_until_gone(workers)
    (kept,) = stored(tmp_path / "out")
    with no_workers():
        benchmark(LATE, tmp_path / "out")
    again = stored(tmp_path / "out")
    assert workers and kept in again and len(again) == len(LATE) and again.items() <= reference.items()


@pytest.mark.long  # eight processes
def test_interrupted_killed_and_ended_by_two_commands_at_once(
    trouble: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Whatever happens on the way, the end is that of an uninterrupted run, byte for byte."""
    policies = f"late_fusion,{trouble}:Waits"
    flags = ["--policies", policies, "--latencies-ms", "0,300", "--seeds", "0-1", *SHORT, "--workers", "1"]
    hold, out_dir = Path(f"{trouble}.hold"), tmp_path / "out"
    hold.touch()
    for count, what in ((1, signal.SIGINT), (2, signal.SIGKILL)):
        process = start(out_dir, *flags)
        wait_for_cells(out_dir, count, process)  # the next one waits, as every first cell of its kind comes first
        workers = psutil.Process(process.pid).children(recursive=True)
        process.send_signal(what)
        out, err = process.communicate(timeout=60)
        assert workers and out == ""
        wait_until_gone(workers)
        assert len(stored(out_dir)) == count
        if what is signal.SIGINT:
            assert process.returncode == INTERRUPTED and "Traceback" not in err
            # The last one may have been stored and not yet counted.
            assert re.search(r"interrupted; [01] of 8 runs are stored in ", err)
    hold.unlink()
    both = [start(out_dir, *flags) for _ in range(2)]
    for process in both:
        out, err = process.communicate(timeout=120)
        assert process.returncode == 0 and "%" not in err and "Traceback" not in err  # no bar without a terminal
        assert out.count("written: ") == len(written(out_dir)) == 8 and "report.html" in out
        assert out.startswith("|   rank | policy ") and out.count("late_fusion") == 1  # the leaderboard
    monkeypatch.setattr(RUN_LOCALLY, run_here)
    assert main(["bench", *flags, "--out", str(tmp_path / "uninterrupted")]) == 0
    assert stored(out_dir) == stored(tmp_path / "uninterrupted")
    assert written(out_dir) == written(tmp_path / "uninterrupted")


@pytest.mark.heavy("it draws all figures of a benchmark, three times")
def test_a_half_finished_folder_has_everything_and_goes_on_to_the_same_bytes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def interrupted(jobs: Iterator[Job], workers: int) -> Generator[Outcome]:
        yield from map(run_job, itertools.islice(jobs, 5))
        raise KeyboardInterrupt

    command = ["bench", *FLAGS, "--vary", "one_by_one", "--losses", "0,0.5", "--metrics", "HOTA,sAMOTA"]
    files = {
        *("report.html", "report.md", "results.csv", "intervals.csv", "protocol.txt", "plots/HOTA_over_bytes.svg"),
        *("tables/undisturbed.tex", "tables/HOTA_latency.tex", "tables/HOTA_loss.tex"),
    }
    half, whole = tmp_path / "half", tmp_path / "whole"
    monkeypatch.setattr(RUN_LOCALLY, interrupted)
    assert main([*command, "--out", str(half), "--workers", "2"]) == INTERRUPTED
    assert written(half) == {}
    report = ["report", str(half), "--clips", "0", "--metrics", "HOTA,sAMOTA"]
    assert main(report) == 0 and "5 of 12 runs are in " in capsys.readouterr().out
    unfinished = written(half)
    assert files - {"tables/HOTA_latency.tex", "tables/HOTA_loss.tex"} <= set(unfinished) <= files
    assert b"5 of 12 runs; 0 failed, 7 not run" in unfinished["protocol.txt"]
    monkeypatch.setattr(RUN_LOCALLY, run_here)
    for folder in (half, whole):
        assert main([*command, "--out", str(folder)]) == 0
    assert written(half) == written(whole) and set(written(whole)) == files
    text = written(whole)["protocol.txt"].decode()
    assert "12 of 12 runs" in text and f"coopsim {coopsim.__version__}" in text and str(tmp_path) not in text
    assert "coopsim bench --policies no_fusion,late_fusion" in text and "--workers" not in text
    before = written(half)
    assert main(report) == 0 and written(half) == before


@pytest.mark.usefixtures("jobs_here")
def test_a_broken_file_is_named_and_made_again(
    whole: Path, reference: dict[str, bytes], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    shutil.copytree(whole, tmp_path, dirs_exist_ok=True)
    victim = tmp_path / "cells" / min(reference)
    victim.write_bytes(victim.read_bytes()[:-100])
    broken: list[StoreError] = []
    benchmark(GRID, tmp_path, on_broken=broken.append)
    assert len(broken) == 1 and f"{victim} is broken" in str(broken[0]) and stored(tmp_path) == reference
    victim.write_bytes(b"")
    assert main(["bench", *FLAGS, "--out", str(tmp_path)]) == 0
    assert f"{victim} is broken" in capsys.readouterr().err


def test_a_failing_cell_is_recorded_and_the_rest_goes_on(
    trouble: Path, tmp_path: Path, capfd: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    policies = ["--policy", f"{trouble}:Raises", "--policy", f"{trouble}:Dies", "--policy", f"{trouble}:Quiet"]
    command = ["bench", "--policies", "no_fusion", *policies, *SHORT, "--workers", "1", "--out", str(tmp_path)]
    assert main(command) == 1
    shown = capfd.readouterr()
    assert "2 of 4 runs failed; --retry-failed" in shown.err and "ZeroDivisionError: of" in shown.err
    assert "said on stdout" not in shown.out
    results = {result.cell.policy.rpartition(":")[2]: result for result in Store(tmp_path).results()}
    assert not (results["no_fusion"].failed or results["Quiet"].failed)
    raised, died = results["Raises"].traceback or "", results["Dies"].traceback or ""
    assert 'in track\n    raise ZeroDivisionError(f"of {object()}")' in raised
    assert "object object at 0x..." in raised and died == "the process that ran this cell died\n"
    assert "process that ran this cell died: exit status 3" in shown.err
    told = [json.loads(path.read_text()).get("died") for path in (tmp_path / "cells").glob("*.json")]
    assert sorted(filter(None, told)) == ["exit status 3"]
    before = stored(tmp_path)
    assert main(command) == 1 and stored(tmp_path) == before
    assert "coopsim: failed: " not in capfd.readouterr().err  # it is not run again
    few = ["bench", "--policies", f"{trouble}:Raises", *SHORT, "--retry-failed", "--out", str(tmp_path)]
    monkeypatch.setattr(RUN_LOCALLY, run_here)
    assert main(few) == 1 and stored(tmp_path) == before
    assert capfd.readouterr().err.count("coopsim: failed: ") == 1


def test_a_cell_whose_process_was_killed_is_done_once_more(trouble: Path, tmp_path: Path) -> None:
    (flag := Path(f"{trouble}.kill")).touch()
    (result,) = benchmark(Grid((f"{trouble}:Killed",), frames=2, options=FAST), tmp_path, engine=Engine(workers=1))
    assert not (result.failed or flag.exists())


def test_workers_find_what_lies_where_an_interpreter_was_started(trouble: Path, tmp_path: Path) -> None:
    program = (
        "import coopsim; from coopsim.bench.grid.grid import Grid; "
        f"(result,) = coopsim.benchmark(Grid(('trouble:Quiet',), frames=2, options={FAST}), 'out'); "
        "assert not result.failed, result.traceback"
    )
    environment = {**os.environ, "PYTHONPATH": str(Path(coopsim.__file__).parents[1])}
    run = subprocess.run([sys.executable, "-c", program], cwd=tmp_path, env=environment, stderr=subprocess.PIPE)
    assert run.returncode == 0, run.stderr.decode()


def test_all_is_looked_up_before_the_first_cell(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for flags, message in [
        (["--policies", "no_fusion,late_fusoin"], "Did you mean 'late_fusion'"),
        (["--policies", "no_fusion", "--policy", "nunpy:X"], "there is no module 'nunpy'"),
        (["--policies", "no_fusion", "--environments", "crossing,crosing"], "Did you mean 'crossing-v3'"),
        (["--policies", "no_fusion", "--option", "vehicels=3"], "Did you mean 'vehicles'"),
        (["--policies", "no_fusion", "--latencies-ms=-1"], "latencies_ms must be a finite number >= 0"),
        (["--policies", "no_fusion", "--engine", "rya"], "Did you mean 'ray'"),
        (["--policies", "no_fusion", "--address", "x:1"], "address is of a Ray cluster and needs engine 'ray'"),
        (["--preset", "quik"], "Did you mean 'quick'"),
        (["--policies", "no_fusion", "--metrics", "AMTOA"], "Did you mean 'AMOTA'"),
        ([], "policies must be at least one"),
    ]:
        assert main(["bench", *flags, "--out", str(tmp_path / "out")]) == 2
        error = capsys.readouterr().err
        assert message in error and "Traceback" not in error
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("flags", "message"),
    [
        (["--seeds", "3-1"], "must be integers >= 0 with commas between them, or 0-4"),
        (["--seeds", "0-"], "must be integers >= 0 with commas between them, or 0-4, got '0-'"),
        (["--option", "vehicles"], "must be name=value"),
        (["--polices", "a"], "Did you mean --policies"),
    ],
)
def test_slips_in_flags(flags: list[str], message: str, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        main(["bench", *flags])
    assert message in capsys.readouterr().err


def test_without_ray_the_message_names_what_to_install(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "ray", None)
    with pytest.raises(MissingDependencyError, match=r"pip install 'coopsim\[ray\]'"):
        benchmark(GRID, tmp_path, engine=Engine("ray"))


@pytest.mark.long
def test_a_local_ray_gives_the_bytes_of_local_processes(
    reference: dict[str, bytes], trouble: Path, tmp_path: Path
) -> None:
    pytest.importorskip("ray")
    process = start(tmp_path, *FLAGS, "--policy", f"{trouble}:Raises", "--engine", "ray", "--workers", "2")
    children: set[psutil.Process] = set()
    while process.poll() is None:
        children |= set(psutil.Process(process.pid).children(recursive=True))
        time.sleep(0.2)
    _, err = process.communicate()
    assert process.returncode == 1 and "4 of 12 runs failed" in err, err
    wait_until_gone(list(children))
    by_ray = stored(tmp_path)
    assert len(by_ray) == 12 and reference.items() <= by_ray.items()
    failed = next(result for result in Store(tmp_path).results() if result.failed)
    here = run_job(Job.of(failed.cell, FAST, PolicySpec.parse(failed.cell.policy)))
    assert failed.traceback == here.result.traceback
