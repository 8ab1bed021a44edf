from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading
import time
from itertools import islice
from pathlib import Path

import pytest
from helpers.clip_sources import NumberedClips
from helpers.clips import SMALL, require_same
from helpers.script_parts import parts_of_a_script
from representatives import all_of

from coopsim.errors import CoopsimError, InvalidValueError
from coopsim.learn.clips.ahead import ClipMaker, ClipsAhead, Failure, until_failure
from coopsim.learn.clips.clip import Clip
from coopsim.learn.clips.simulated import SimulatedClips


@pytest.mark.parametrize("workers", all_of([1, 2, 3], 2))
def test_clips_come_in_order_for_any_number_of_workers(workers: int) -> None:
    with ClipsAhead(NumberedClips(), workers) as ahead:
        assert [ahead.clip(k).key for k in range(5, 12)] == [f"clip {k}" for k in range(5, 12)]


@pytest.mark.usefixtures("started_anew")
def test_a_worker_makes_the_same_bits() -> None:
    source = SimulatedClips(SMALL, seed=1)
    with ClipsAhead(source) as ahead:
        require_same(ahead.clip(4), source.clip(4))


def test_an_error_of_a_worker_comes_with_its_text() -> None:
    with ClipsAhead(NumberedClips(fails_at=2, why="coopsim"), workers=2) as ahead:
        assert [ahead.clip(k).key for k in range(2)] == ["clip 0", "clip 1"]
        with pytest.raises(InvalidValueError, match="no clip 2"):
            ahead.clip(2)
    with (
        ClipsAhead(NumberedClips(fails_at=0, why="other")) as ahead,
        pytest.raises(CoopsimError, match=r"(?s)clip 0 failed.*ZeroDivisionError"),
    ):
        ahead.clip(0)
    with (
        ClipsAhead(NumberedClips(fails_at=1, why="killed")) as ahead,
        pytest.raises(CoopsimError, match="clip 1 failed:\nits worker ended: SIGKILL"),
    ):
        [ahead.clip(k) for k in range(2)]


def test_errors_of_sources_are_results() -> None:
    clips, error, report = (
        list(islice(until_failure(ClipMaker(source), 3, 1), 2))
        for source in (NumberedClips(), NumberedClips(fails_at=3), NumberedClips(fails_at=3, why="other"))
    )
    assert [isinstance(each, Clip) for each in clips] == [True, True]
    assert len(error) == len(report) == 1
    assert isinstance(error[0], Failure) and isinstance(error[0].error("clip 3"), InvalidValueError)
    assert "no clip 3" in str(error[0].reason) and "ZeroDivisionError" in str(report[0].error("clip 3"))


def test_a_source_that_cannot_be_pickled_is_refused() -> None:
    source = NumberedClips()
    source.why = threading.Lock()  # type: ignore[assignment]
    with pytest.raises(InvalidValueError, match="picklable"):
        ClipsAhead(source, workers=2).clip(0)


def test_a_worker_knows_the_classes_of_the_script_and_what_it_registered() -> None:
    with parts_of_a_script() as script, ClipsAhead(script["Source"]()) as ahead:
        assert ahead.clip(0).key == "clip 25"


def test_workers_are_not_far_ahead_and_end_with_the_stream(tmp_path: Path) -> None:
    source = NumberedClips(notes=tmp_path, values=200_000)  # more than a pipe holds
    stream = ClipsAhead(source, workers=1, ahead=2)
    stream.clip(0)
    time.sleep(0.7)
    made = {int(note.name.split("_")[0]) for note in tmp_path.iterdir()}
    assert max(made) <= 5
    pids = {int(note.name.split("_")[1]) for note in tmp_path.iterdir()}
    stream.close()
    stream.close()
    assert pids and not any(_runs(pid) for pid in pids)


@pytest.mark.parametrize("how", all_of([signal.SIGKILL, signal.SIGINT], signal.SIGKILL))
def test_workers_end_with_a_parent_that_is_killed(tmp_path: Path, how: signal.Signals) -> None:
    program = (
        "import signal, time; from pathlib import Path; from helpers.clip_sources import NumberedClips\n"
        # Started in the background, the tests ignore SIGINT, and what they start would, too.
        "signal.signal(signal.SIGINT, signal.default_int_handler)\n"
        "from coopsim.learn.clips.ahead import ClipsAhead\n"
        f"stream = ClipsAhead(NumberedClips(notes=Path({str(tmp_path)!r}), values=200_000))\n"
        "stream.clip(0); print('ready', flush=True)\n"
        "while True: time.sleep(0.01)\n"
    )
    path = os.pathsep.join(sys.path)
    with subprocess.Popen(
        [sys.executable, "-c", program],
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        env={**os.environ, "PYTHONPATH": path},
    ) as parent:
        assert parent.stdout is not None and parent.stdout.readline() == b"ready\n"
        parent.send_signal(how)
    pids = {int(note.name.split("_")[1]) for note in tmp_path.iterdir()}
    until = time.monotonic() + 5
    while any(_runs(pid) for pid in pids) and time.monotonic() < until:
        time.sleep(0.02)
    assert pids and not any(_runs(pid) for pid in pids)


def test_numbers_are_checked() -> None:
    for wrong in ({"workers": 0}, {"ahead": 0}):
        with pytest.raises(InvalidValueError):
            ClipsAhead(NumberedClips(), **wrong)


def _runs(pid: int) -> bool:
    try:
        return Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()[0] != "Z"
    except OSError:
        return False
