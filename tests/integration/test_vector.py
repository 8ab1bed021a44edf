"""Vectors with worker processes: the same bits for any number, and what remains when something ends."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import psutil
import pytest
from counting_envs import FAILING, KILLED, REFUSED, CountingAgents, CountingEnv, SeededEnv
from representatives import all_of

import coopsim
from coopsim.errors import InvalidActionError, LostEnvironmentsError, UnknownNameError
from coopsim.types import Tracks
from coopsim.wire.actions import pack_tracks

IDLE = {"tracks": pack_tracks(Tracks.empty())}


def acts(*actions: float) -> Any:
    return np.array(actions, np.float32)[:, None]


def leaves(tree: Any) -> Iterator[bytes]:
    """Everything in a tree, as bytes."""
    if isinstance(tree, dict):
        for key in sorted(tree):
            yield str(key).encode()
            yield from leaves(tree[key])
    elif isinstance(tree, (list, tuple)):
        for part in tree:
            yield from leaves(part)
    else:
        array = np.asarray(tree)
        yield f"{array.dtype}{array.shape}".encode()
        yield array.tobytes()


def played(workers: int, **options: Any) -> list[bytes]:
    """The bits of three environments over two episodes."""
    chosen = {"lidar": "VLP-16", "lidar_columns": 128, "vehicles": 8, "max_cycles": 3, "detector": "simulated"}
    with coopsim.vector("crossing", 3, workers=workers, **chosen, **options) as vector:
        bits = list(leaves(vector.reset(seed=4)))
        for _ in range(6):
            now = vector.step([dict.fromkeys(agents, IDLE) for agents in vector.get_attr("agents")])
            bits += leaves(now)
    return bits


def test_the_same_bits_for_any_number_of_workers() -> None:
    here = played(0)
    assert len(here) > 1000
    assert played(2) == here  # one of them has two environments


@pytest.fixture(autouse=True)
def ctrl_c_raises() -> Iterator[None]:
    """Have Ctrl-C raise, also where tests run in the background, whose processes ignore it from the start."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


@pytest.fixture(scope="module")
def vector() -> Iterator[Any]:
    """Four environments of two workers, which tests reset and leave usable."""
    with coopsim.vector(CountingEnv, 4, workers=2, length=50, size=50_000) as made:
        yield made


def test_processes_do_as_the_calling_one(vector: Any) -> None:
    with coopsim.vector(CountingEnv, 4, workers=0, length=50, size=50_000) as here:
        observations, infos = vector.reset(seed=[1, 2, 3, 4])
        wanted, _ = here.reset(seed=[1, 2, 3, 4])
        np.testing.assert_array_equal(observations[:, 1:], wanted[:, 1:])
        assert infos["seed"].tolist() == [1, 2, 3, 4]
        with pytest.raises(InvalidActionError, match="environment 2: action must be >= 0"):
            vector.step(acts(1, 2, REFUSED, 4))
        observations, rewards, *_, infos = vector.step(acts(8, 8, 3, 8))
        wanted, *_ = here.step(acts(1, 2, 3, 4))
        np.testing.assert_array_equal(observations[:, 1:], wanted[:, 1:])
        assert rewards.tolist() == [1, 2, 3, 4]
    assert len({*infos["pid"].tolist(), os.getpid()}) == 3


def test_an_error_in_a_worker_is_reported_with_its_traceback(vector: Any) -> None:
    vector.reset(seed=0)
    with pytest.raises(LostEnvironmentsError, match=r"lost environment 1: Traceback(?s:.*)counting_envs(?s:.*)broke"):
        vector.step(acts(1, FAILING, 1, 1))
    observations, *_ = vector.step(acts(1, 1, 1, 1))
    np.testing.assert_array_equal(observations[:, 1], [2, 0, 2, 2])


