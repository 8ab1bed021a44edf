"""A line carries any content, in turns; large arrays go by shared memory that grows."""

from __future__ import annotations

import os
from collections.abc import Iterator

import numpy as np
import pytest

from coopsim.envs.vector.arena import Arena
from coopsim.envs.vector.line import Line


@pytest.fixture
def ends() -> Iterator[tuple[Line, Line, list[int]]]:
    to_there, to_here = Arena.new(), Arena.new()
    there, here = Arena(os.dup(to_there.descriptor)), Arena(os.dup(to_here.descriptor))
    read_there, write_here = os.pipe()
    read_here, write_there = os.pipe()
    ours = Line(read_here, write_here, to_here, to_there)
    theirs = Line(read_there, write_there, there, here)
    open_ends = [read_there, write_here, read_here, write_there]
    yield ours, theirs, open_ends
    ours.close()
    theirs.close()
    for end in open_ends:
        os.close(end)


def test_contents_arrive_in_order_and_whole(ends: tuple[Line, Line, list[int]]) -> None:
    ours, theirs, _ = ends
    rng = np.random.default_rng(0)
    for turn in range(6):  # the first large content goes inside the pickle, later ones outside
        sizes = [0, 1, 1000, 10**5 * turn]
        ours.send({"turn": turn, "arrays": [rng.random(size) for size in sizes]})
        got = theirs.receive()
        assert got["turn"] == turn and [len(array) for array in got["arrays"]] == sizes
        for size in sizes:
            theirs.send((turn, rng.random((size, 2)).astype(np.float32), np.arange(size)))
        kept = [ours.receive() for _ in sizes]
        for size, (number, floats, whole) in zip(sizes, kept, strict=True):
            assert number == turn and floats.shape == (size, 2) and floats.dtype == np.float32
            np.testing.assert_array_equal(whole, np.arange(size))


def test_arrays_are_the_receivers_own(ends: tuple[Line, Line, list[int]]) -> None:
    ours, theirs, _ = ends
    for _ in range(2):
        ours.send(np.arange(10**5))
        first = theirs.receive()
        first[0] = 7  # writable
        theirs.send(None)
        ours.receive()
        ours.send(np.zeros(10**5))
        theirs.receive()
        theirs.send(None)
        ours.receive()
        assert first[0] == 7 and first[1] == 1 and first[-1] == 10**5 - 1


def test_the_other_end_may_be_gone(ends: tuple[Line, Line, list[int]]) -> None:
    ours, _, open_ends = ends
    for end in (open_ends[0], open_ends[3]):
        os.close(end)
    del open_ends[3], open_ends[0]
    with pytest.raises(BrokenPipeError):
        ours.send("hello")
    with pytest.raises(EOFError):
        ours.receive()


def test_memory_has_no_name() -> None:
    arena = Arena.new()
    arena.reserve(10**6)
    assert len(arena.view) >= 10**6
    assert os.fstat(arena.descriptor).st_nlink == 0
    arena.close()
    arena.close()
