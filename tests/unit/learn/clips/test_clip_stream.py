from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from itertools import islice
from pathlib import Path

import numpy as np
import pytest
from helpers.clip_sources import NumberedClips
from helpers.clips import SMALL, require_same

from coopsim.errors import CoopsimError, InvalidValueError
from coopsim.learn.clips.clip_stream import ClipStream
from coopsim.learn.rollout.rollout import SimulatedClips


@pytest.mark.parametrize("workers", [0, 1, 3])
def test_clips_come_in_order_for_any_number_of_workers(workers: int) -> None:
    with ClipStream(NumberedClips(), 5, workers) as stream:
        assert [clip.key for clip in islice(stream, 7)] == [f"clip {k}" for k in range(5, 12)]
        assert stream.index == 12
    assert next(stream, None) is None  # closed


def test_a_worker_makes_the_same_bits() -> None:
    source = SimulatedClips(SMALL, seed=1)
    with ClipStream(source, 4, workers=1) as stream:
        require_same(next(stream), source.clip(4))


def test_an_error_of_a_worker_comes_with_its_text() -> None:
    with ClipStream(NumberedClips(fails_at=2, why="coopsim"), 0, workers=2) as stream:
        assert [clip.key for clip in islice(stream, 2)] == ["clip 0", "clip 1"]
        with pytest.raises(InvalidValueError, match="no clip 2"):
            next(stream)
        assert next(stream, None) is None
    with (
        ClipStream(NumberedClips(fails_at=0, why="other"), 0, workers=1) as stream,
        pytest.raises(CoopsimError, match=r"(?s)clip 0 failed.*ZeroDivisionError"),
    ):
        next(stream)
    with (
        ClipStream(NumberedClips(fails_at=1, why="killed"), 0, workers=1) as stream,
        pytest.raises(CoopsimError, match="clip 1 failed:\nits worker ended: SIGKILL"),
    ):
        list(islice(stream, 2))


def test_a_source_that_cannot_be_pickled_is_refused() -> None:
    source = NumberedClips()
    source.why = lambda: None  # type: ignore[assignment]
    with pytest.raises(InvalidValueError, match="picklable"):
        ClipStream(source, 0, workers=2)


def test_workers_are_not_far_ahead_and_end_with_the_stream(tmp_path: Path) -> None:
    source = NumberedClips(notes=tmp_path, values=200_000)  # more than a pipe holds
    stream = ClipStream(source, 0, workers=1, ahead=2)
    next(stream)
    time.sleep(0.7)
    made = {int(note.name.split("_")[0]) for note in tmp_path.iterdir()}
    assert max(made) <= 5
    pids = {int(note.name.split("_")[1]) for note in tmp_path.iterdir()}
    stream.close()
    stream.close()
    assert pids and not any(_runs(pid) for pid in pids)


@pytest.mark.parametrize("how", [signal.SIGKILL, signal.SIGINT])
def test_workers_end_with_a_parent_that_is_killed(tmp_path: Path, how: signal.Signals) -> None:
    program = (
        "import signal, time; from pathlib import Path; from helpers.clip_sources import NumberedClips\n"
        # Started in the background, the tests ignore SIGINT, and what they start would, too.
        "signal.signal(signal.SIGINT, signal.default_int_handler)\n"
        "from coopsim.learn.clips.clip_stream import ClipStream\n"
        f"stream = ClipStream(NumberedClips(notes=Path({str(tmp_path)!r}), values=200_000), 0, workers=1)\n"
        "next(stream); print('ready', flush=True)\n"
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
    for wrong in ({"first_index": -1}, {"workers": -1}, {"workers": 1, "ahead": 0}):
        with pytest.raises(InvalidValueError):
            ClipStream(NumberedClips(), **wrong)  # type: ignore[arg-type]
    assert np.all(next(ClipStream(NumberedClips(), 0, workers=0)).scenes[0].boxes == 0)


def _runs(pid: int) -> bool:
    try:
        return Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()[0] != "Z"
    except OSError:
        return False