@pytest.mark.parametrize("killer", ["itself", "outside"])
def test_a_worker_that_is_killed_takes_no_others_episode_along(vector: Any, killer: str) -> None:
    vector.reset(seed=0)
    *_, infos = vector.step(acts(1, 1, 1, 1))
    pids = infos["pid"].tolist()
    assert pids[0] == pids[1] != pids[2] == pids[3]
    if killer == "outside":
        os.kill(pids[3], signal.SIGKILL)
    with pytest.raises(LostEnvironmentsError, match=r"lost environments 2, 3: the worker died \(SIGKILL\)") as raised:
        vector.step(acts(2, 2, 2, KILLED if killer == "itself" else 2))
    observations, rewards, terminations, truncations, infos = raised.value.results
    assert rewards.tolist() == [2, 2, 0, 0] and not terminations.any()
    assert truncations.tolist() == [False, False, True, True]
    np.testing.assert_array_equal(observations[:, 1], [2, 2, 1, 1])
    observations, *_ = vector.step(acts(1, 1, 1, 1))  # begins the next episodes of those that were lost
    np.testing.assert_array_equal(observations[:, 1], [3, 3, 0, 0])
    observations, *_, infos = vector.step(acts(1, 1, 1, 1))
    np.testing.assert_array_equal(observations[:, 1], [4, 4, 1, 1])
    assert infos["pid"].tolist()[:2] == pids[:2] and infos["pid"][2] not in pids


@pytest.mark.usefixtures("started_anew")
def test_a_lost_environments_next_episode_is_the_one_it_would_have_had() -> None:
    with (
        coopsim.vector(SeededEnv, 2, workers=1) as vector,
        coopsim.vector(SeededEnv, 2, workers=0) as whole,
    ):
        vector.reset(seed=3), whole.reset(seed=3)
        with pytest.raises(LostEnvironmentsError):
            vector.step(acts(KILLED, 1))
        drawn, _ = whole.reset()
        observations, *_ = vector.step(acts(1, 1))
        np.testing.assert_array_equal(observations[:, 2], drawn[:, 2])


def test_what_cannot_be_made_raises_its_own_error() -> None:
    with pytest.raises(UnknownNameError, match="unknown option 'vehicels'"):
        coopsim.vector("crossing", 2, workers=1, vehicels=3)


PROGRAM = """
import signal
import coopsim
from counting_envs import SLOW, CountingAgents

def wrapped(env):  # of this script, which no worker imports
    return env

signal.signal(signal.SIGINT, signal.default_int_handler)
vector = coopsim.vector(CountingAgents, 2, workers=1, wrap=wrapped)
vector.reset(seed=0)
print("ready", flush=True)
vector.step([{"a": SLOW, "b": 0.0}] * 2)
"""


@pytest.mark.parametrize("how", all_of([signal.SIGINT, signal.SIGKILL], signal.SIGKILL))
def test_nothing_is_left_behind(tmp_path: Path, how: signal.Signals) -> None:
    """Neither processes nor shared memory, when the program is interrupted or killed."""
    script = tmp_path / "script.py"
    script.write_text(PROGRAM)
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(place or os.getcwd() for place in sys.path)}
    program = subprocess.Popen(
        [sys.executable, script], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=environment
    )
    assert program.stdout is not None and program.stderr is not None
    assert program.stdout.readline() == "ready\n"
    time.sleep(0.2)
    workers = psutil.Process(program.pid).children(recursive=True)
    assert len(workers) == 1
    named = shared_files(program.pid, workers[0].pid)
    program.send_signal(how)
    errors = program.communicate(timeout=20)[1]
    assert ("KeyboardInterrupt" in errors) == (how == signal.SIGINT)
    assert "Exception ignored" not in errors and "ResourceWarning" not in errors
    assert psutil.wait_procs(workers, timeout=10)[1] == []
    assert not [path for path in named if path.exists()]


def shared_files(*pids: int) -> list[Path]:
    """Files of shared memory that processes map; other tests have theirs at the same time."""
    maps = [Path(f"/proc/{pid}/maps") for pid in pids]
    lines = [line for path in maps if path.exists() for line in path.read_text().splitlines()]
    return [Path(line.split(maxsplit=5)[5]) for line in lines if " /dev/shm/" in line]


def test_an_interrupted_step_can_be_taken_up(vector: Any) -> None:
    """As in a notebook: no environment is stepped twice, and none is passed over."""
    vector.reset(seed=0)
    vector.set_attr("pause_s", 0.3)
    timer = threading.Timer(0.1, signal.pthread_kill, (threading.get_ident(), signal.SIGINT))
    timer.start()
    with pytest.raises(KeyboardInterrupt):
        vector.step(acts(1, 2, 3, 4))
    vector.set_attr("pause_s", 0.0)
    observations, rewards, *_ = vector.step(acts(9, 9, 9, 9))
    np.testing.assert_array_equal(observations[:, 1], [1, 1, 1, 1])
    assert rewards.tolist() == [1, 2, 3, 4]


def test_interrupts_at_any_moment(vector: Any) -> None:
    """Ctrl-C within `step`, a hundred times: all environments are at the same step ever after."""
    vector.reset(seed=0)
    vector.set_attr("length", 10**6)
    rng, main, steps = np.random.default_rng(0), threading.get_ident(), 0.0
    begun = time.perf_counter()
    vector.step(acts(1, 1, 1, 1))
    duration, interrupted = time.perf_counter() - begun, 0
    for _ in range(100):
        timer = threading.Timer(rng.uniform(0, duration), signal.pthread_kill, (main, signal.SIGINT))
        try:
            timer.start()
            vector.step(acts(1, 1, 1, 1))
            timer.join()
        except KeyboardInterrupt:
            interrupted += 1
        timer.join()
        observations, *_ = vector.step(acts(1, 1, 1, 1))
        assert len(set(observations[:, 1])) == 1 and observations[0, 1] > steps
        steps = observations[0, 1]
    assert interrupted == 100
    vector.set_attr("length", 50)


def test_an_interrupt_in_the_calling_process() -> None:
    """The environment that was stepping is lost; the others step once."""

    class Interrupted(CountingEnv):
        def step(self, action: Any) -> Any:
            stepped = super().step(action)
            if action[0] == 7:
                signal.raise_signal(signal.SIGINT)
            return stepped

    with coopsim.vector(Interrupted, 3, workers=0) as here:
        here.reset(seed=0)
        with pytest.raises(KeyboardInterrupt):
            here.step(acts(1, 7, 1))
        with pytest.raises(LostEnvironmentsError, match="lost environment 1: Ctrl-C interrupted its step") as raised:
            here.step(acts(1, 1, 1))
        assert raised.value.results[0][:, 1].tolist() == [1, 0, 1]
        assert here.step(acts(1, 1, 1))[0][:, 1].tolist() == [2, 0, 2]


@pytest.mark.parametrize("end", all_of(["os._exit(3)", "sys.exit(3)"], "os._exit(3)"))
def test_a_worker_that_ends_while_it_makes_environments(end: str) -> None:
    def ends() -> Any:
        exec(f"import os, sys; {end}")

    with pytest.raises((LostEnvironmentsError, RuntimeError)) as raised:
        coopsim.vector(ends, 2, workers=1)
    if end.startswith("os"):
        assert "lost environments 0, 1: the worker died (exit status 3) while it made" in str(raised.value)
    else:
        assert "SystemExit: 3" in str(raised.value)


def test_arrays_are_the_callers_own() -> None:
    """Later steps leave them alone, whichever the caller keeps."""

    class Large(CountingAgents):
        def _observed(self) -> Any:
            return {agent: {"rows": np.full((9000, 2), self.steps, np.float32)} for agent in self.possible_agents}

    with coopsim.vector(Large, 2, workers=1, length=50) as vector:
        vector.reset(seed=0)
        kept = []
        for step in range(1, 12):
            observations, *_ = vector.step([{"a": 1.0, "b": 1.0}] * 2)
            rows = observations[1]["b"]["rows"]
            assert rows.flags.writeable and rows.flags.aligned
            if step % 3 == 0:
                kept.append((step, rows[100:200]))
    for step, rows in kept:
        np.testing.assert_array_equal(rows, np.full((100, 2), step))


def test_the_end_without_close() -> None:
    """A vector that nobody has any more ends its workers."""
    before = set(psutil.Process().children())
    vector = coopsim.vector(CountingAgents, 1, workers=1)
    (worker,) = set(psutil.Process().children()) - before
    del vector
    assert not worker.is_running()
